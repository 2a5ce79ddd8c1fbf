// PROGRAM: tests_loops
// The law suite on plane loops.
#include "catch.hpp"
#include "type_laws.hpp"

#include <iim/subsystem/four_bar.hpp>
#include <iim/subsystem/slider_crank.hpp>

using namespace iim;
using namespace iim::test;

namespace {

Plane<double> random_plane(Random& random)
{
  Plane<double> plane;
  plane.normal = random.unit();
  plane.x = plane.normal.cross(random.unit()).normalized();
  return plane;
}

}  // namespace

TEST_CASE("Four-bars, on both ways to close, and parallelograms obey the laws")
{
  Random random(96);
  for (const double side : {1.0, -1.0}) {
    FourBar<double> bars;
    bars.mechanism = {random_plane(random), {0.8, 0.6}, 0.4, 0.9, 0.8, side};
    for (Body<double>& body : bars.body) { body = random.body(); }
    obeys_the_laws("four-bar", bars);
  }
  Parallelogram<double> para;
  para.mechanism = {random_plane(random), {0.8, -0.3}, 0.5};
  for (Body<double>& body : para.body) { body = random.body(); }
  obeys_the_laws("parallelogram", para);
}

TEST_CASE("Slider-cranks and actuated levers, their screws included, obey the laws")
{
  Random random(97);
  for (const double side : {1.0, -1.0}) {
    SliderCrank<double> slider;
    slider.mechanism = {random_plane(random), 0.3, 0.6, 0.05, side};
    for (Body<double>& body : slider.body) { body = random.body(); }
    obeys_the_laws("slider-crank", slider);
  }
  ActuatedLever<double> lever;
  lever.mechanism = {random_plane(random), {0.25, 0.1}, {0.05, 0.08}, 300};
  for (Body<double>& body : lever.body) { body = random.body(); }
  lever.body[3] = {0.1, Vec3::Zero(), 2e-5 * Mat3::Identity(), false};
  obeys_the_laws("actuated lever", lever);
}
