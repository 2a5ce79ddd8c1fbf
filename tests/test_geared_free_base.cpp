// PROGRAM: tests_implicit
// Geared motors on the limbs of a free base, everything about one point: B̂ in closed form. And a base that is small
// against how far a centre of mass lies from its joint.
#include "catch.hpp"
#include "worst.hpp"

#include <iim/iim.hpp>
#include <iim/subsystem/joint_more.hpp>
#include <iim/subsystem/sprung.hpp>

#include <cmath>
#include <limits>
#include <string>

namespace test_geared_free_base {

using namespace iim;
using iim::test::keep_worst;

namespace {

using Parts = Assembly<FloatingBase<double>, SphericalLink<double>, MotorArm<double>, RevoluteLink<double>,
                       Sprung<RevoluteLink<double>>>;
using Tree = Parts::Tree;

constexpr double eps = std::numeric_limits<double>::epsilon();

Body<double> ball_of(double mass, double moment)
{
  Body<double> body;
  body.mass = mass;
  body.inertia.diagonal().setConstant(moment);
  return body;
}

MotorArm<double> arm_of(double mass, double moment, double gear, double rotor, bool armature)
{
  MotorArm<double> arm;
  arm.body = ball_of(mass, moment);
  arm.motor.gear_ratio = gear;
  arm.motor.axial_inertia = rotor;
  arm.motor.armature = armature;
  return arm;
}

enum class Input { motor_of_arm, moment_on_base };

/// Of a torque or moment about z the column in two velocities, against what they are, in ε of both.
template <Update update>
double error(const Parts& parts, Input input, Index v_body, long double body, Index v_arm, long double arm)
{
  const Tree tree(parts);
  Inputs inputs(tree, Start::empty);
  if (input == Input::motor_of_arm) {
    inputs.add_motor("arm");
  } else {
    inputs.add_wrench("base");
  }
  Workspace<Tree, update> ws(tree);
  ImplicitInversion method(tree, inputs);
  const auto result = method(neutral(tree), VectorX<double>::Zero(tree.n_v()), ws);
  REQUIRE(result.ok());
  const Index column = inputs.columns() - 1;
  const long double off = std::hypot(result.Bhat(v_body, column) - body, result.Bhat(v_arm, column) - arm);
  return static_cast<double>(off / std::hypot(body, arm)) / eps;
}

}  // namespace

TEST_CASE("a geared arm beyond a ball on a light base turns the ball's body by what the rotor leaves")
{
  double worst = 0;
  for (const double base : {0.47, 4.7e-4, 4.7e-7}) {
    for (const double rotor : {1e-7, 1e-5, 1e-4, 7.9e-4, 1e-2, 1.0}) {
      Parts parts;
      parts.add("base", {}, FloatingBase<double>{ball_of(base, base * 1e-3)});
      parts.add("ball", {.parent = "base"}, SphericalLink<double>{{}, ball_of(1.8, 0.01)});
      parts.add("arm", {.parent = "ball"}, arm_of(1.1, 0.0047, 92, rotor, true));
      // (J g² + I) q̈ + I ω̇ = g and (I_ball + I) ω̇ + I q̈ = 0.
      const long double I = 0.0047, all = I + 0.01L;
      const long double q = 92 / (static_cast<long double>(rotor) * 92 * 92 + I - I * I / all);
      keep_worst(worst, error<Update::square_root>(parts, Input::motor_of_arm, 8, -I / all * q, 9, q));
    }
  }
  CHECK(worst < 32);  // 2; without its part of the load the rotor's inertia would be lost, 1e5
}

TEST_CASE("a free base with a geared motor keeps the digits of what turns it")
{
  double projected = 0, square_root = 0;
  for (const double gear : {1.0, 100.0, 1000.0}) {
    for (const double rotor : {1e-5, 1e-3, 8.4e-3}) {
      Parts parts;
      parts.add("base", {}, FloatingBase<double>{ball_of(1.1, 0.0012)});
      parts.add("arm", {.parent = "base"}, arm_of(0.35, 0.0016, gear, rotor, false));
      // D q̈ + d ω̇ = g τ and d q̈ + c ω̇ = n, D = I + J g², d = I + J g, c = I_base + I + J.
      const long double J = rotor, g = gear, I = 0.0016, D = I + J * g * g, d = I + J * g, c = 0.0012 + I + J;
      const long double det = 0.0012L * D + J * I * (g - 1) * (g - 1);  // c D − d²
      keep_worst(projected, error<Update::projected>(parts, Input::motor_of_arm, 5, -d * g / det, 6, c * g / det));
      keep_worst(projected, error<Update::projected>(parts, Input::moment_on_base, 5, D / det, 6, -d / det));
      keep_worst(square_root, error<Update::square_root>(parts, Input::motor_of_arm, 5, -d * g / det, 6, c * g / det));
      keep_worst(square_root, error<Update::square_root>(parts, Input::moment_on_base, 5, D / det, 6, -d / det));
    }
  }
  CHECK(projected < 32);  // 2; 1800 with what the rotor leaves as a difference
  CHECK(square_root < 32);
}

TEST_CASE("square root: a small free base stays where a far centre of mass does not move it")
{
  for (const double far : {3.0, 10.0, 100.0}) {
    INFO("centre of mass " << far << " m from its joint");
    Parts parts;
    parts.set_gravity(Vector3<double>::Zero());
    parts.add("base", {}, FloatingBase<double>{ball_of(1.6, 0.003)});
    parts.add("inner", {.parent = "base"}, RevoluteLink<double>{{}, ball_of(1.6, 0.006)});
    RevoluteLink<double> outer{{}, ball_of(0.5, 0.0015)};
    outer.joint.axis = Vector3<double>::UnitX();
    outer.body.com << 0, far, 0;
    parts.add("outer", {.parent = "inner"}, outer);
    const Tree tree(parts);
    Workspace<Tree, Update::square_root> ws(tree);
    VectorX<double> q = neutral(tree), qd = VectorX<double>::Zero(tree.n_v());
    q(8) = 2.6;
    qd(7) = -0.26;
    const auto result = forward_dynamics(q, qd, ws);
    REQUIRE(result.ok());
    CHECK(std::abs(result.qdd0()(3)) < 64 * eps * result.qdd0().norm());  // both are 0; without: 500, 3000, 2e4
    CHECK(std::abs(result.qdd0()(7)) < 64 * eps * result.qdd0().norm());
  }
}

TEST_CASE("springs of an implicit step leave nothing to the pass after it")
{
  Parts parts;
  parts.add("base", {}, FloatingBase<double>{ball_of(1e-3, 1e-6)});
  parts.add("ball", {.parent = "base"}, SphericalLink<double>{{}, ball_of(1.8, 0.01)});
  Sprung<RevoluteLink<double>> arm{{{}, ball_of(1.1, 0.0047)}};
  arm.stiffness(0) = 1e6;
  parts.add("arm", {.parent = "ball"}, arm);
  const Tree tree(parts);
  Inputs inputs(tree, Start::empty);
  inputs.add_motor("arm");
  const VectorX<double> q = neutral(tree), qd = VectorX<double>::Zero(tree.n_v());
  Workspace<Tree, Update::square_root> ws(tree), fresh(tree);
  ImplicitInversion method(tree, inputs), other(tree, inputs);
  REQUIRE(method(implicit_step(q, qd, 0.01, ws)).ok());
  const auto after = method(q, qd, ws);
  const auto expected = other(q, qd, fresh);
  REQUIRE(after.ok());
  CHECK(after.Bhat == expected.Bhat);
  // I q̈ + I ω̇ = 1 and (I_ball + I) ω̇ + I q̈ = 0. (With the springs' share −0.005.)
  CHECK(std::abs(after.Bhat(8, 0) + 1 / 0.01) < 32 * eps * 100);
}

}  // namespace test_geared_free_base
