// PROGRAM: tests_parallel
// Groups of parallel joints in axes of their own: the same mechanics for whatever else hangs on them and between them.
#include "catch.hpp"
#include "random_tree.hpp"

#include <iim/iim.hpp>

#include <cstdint>
#include <string>
#include <utility>

namespace test_parallel_groups {

using namespace iim;

namespace {

using Robot =
    Assembly<RevoluteLink<double>, MotorArm<double>, FloatingBase<double>, PrismaticLink<double>, FixedLink<double>>;
using Tree = decltype(DynamicTree(std::declval<const Robot&>()));

/// Two groups of parallel joints about oblique directions, the second on the first, on a floating base or on the world:
/// motor-arms with rotors and housings on the inlet, sliding and rigid parts between, branches, others on them.
Robot mechanism(bool floating, test::Random& random)
{
  Robot parts;
  parts.set_gravity({1, -2, -9});
  std::string parent = "world";
  if (floating) {
    parts.add("base", {}, FloatingBase<double>{random.body()});
    parent = "base";
  }
  for (const std::string group : {"a", "b"}) {
    const Vector3<double> axis = random.axis();
    Matrix3<double> R = random.rotation();
    for (int k = 0; k < 8; ++k) {
      const std::string name = group + std::to_string(k);
      const Attachment<double> on{.parent = parent, .R = R, .p = random.vector(0.5)};
      R.setIdentity();
      parent = name;
      if (k == 3) {
        parts.add(name, on, FixedLink<double>{{}, random.body()});
      } else if (k == 5) {
        parts.add(name, on, PrismaticLink<double>{{random.axis()}, random.body()});
      } else if (k % 2 == 0) {
        MotorArm<double> arm{{axis}, random.body(), random.motor()};
        arm.motor.mass = 0.5;
        arm.motor.com = random.vector(0.3);
        arm.motor.transverse_inertia = arm.motor.axial_inertia;
        parts.add(name, on, arm);
      } else {
        parts.add(name, on, RevoluteLink<double>{{-axis}, random.body()});
      }
    }
    // A branch of the group, and one that turns about something else.
    parts.add(group + "branch", {.parent = group + "4", .p = random.vector(0.5)},
              RevoluteLink<double>{{axis}, random.body()});
    parts.add(group + "other", {.parent = group + "2", .R = random.rotation()},
              MotorArm<double>{{random.axis()}, random.body(), random.motor()});
    parts.add(group + "tool", {.parent = group + "other"}, FixedLink<double>{{}, random.body()});
    parent = group + "6";
  }
  return parts;
}

}  // namespace

TEST_CASE("groups of parallel joints: the same accelerations in turned axes, with rotors, branches and contact forces")
{
  // The square-root form knows no turned axes. 1e-10: some 100 ε, times conditions to 10⁴ of these mechanisms.
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    CAPTURE(seed);
    test::Random random(seed);
    const Tree tree(mechanism(seed % 2 == 0, random));
    Inputs inputs(tree);
    for (const char* frame : {"a1", "a5", "b6", "bbranch", "aother", "btool"}) { inputs.add_wrench(frame); }
    Workspace<Tree> ws(tree);
    Workspace<Tree, Update::square_root> reference_ws(tree);
    ImplicitInversion method(tree, inputs);
    for (int k = 0; k < 5; ++k) {
      const test::RandomState x = test::random_state(tree, inputs.columns(), random);
      const auto dynamics = method(forward_dynamics(x.q, x.qd, ws));
      REQUIRE(dynamics.ok());
      CHECK(ws.axes().turned());
      const VectorX<double> qdd0 = dynamics.qdd0;
      const MatrixX<double> Bhat = dynamics.Bhat;
      const auto reference = method(forward_dynamics(x.q, x.qd, reference_ws));
      REQUIRE(reference.ok());
      CHECK((qdd0 - reference.qdd0).norm() < 1e-10 * reference.qdd0.norm());
      CHECK((Bhat - reference.Bhat).norm() < 1e-10 * reference.Bhat.norm());
      const VectorX<double> qdd = forward_dynamics(x.q, x.qd, inputs, x.u, ws).qdd;
      const VectorX<double> exact = reference.qdd0 + reference.Bhat * x.u;
      CHECK((qdd - exact).norm() < 1e-10 * exact.norm());

      constexpr Scene rest{.velocity = false};
      const VectorX<double> at_rest = forward_dynamics<rest>(x.q, x.qd, ws).qdd0();
      const VectorX<double> exact_at_rest = forward_dynamics<rest>(x.q, x.qd, reference_ws).qdd0();
      CHECK((at_rest - exact_at_rest).norm() < 1e-10 * exact_at_rest.norm());
    }
  }
}

}  // namespace test_parallel_groups
