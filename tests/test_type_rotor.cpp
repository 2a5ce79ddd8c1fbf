// PROGRAM: tests_drives
// The rotor of a motor-arm against the rotor as a body of its own, tied to the joint by its gear ratio.
#include "catch.hpp"
#include "type_robots.hpp"
#include "worst.hpp"

using namespace iim;
using namespace iim::test;

namespace {

constexpr std::uint64_t rotor_seed = 98;
using RotorParts = Assembly<FloatingBase<double>, RevoluteLink<double>, PrismaticLink<double>, MotorArm<double>,
                            LinearMotorArm<double>>;

/// base (free) – arm – load as one tree, base – (rotor, arm – load) as the other; rows q̈₀, B̂ for motors and a wrench.
template <class Arm, class Link>
double difference(Random& random)
{
  Motor<double> motor = random.motor(0);
  motor.axial_inertia *= 100;  // so that what it does by its spin is more than a rounding in the rest
  motor.mass = random.uniform(0.1, 1);
  motor.com = random.vector(0.3);
  motor.axis = random.unit();
  motor.transverse_inertia = motor.axial_inertia * random.uniform(0.6, 2);
  const auto joint = decltype(Arm::joint){random.unit()};
  const Body<double> body = random.body(), base = random.body();
  const RevoluteLink<double> load{{random.unit()}, random.body()};
  const Attachment<double> on = random_attachment(random, "base"), load_on = random_attachment(random, "arm");
  RotorParts one, all;
  one.add("base", {}, FloatingBase<double>{base}).add("arm", on, Arm{joint, body, motor}).add("load", load_on, load);
  const Mat3 along = motor.axis * motor.axis.transpose();
  const Body<double> rotor{motor.mass, Vec3::Zero(),
                           motor.axial_inertia * along + motor.transverse_inertia * (Mat3::Identity() - along), false};
  all.add("base", {}, FloatingBase<double>{base});
  all.add("rotor", {"base", on.R, on.R * motor.com + on.p, 0}, RevoluteLink<double>{{motor.axis}, rotor});
  all.add("arm", on, Link{joint, body}).add("load", load_on, load);
  const Vec3 gravity = random.vector(10);
  one.set_gravity(gravity);
  all.set_gravity(gravity);
  const DynamicTree a(one), b(all);
  Inputs inputs(a), full(b, Start::empty);
  inputs.add_wrench("load");
  // All generalised forces of the open tree, then the wrench.
  full.add_wrench("base", Vec3::Zero(), Axes::body);
  for (const char* name : {"rotor", "arm", "load"}) { full.add_motor(name); }
  full.add_wrench("load");

  const RandomState state = random_state(a, 0, random, 3);
  // q̇_all = J q̇: base 6, rotor, arm, load.
  Eigen::MatrixXd J = Eigen::MatrixXd::Zero(9, 8);
  J.topLeftCorner<6, 6>().setIdentity();
  J(6, 6) = motor.gear_ratio;
  J(7, 6) = J(8, 7) = 1;
  Eigen::VectorXd q(10);
  q << state.q.head<7>(), motor.gear_ratio * state.q(7), state.q.tail<2>();
  const Answer x = solve(a, inputs, state.q, state.qd), y = solve(b, full, q, J * state.qd);
  REQUIRE(x.status == Status::ok);
  REQUIRE(y.status == Status::ok);
  const Eigen::MatrixXd M = y.Bhat.leftCols<9>().inverse();
  Eigen::MatrixXd force(9, 9);  // −h, the motors of arm (on its rotor) and load, the wrench
  force << M * y.qdd0, Eigen::VectorXd::Unit(9, 6), Eigen::VectorXd::Unit(9, 8), M * y.Bhat.rightCols<6>();
  const Eigen::MatrixXd expected = (J.transpose() * M * J).llt().solve(J.transpose() * force);
  Eigen::MatrixXd rows(8, 9);
  rows << x.qdd0, x.Bhat;

  // And it is the rotor that is seen: at rest relative to its parent it would do something else.
  Motor<double> still = motor;
  still.gear_ratio = 0;
  RotorParts without;
  without.add("base", {}, FloatingBase<double>{base})
      .add("arm", on, Arm{joint, body, still})
      .add("load", load_on, load);
  without.set_gravity(gravity);
  const DynamicTree c(without);
  REQUIRE(relative_error(solve(c, Inputs(c), state.q, state.qd).qdd0, x.qdd0) > 1e-6);
  return relative_error(rows, expected);
}

// M of the open tree is inverted twice; its condition number is up to 1e3 for rotors of up to 0.1 kg m².
constexpr double tolerance = 1e4 * eps;

}  // namespace

TEST_CASE("A motor-arm's rotor, gyroscopic moments included, is a body that the gear ties to the joint")
{
  INFO("seed " << rotor_seed);
  Random random(rotor_seed);
  double worst = 0;
  for (int k = 0; k < 100; ++k) { keep_worst(worst, difference<MotorArm<double>, RevoluteLink<double>>(random)); }
  INFO("largest difference " << worst);
  CHECK(worst < tolerance);
}

TEST_CASE("A linear motor-arm's rotor is a body that the screw ties to the slide")
{
  INFO("seed " << rotor_seed + 1);
  Random random(rotor_seed + 1);
  double worst = 0;
  for (int k = 0; k < 100; ++k) {
    keep_worst(worst, difference<LinearMotorArm<double>, PrismaticLink<double>>(random));
  }
  INFO("largest difference " << worst);
  CHECK(worst < tolerance);
}
