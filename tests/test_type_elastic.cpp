// PROGRAM: tests_drives
// Elastic motor-arm: the laws; rotor and arm as two bodies with a spring; the rigid motor-arm as a limit.
#include "catch.hpp"
#include "type_robots.hpp"

#include <iim/law_suite.hpp>
#include <iim/subsystem/elastic_motor_arm.hpp>
#include <iim/unit_force.hpp>

using namespace iim;
using namespace iim::test;

namespace {

using Elastic = ElasticMotorArm<double>;
using ElasticParts = Assembly<RevoluteLink<double>, Elastic, MotorArm<double>>;

Elastic random_elastic(Random& random)
{
  Elastic drive{{random.axis()}, random.body(), random.motor(), random.uniform(10, 1000), random.uniform(0, 10)};
  drive.motor.armature = false;
  drive.motor.mass = random.uniform(0.1, 1);
  drive.motor.axis = random.unit();
  drive.motor.com = random.uniform(-0.2, 0.2) * drive.motor.axis;  // its axis goes through the coupling point
  drive.motor.transverse_inertia = drive.motor.axial_inertia;
  return drive;
}

/// base – drive – load, the drive added by `add`.
template <class F>
DynamicTree<RevoluteLink<double>, Elastic, MotorArm<double>> robot(std::uint64_t number, F&& add)
{
  Random random(number);
  ElasticParts parts;
  parts.add("base", {}, RevoluteLink<double>{{random.unit()}, random.body()});
  add(parts, random_attachment(random, "base"));
  parts.add("load", random_attachment(random, "arm"), RevoluteLink<double>{{random.unit()}, random.body()});
  return DynamicTree(parts);
}

/// The square-root form against the default at one state, B̂ by product and by sweep.
template <class Tree>
void check_root(const Tree& tree, const Inputs<Tree>& inputs, Random& random, double bound)
{
  Workspace<Tree, Update::square_root> root(tree);
  Workspace<Tree> matrix(tree);
  ImplicitInversion by_root(tree, inputs), by_matrix(tree, inputs);
  UnitForce by_sweep(tree, inputs);
  const RandomState state = random_state(tree, 0, random);
  const auto fd = forward_dynamics(state.q, state.qd, root);
  const auto x = by_root(fd);
  const auto y = by_matrix(forward_dynamics(state.q, state.qd, matrix));
  const auto z = by_sweep(fd);
  REQUIRE(by_root.product_from() <= inputs.columns());
  REQUIRE(x.ok());
  REQUIRE(y.ok());
  REQUIRE(z.ok());
  CHECK((x.Bhat - y.Bhat).norm() <= bound * y.Bhat.norm());
  CHECK((z.Bhat - y.Bhat).norm() <= bound * y.Bhat.norm());
  CHECK((x.qdd0 - y.qdd0).norm() <= bound * y.qdd0.norm());
}

}  // namespace

TEST_CASE("An elastic motor-arm obeys the laws")
{
  Random random(21);
  LawOptions<Elastic> options;
  options.explicit_part = 1e-6;
  const LawReport report = check_laws(random_elastic(random), options);
  INFO(report.text());
  CHECK(report.ok());
  CHECK(report.laws.size() == 13);
}

TEST_CASE("An elastic drive is a rotor and an arm with a spring between them")
{
  Random random(22);
  for (std::uint64_t k = 0; k < 100; ++k) {
    const Elastic drive = random_elastic(random);
    const auto one = robot(k, [&](ElasticParts& p, const auto& on) { p.add("arm", on, drive); });
    const auto two = robot(k, [&](ElasticParts& p, const auto& on) {
      Body<double> rotor;
      rotor.mass = drive.motor.mass;
      rotor.com = drive.motor.com;
      const Mat3 along = drive.motor.axis * drive.motor.axis.transpose();
      rotor.inertia = drive.motor.axial_inertia * along + drive.motor.transverse_inertia * (Mat3::Identity() - along);
      p.add("rotor", on, RevoluteLink<double>{{drive.motor.axis}, rotor});
      p.add("arm", on, RevoluteLink<double>{drive.joint, drive.body});
    });
    Inputs inputs(one);
    inputs.add_wrench("load");
    Inputs full(two);
    full.add_wrench("load");
    REQUIRE(inputs.columns() == 9);  // base, motor, load, wrench
    REQUIRE(full.columns() == 10);   // base, rotor, arm, load, wrench
    const RandomState state = random_state(one, 0, random, 2);
    const Answer x = solve(one, inputs, state.q, state.qd);
    const Answer y = solve(two, full, state.q, state.qd);
    REQUIRE(x.status == Status::ok);
    REQUIRE(y.status == Status::ok);
    const double ratio = drive.motor.gear_ratio;
    const double torque =
        drive.stiffness * (state.q(2) - state.q(1) / ratio) + drive.damping * (state.qd(2) - state.qd(1) / ratio);
    Eigen::VectorXd u = Eigen::VectorXd::Zero(10);
    u(1) = torque / ratio;
    u(2) = -torque;
    Eigen::MatrixXd Bhat(4, 9);
    Bhat << y.Bhat.leftCols(2), y.Bhat.rightCols(7);
    // The rotor is light and turns fast: the condition number of M is up to 1e6.
    CHECK(relative_error(x.Bhat, Bhat) < 1e7 * eps);
    CHECK(relative_error(x.qdd0, y.qdd0 + y.Bhat * u) < 1e7 * eps);
  }
}

