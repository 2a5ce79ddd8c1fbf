// PROGRAM: tests_drives
// Coupled drives: the laws, and rotors as bodies of their own, tied to the joints by a constraint.
#include "catch.hpp"
#include "type_robots.hpp"

#include <iim/law_suite.hpp>
#include <iim/subsystem/coupled_drive.hpp>
#include <iim/subsystem/parallel_ankle.hpp>
#include <iim/subsystem_matrices.hpp>

using namespace iim;
using namespace iim::test;

namespace {

using Drive = DifferentialDrive<double>;

/// Motor 0 on the inlet, motor 1 on the first frame, the transmission any matrix.
Drive random_drive(Random& random)
{
  Drive drive;
  auto& m = drive.mechanism;
  for (std::size_t k = 0; k < 2; ++k) {
    m.axis[k] = random.axis();
    m.offset[k] = random.vector(0.3);
    drive.body[k] = random.body();
    m.motor[k] = random.motor();
    m.motor[k].armature = false;
    m.motor[k].mass = random.uniform(0.1, 1);
    m.motor[k].com = random.vector(0.2);
    m.motor[k].transverse_inertia = m.motor[k].axial_inertia;
  }
  m.carrier = {-1, 0};
  m.transmission << random.uniform(-20, 20), random.uniform(-20, 20), random.uniform(-20, 20), random.uniform(-20, 20);
  return drive;
}

Body<double> solid(const Motor<double>& motor)
{
  const Mat3 along = motor.axis * motor.axis.transpose();
  // The tree's joint is at the rotor's centre.
  return {motor.mass, Vec3::Zero(), motor.axial_inertia * along + motor.transverse_inertia * (Mat3::Identity() - along),
          false};
}

}  // namespace

TEST_CASE("A coupled drive obeys the laws")
{
  Random random(31);
  const LawReport report = check_laws(random_drive(random));
  INFO(report.text());
  CHECK(report.ok());
}

TEST_CASE("A coupled drive is links and rotors tied by its transmission")
{
  Random random(32);
  for (int k = 0; k < 100; ++k) {
    const Drive drive = random_drive(random);
    const auto& m = drive.mechanism;
    using Parts = Assembly<RevoluteLink<double>, Drive>;
    Parts one, all;
    const RevoluteLink<double> base{{random.unit()}, random.body()}, load{{random.unit()}, random.body()};
    const Attachment<double> on = random_attachment(random, "base");
    const Attachment<double> load_on = random_attachment(random, "", 0);
    one.add("base", {}, base).add("drive", on, drive);
    one.add("load", {"drive", load_on.R, load_on.p, 1}, load);
    // base, rotor0, link0, rotor1, link1, load
    all.add("base", {}, base);
    all.add("rotor0", {"base", on.R, on.R * m.motor[0].com + on.p, 0},
            RevoluteLink<double>{{m.motor[0].axis}, solid(m.motor[0])});
    all.add("link0", on, RevoluteLink<double>{{m.axis[0]}, drive.body[0]});
    all.add("rotor1", {"link0", Mat3::Identity(), m.motor[1].com, 0},
            RevoluteLink<double>{{m.motor[1].axis}, solid(m.motor[1])});
    all.add("link1", {"link0", Mat3::Identity(), m.offset[1], 0}, RevoluteLink<double>{{m.axis[1]}, drive.body[1]});
    all.add("load", {"link1", load_on.R, load_on.p, 0}, load);
    const DynamicTree a(one), b(all);
    const RandomState state = random_state(a, 0, random, 2);

    // q̇_all = J q̇; the motors' torques act on the rotors.
    Eigen::Matrix<double, 6, 4> J = Eigen::Matrix<double, 6, 4>::Zero();
    J(0, 0) = J(2, 1) = J(4, 2) = J(5, 3) = 1;
    J.block<1, 2>(1, 1) = m.transmission.row(0);
    J.block<1, 2>(3, 1) = m.transmission.row(1);
    const Answer free = solve(b, Inputs(b), J * state.q, J * state.qd);
    REQUIRE(free.status == Status::ok);
    const Eigen::MatrixXd M = free.Bhat.inverse();
    const Eigen::MatrixXd reduced = J.transpose() * M * J;
    Eigen::MatrixXd B = Eigen::MatrixXd::Zero(6, 4);
    B(0, 0) = B(1, 1) = B(3, 2) = B(5, 3) = 1;
    const Answer x = solve(a, Inputs(a), state.q, state.qd);
    REQUIRE(x.status == Status::ok);
    // The rotors are light and turn fast: the condition number of the free M is up to 1e6.
    CHECK(relative_error(x.Bhat, reduced.llt().solve(J.transpose() * B)) < 1e7 * eps);
    CHECK(relative_error(x.qdd0, reduced.llt().solve(J.transpose() * (M * free.qdd0))) < 1e7 * eps);
  }
}

