// PART OF: iim_accuracy
// REQUIRES: boost
// The second, independent reference: the paper's formulas as printed.
#include "digits.hpp"

#include "../../tests/reference/literal.hpp"
#include "../../tests/worst.hpp"

#include <algorithm>

namespace bench {

namespace {

double relative(const iim::reference::Dense<Digits>& a, const iim::reference::Dense<Digits>& b)
{
  const Digits size = b.norm();
  const Digits difference = (a - b).norm();
  return static_cast<double>(size > 0 ? Digits(difference / size) : difference);
}

}  // namespace

double apart_from_the_paper(const AccuracyScene& scene, const iim::StandardAssembly<Digits>& parts,
                            const State<Digits>& x, const ExactState& exact)
{
  using iim::reference::Dense;
  // Motors in the order of the tree, then the points, as iim::Inputs has them.
  std::vector<iim::test::NamedInput> inputs;
  for (const auto& part : parts.sorted()) {
    const int motors = std::visit([](const auto& s) { return std::remove_cvref_t<decltype(s)>::n_u; }, part.part);
    if (motors > 0) { inputs.push_back({iim::InputKind::motor, part.name}); }
  }
  for (const std::string& point : scene.points) { inputs.push_back({iim::InputKind::force, point}); }
  const iim::reference::Literal<Digits> robot(parts, inputs, Dense<Digits>(x.q), Dense<Digits>(x.qd));
  const auto [Bhat, qdd0] = iim::reference::direct_solution(robot);
  double worst = 0;
  iim::test::keep_worst(worst, relative(Dense<Digits>(exact.M), robot.M()));
  iim::test::keep_worst(worst, relative(Dense<Digits>(exact.B), robot.B()));
  iim::test::keep_worst(worst, relative(Dense<Digits>(exact.Bhat), Bhat));
  iim::test::keep_worst(worst, relative(Dense<Digits>(exact.qdd0), qdd0));
  return worst;
}

}  // namespace bench