TEST_CASE("Under the torque that keeps the spring at rest an elastic drive is a motor-arm")
{
  Random random(23);
  for (std::uint64_t k = 0; k < 100; ++k) {
    Elastic drive = random_elastic(random);
    drive.stiffness = 1;
    drive.damping = 0;
    const double ratio = drive.motor.gear_ratio;
    const auto elastic = robot(k, [&](ElasticParts& p, const auto& on) { p.add("arm", on, drive); });
    const auto rigid = robot(k, [&](ElasticParts& p, const auto& on) {
      p.add("arm", on, MotorArm<double>{drive.joint, drive.body, drive.motor});
    });
    const RandomState state = random_state(rigid, 0, random, 2);
    Eigen::VectorXd q(4), qd(4);
    q << state.q(0), ratio * state.q(1), state.q.tail(2);
    qd << state.qd(0), ratio * state.qd(1), state.qd.tail(2);
    const auto inputs_of = [](const auto& tree) {
      Inputs inputs(tree);
      inputs.add_wrench("load");
      return inputs;
    };
    const Answer x = solve(elastic, inputs_of(elastic), q, qd);
    const Answer y = solve(rigid, inputs_of(rigid), state.q, state.qd);
    REQUIRE(x.status == Status::ok);
    REQUIRE(y.status == Status::ok);

    // Effect of 1 N m in the spring: a deflection of 1 rad, for motion at rest in free fall.
    Eigen::VectorXd stretched = q;
    stretched(1) += ratio;
    const Eigen::VectorXd effect = solve(elastic, inputs_of(elastic), stretched, qd).qdd0 - x.qdd0;
    // c q̈ = θ̈/ratio − φ̈ = 0 fixes the spring's torque for q̈₀ and for every column.
    Eigen::RowVector4d c(0, 1 / ratio, -1, 0);
    const Eigen::Matrix4d keep = Eigen::Matrix4d::Identity() - effect * (c / c.dot(effect));
    const Eigen::VectorXd qdd0 = keep * x.qdd0;
    const Eigen::MatrixXd Bhat = keep * x.Bhat;
    Eigen::MatrixXd arm(3, 10);
    arm << qdd0(0), Bhat.row(0), qdd0(2), Bhat.row(2), qdd0(3), Bhat.row(3);
    Eigen::MatrixXd expected(3, 10);
    expected << y.qdd0, y.Bhat;
    // `effect` is a difference of accelerations: its roundings are those of q̈₀, and M's condition number is up to 1e6.
    const double allowed = 1e7 * eps * (1 + x.qdd0.norm() / effect.norm());
    CHECK((arm - expected).norm() < allowed * (x.Bhat.norm() + x.qdd0.norm()));
  }
}

TEST_CASE("A heavy fixed link on an elastic drive, which does not take its body, beside many others")
{
  using HeavyParts = Assembly<RevoluteLink<double>, FixedLink<double>, Elastic>;
  for (std::uint64_t n = 3; n <= 12; ++n) {  // the load's rows are compressed from some n on
    Random random(n);
    HeavyParts parts;
    parts.add("arm", {}, random_elastic(random));
    FixedLink<double> load;
    load.body = random.body();
    load.body.mass *= 1000;
    load.body.inertia *= 1000;
    parts.add("load", random_attachment(random, "arm"), load);
    for (std::uint64_t i = 0; i < n; ++i) {
      parts.add("link" + std::to_string(i), random_attachment(random, "arm"),
                RevoluteLink<double>{{random.unit()}, random.body()});
    }
    const DynamicTree tree(parts);
    Inputs inputs(tree);
    inputs.add_wrench("load");
    CAPTURE(n);
    check_root(tree, inputs, random, 1e-10);
  }
}

TEST_CASE("Elastic drives in a row carry a load in square-root form")
{
  for (const double load : {1.0, 20.0, 1e3}) {
    Random random(25);
    ElasticParts parts;
    Attachment<double> on;
    for (std::size_t k = 0; k < 4; ++k) {
      const std::string name = "link" + std::to_string(k);
      Elastic drive = random_elastic(random);
      drive.body.mass = k == 3 ? load : 1;
      drive.body.inertia = drive.body.mass * Vec3(0.02, 0.03, 0.04).asDiagonal();
      parts.add(name, on, drive);
      on = random_attachment(random, name);
    }
    parts.add("hand", on, RevoluteLink<double>{{random.unit()}, random.body()});
    const DynamicTree tree(parts);
    Inputs inputs(tree);
    inputs.add_wrench("hand");
    CAPTURE(load);
    check_root(tree, inputs, random, 1e-11);
  }
}

TEST_CASE("An elastic drive refuses wrong parameters")
{
  Random random(24);
  const auto refuses = [&](auto change, const std::string& words) {
    Elastic drive = random_elastic(random);
    change(drive);
    ElasticParts parts;
    parts.add("ankle", {}, drive);
    CHECK_THROWS_WITH(DynamicTree(parts),
                      Catch::Matchers::ContainsSubstring("ankle") && Catch::Matchers::ContainsSubstring(words));
  };
  refuses([](Elastic& d) { d.stiffness = -3; }, "-3");
  refuses([](Elastic& d) { d.motor.gear_ratio = 0; }, "gear ratio");
  refuses([](Elastic& d) { d.motor.axial_inertia = 0; }, "axial inertia");
  refuses([](Elastic& d) { d.body.mass = 0; }, "mass");
}