TEST_CASE("Belt and differential transmissions turn what they should")
{
  // A belt of equal pulleys holds the second link's direction in the inlet while only the first motor turns.
  const Eigen::Vector2d translating = belt_transmission(5.0, 8.0).inverse() * Eigen::Vector2d(5, 0);
  CHECK((translating - Eigen::Vector2d(1, -1)).norm() < 4 * eps);
  const Eigen::Matrix2d both = differential_transmission(10.0, 20.0).inverse();
  CHECK((both * Eigen::Vector2d(1, 1) - Eigen::Vector2d(0.1, 0)).norm() < 4 * eps);
  CHECK((both * Eigen::Vector2d(1, -1) - Eigen::Vector2d(0, 0.05)).norm() < 4 * eps);

  Random random(33);
  Drive drive = random_drive(random);
  drive.mechanism.carrier = {-1, 2};
  Assembly<Drive> parts;
  parts.add("hip", {}, drive);
  CHECK_THROWS_WITH(DynamicTree(parts),
                    Catch::Matchers::ContainsSubstring("hip") && Catch::Matchers::ContainsSubstring("frame 2"));

  Drive idle = random_drive(random);
  idle.mechanism.transmission.row(1).setZero();
  Assembly<Drive> without_work;
  without_work.add("hip", {}, idle);
  CHECK_THROWS_WITH(DynamicTree(without_work),
                    Catch::Matchers::ContainsSubstring("'hip': rotor 1 turns with no joint"));

  Drive needle = random_drive(random);
  needle.mechanism.motor[1].mass = 1;
  needle.mechanism.motor[1].axial_inertia = 3;
  needle.mechanism.motor[1].transverse_inertia = 1;
  Assembly<Drive> impossible;
  impossible.add("hip", {}, needle);
  CHECK_THROWS_WITH(DynamicTree(impossible), Catch::Matchers::ContainsSubstring("'hip': rotor 1: axial inertia"));
}

TEST_CASE("Motors on a mechanism that has bodies of its own leave it these, and an armature the frames their inertia")
{
  Random random(34);
  using Ankle = Compound<Driven<ParallelAnkleLinkage<double>, 2>>;
  Ankle ankle;
  for (std::size_t k = 0; k < 2; ++k) {
    auto& r = ankle.mechanism.rod[k];
    const double y = k == 0 ? 0.04 : -0.04;
    r.hinge = Vec3(0.01, y, 0.2);
    r.crank = Vec3(-0.07, 0, 0);
    r.foot = Vec3(-0.05, y, 0.01);
    r.rod = (r.hinge + r.crank - r.foot).norm();
    r.rod_mass = 0.3;
    ankle.mechanism.motor[k] = random.motor(0);
    ankle.mechanism.motor[k].mass = 0.5;
    ankle.mechanism.motor[k].transverse_inertia = ankle.mechanism.motor[k].axial_inertia;
  }
  ankle.mechanism.transmission << 10, 5, 10, -5;
  ankle.body[0] = random.body();
  Assembly<Ankle> parts;
  const DynamicTree tree(parts.add("ankle", {}, ankle));
  double mass = tree.inlet_mass(0).mass;
  for (Index f = 0; f < tree.n_frames(); ++f) { mass += tree.frame_mass(f).mass; }
  CHECK(std::abs(mass - (ankle.body[0].mass + 2 * 0.3 + 2 * 0.5)) < 16 * eps);

  // About the joints' velocities alone: M̄ of a drive with armatures, less that of the same without their inertia.
  Drive drive = random_drive(random), light;
  for (Motor<double>& motor : drive.mechanism.motor) {
    motor.armature = true;
    motor.mass = 0;
  }
  light = drive;
  Eigen::Matrix2d J = Eigen::Matrix2d::Zero();
  for (std::size_t k = 0; k < 2; ++k) {
    const Index at = static_cast<Index>(k);
    J(at, at) = drive.mechanism.motor[k].axial_inertia = 1e-2;
    light.mechanism.motor[k].axial_inertia = 0;
  }
  const auto Mbar = [&](const Drive& part) {
    Assembly<Drive> one;
    const DynamicTree with_part(one.add("drive", {}, part));
    Workspace ws(with_part);
    const Eigen::Vector2d q(0.3, -0.4), qd(1, 2);
    return Eigen::MatrixXd(subsystem_matrices(forward_dynamics(q, qd, ws), 0).Mbar);
  };
  Eigen::MatrixXd added = Eigen::MatrixXd::Zero(8, 8);
  added.bottomRightCorner(2, 2) = drive.mechanism.transmission.transpose() * J * drive.mechanism.transmission;
  CHECK(relative_error(Mbar(drive) - Mbar(light), added) < 1e3 * eps);
}
