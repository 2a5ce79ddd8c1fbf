// PROGRAM: tests_drives
// Small pivots of a subsystem of several frames: an arm whose wrist is one compound, stretched out but for 10⁻³ rad and
// under a load, against the square-root form in long double.
#include "catch.hpp"
#include "type_robots.hpp"
#include "worst.hpp"

#include <iim/subsystem/compound.hpp>

#include <algorithm>
#include <limits>
#include <string>

using namespace iim;

namespace {

using Arm = Assembly<RevoluteLink<double>, Wrist<double>>;

/// Four links and a wrist of three hinges, axes in turn along and across. The hand weighs `load` times the wrist's
/// other bodies.
Arm arm(double load)
{
  const auto axis = [](std::size_t k) { return test::Vec3(k % 2 == 0 ? test::Vec3::UnitZ() : test::Vec3::UnitY()); };
  Arm arm;
  Attachment<double> on;
  for (std::size_t k = 0; k < 4; ++k) {
    RevoluteLink<double> link;
    link.joint.axis = axis(k);
    link.body = {2, {0, 0, 0.15}, test::Vec3(0.02, 0.02, 0.003).asDiagonal(), false};
    arm.add("link" + std::to_string(k), on, link);
    on.parent = "link" + std::to_string(k);
    on.p.z() = 0.3;
  }
  Wrist<double> wrist;
  for (std::size_t k = 0; k < 3; ++k) {
    wrist.mechanism.axis[k] = axis(k);
    wrist.mechanism.offset[k] = {0, 0, k == 0 ? 0 : 0.05};
    wrist.body[k] = {0.5, {0, 0, 0.02}, test::Vec3(1e-3, 1e-3, 5e-4).asDiagonal(), false};
  }
  wrist.body[2] = {0.5 * load, {0, 0, 0.1}, test::Mat3(load * 2e-3 * test::Mat3::Identity()), false};
  arm.add("wrist", on, wrist);
  return arm;
}

/// Worst error of B̂ over 60 states, in ε.
double worst(double load)
{
  using Exact = long double;
  const Arm robot = arm(load);
  const auto robot_exact = robot.cast<Exact>();
  const DynamicTree tree(robot);
  const DynamicTree tree_exact(robot_exact);
  const Inputs inputs(tree);
  const Inputs inputs_exact(tree_exact);
  Workspace ws(tree);
  Workspace<std::remove_const_t<decltype(tree_exact)>, Update::square_root> ws_exact(tree_exact);
  ImplicitInversion method(tree, inputs);
  ImplicitInversion method_exact(tree_exact, inputs_exact);
  test::Random random(100);
  Exact error = 0;
  for (int k = 0; k < 60; ++k) {
    VectorX<double> q(7), qd(7);
    for (Index i = 0; i < 7; ++i) {
      q(i) = i < 3 ? random.uniform(-2, 2) : random.uniform(-1e-3, 1e-3);
      qd(i) = random.uniform(-1, 1);
    }
    const auto dynamics = method(forward_dynamics(q, qd, ws));
    const auto exact =
        method_exact(forward_dynamics(VectorX<Exact>(q.cast<Exact>()), VectorX<Exact>(qd.cast<Exact>()), ws_exact));
    REQUIRE(dynamics.ok());
    REQUIRE(exact.ok());
    const MatrixX<Exact> off = dynamics.Bhat.cast<Exact>() - exact.Bhat;
    test::keep_worst(error, off.norm() / exact.Bhat.norm());
  }
  return static_cast<double>(error) / std::numeric_limits<double>::epsilon();
}

}  // namespace

TEST_CASE("A wrist as one compound keeps its digits where it is stretched out under a load")
{
  CHECK(worst(1) < 64);
  CHECK(worst(1e3) < 64);  // without mending 10⁴
}
