// REQUIRES: mujoco
// PROGRAM: tests_loops
// Parallel ankle and MuJoCo: rods and rotors as bodies of their own, held by its equality constraints.
#include "catch.hpp"
#include "type_mujoco.hpp"
#include "worst.hpp"

#include <iim/subsystem/parallel_ankle.hpp>

namespace test_type_mujoco_ankle {

using namespace iim;
using namespace iim::test;

namespace {

constexpr int states = 100;
constexpr std::uint64_t seed = 84;

ParallelAnkle<double> random_ankle(Random& random)
{
  ParallelAnkle<double> ankle;
  for (std::size_t k = 0; k < 2; ++k) {
    const double y = k == 0 ? 0.04 : -0.04;
    auto& r = ankle.mechanism.rod[k];
    r.hinge = Vec3(0.01, y, k == 0 ? 0.25 : 0.18) + random.vector(0.01);
    r.axis = (Vec3::UnitY() + random.vector(0.1)).normalized();
    const Vec3 back = -Vec3::UnitX();
    r.crank = 0.07 * (back - r.axis * r.axis.dot(back)).normalized();
    r.foot = Vec3(-0.05, y, 0.01) + random.vector(0.01);
    r.rod = (r.hinge + r.crank - r.foot).norm();  // so that all angles are zero together
    r.side = 1;
    r.rod_mass = random.uniform(0.1, 0.4);
    r.gear_ratio = random.uniform(5, 10);
    r.rotor_inertia = random.uniform(1e-4, 1e-3);
  }
  for (std::size_t k = 0; k < 3; ++k) { ankle.body[k] = random.body(); }
  return ankle;
}

}  // namespace

TEST_CASE("A parallel ankle is what MuJoCo has for foot, cranks, rotors and rods with connect and joint constraints")
{
  INFO("seed " << seed);
  Random random(seed);
  double worst = 0;
  for (int k = 0; k < states; ++k) {
    const ParallelAnkle<double> ankle = random_ankle(random);
    const auto& m = ankle.mechanism;
    const Body<double> shank = random.body();
    const RevoluteLink<double> load{{random.unit()}, random.body()};
    const Vec3 base_axis = random.unit(), gravity = random.vector(10);
    const Attachment<double> on = random_attachment(random, "base"), load_on = random_attachment(random, "foot");
    const Placement<double> at{on.R, on.p};

    // A rotor of 0.3 kg, a little thicker than the disc that turns in the ankle: what does not spin is of the shank
    // there.
    FrameMass<double> whole;
    whole.add(shank);
    std::vector<MujocoPart> parts{{"base", "", {}, {{"hinge", base_axis}}, shank},
                                  {"foot", "base", at, {{"hinge", m.first}, {"hinge", m.second}}, ankle.body[0]},
                                  {"load", "foot", {load_on.R, load_on.p}, {{"hinge", load.joint.axis}}, load.body}};
    std::vector<Connection> loops;
    std::vector<Tie> ties;
    for (std::size_t j = 0; j < 2; ++j) {
      const auto& r = m.rod[j];
      const std::string number = std::to_string(j), crank = "crank" + number, rod = "rod" + number;
      const Mat3 along = r.axis * r.axis.transpose(), across_axis = r.rotor_inertia * (Mat3::Identity() - along);
      const Placement<double> hinge = at * Placement<double>{Mat3::Identity(), r.hinge};
      whole.add({0.3, hinge.p, on.R * (0.1 * across_axis) * on.R.transpose(), false});
      parts.push_back({crank, "base", hinge, {{"hinge", r.axis}}, ankle.body[j + 1]});
      parts.push_back({"rotor" + number,
                       "base",
                       hinge,
                       {{"hinge", r.axis}},
                       {0.3, Vec3::Zero(), r.rotor_inertia * along + 0.6 * across_axis, false}});
      // The rod along z of its frame at zero, on a universal joint; MuJoCo wants it to have some inertia about itself.
      const Mat3 turn =
          Eigen::Quaterniond::FromTwoVectors(Vec3::UnitZ(), r.foot - r.hinge - r.crank).toRotationMatrix();
      const double across = r.rod_mass * r.rod * r.rod / 12;
      parts.push_back({rod,
                       crank,
                       {turn, r.crank},
                       {{"hinge", Vec3::UnitX()}, {"hinge", Vec3::UnitY()}},
                       {r.rod_mass, Vec3(0, 0, r.rod / 2), Vec3(across, across, 1e-14).asDiagonal(), false}});
      loops.push_back({rod, Vec3(0, 0, r.rod), "foot", r.foot});
      ties.push_back({"rotor" + number, 0, crank, 0, r.gear_ratio});
    }
    MujocoRobot robot(parts, loops, ties, gravity);

    Assembly<RevoluteLink<double>, ParallelAnkle<double>> assembly;
    const Body<double> base{whole.mass, whole.com, whole.central_inertia, false};
    assembly.add("base", {}, RevoluteLink<double>{{base_axis}, base}).add("foot", on, ankle).add("load", load_on, load);
    assembly.set_gravity(gravity);
    const DynamicTree tree(assembly);
    Inputs inputs(tree);
    inputs.add_wrench("load");
    Eigen::Vector4d q, qd;
    for (Index j = 0; j < 4; ++j) {
      q(j) = random.uniform(-0.5, 0.5);  // rods and cranks stay 30° off their dead centres
      qd(j) = random.uniform(-2, 2);
    }
    const Answer answer = test::solve(tree, inputs, q, qd);
    REQUIRE(answer.status == Status::ok);

    Eigen::VectorXd x = Eigen::VectorXd::Zero(robot.n_q()), xd = Eigen::VectorXd::Zero(robot.n_v());
    std::vector<Index> dependent;
    for (const std::string number : {"0", "1"}) {
      for (const char* body : {"crank", "rotor", "rod"}) {
        for (Index j = 0; j < robot.count_of(body + number); ++j) {
          dependent.push_back(robot.v_of(body + number) + j);
        }
      }
    }
    // From zero in steps, so that Newton stays on the branch.
    for (int step = 1; step <= 10; ++step) {
      const double part = step / 10.0;
      x(robot.q_of("base")) = part * q(0);
      x.segment<2>(robot.q_of("foot")) = part * q.segment<2>(1);
      x(robot.q_of("load")) = part * q(3);
      xd(robot.v_of("base")) = qd(0);
      xd.segment<2>(robot.v_of("foot")) = qd.segment<2>(1);
      xd(robot.v_of("load")) = qd(3);
      REQUIRE(robot.close(x, xd, dependent));
    }
    Eigen::MatrixXd B = Eigen::MatrixXd::Zero(robot.n_v(), 10);
    B(robot.v_of("base"), 0) = B(robot.v_of("rotor0"), 1) = B(robot.v_of("rotor1"), 2) = B(robot.v_of("load"), 3) = 1;
    B.rightCols(6) = robot.wrench("load");
    const std::vector<std::string> names{"base", "foot", "load"};
    keep_worst(worst, relative_error(rows_of(tree, answer, names), robot.rows_of(robot.solve(x, xd, B), names)));
  }
  INFO("largest difference " << worst);
  // The condition number of M with rods and rotors that are light is up to 1e5.
  CHECK(worst < 1e5 * eps);
}

}  // namespace test_type_mujoco_ankle
