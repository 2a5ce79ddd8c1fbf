// PART OF: iim_types
// Subsystems with a closed loop inside.
#include "measure.hpp"

#include <iim/subsystem/four_bar.hpp>
#include <iim/subsystem/parallel_ankle.hpp>
#include <iim/subsystem/slider_crank.hpp>

namespace bench {

std::vector<TypeCost> costs_of_loops(bool quick)
{
  using namespace iim;
  FourBar<double> bars;
  bars.mechanism = {{}, {0.8, 0.6}, 0.4, 0.9, 0.8, 1};
  bars.body = {box(), box(), box()};
  Parallelogram<double> para;
  para.mechanism = {{}, {0.8, -0.3}, 0.5};
  para.body = bars.body;
  SliderCrank<double> slider;
  slider.mechanism = {{}, 0.3, 0.6, 0.05, 1};
  slider.body = bars.body;
  ActuatedLever<double> lever;
  lever.mechanism = {{}, {0.25, 0.1}, {0.05, 0.08}, 300};
  lever.body = {box(), box(), box(), box()};
  ParallelAnkle<double> ankle;
  for (std::size_t k = 0; k < 2; ++k) {
    PushRod<double>& rod = ankle.mechanism.rod[k];
    const double y = k == 0 ? 0.04 : -0.04;
    rod.hinge = {0.01, y, k == 0 ? 0.25 : 0.18};
    rod.crank = {-0.07, 0, 0};
    rod.foot = {-0.05, y, 0.01};
    rod.rod = (rod.hinge + rod.crank - rod.foot).norm();
    rod.rod_mass = 0.15;
    rod.gear_ratio = 9;
    rod.rotor_inertia = 1e-4;
    ankle.body[k + 1] = box();
  }
  ankle.body[0] = box();
  return {
      cost_of("four-bar", bars, quick, 2),
      cost_of("parallelogram", para, quick, 1),
      cost_of("slider-crank", slider, quick, 2),
      cost_of("lever with linear actuator and screw", lever, quick),
      cost_of("parallel ankle, two push-rods", ankle, quick),
  };
}

}  // namespace bench
