// PROGRAM: tests_drives
// Elastic subsystems made stiffer and stiffer move as the rigid ones do: the difference falls with 1/stiffness.
#include "catch.hpp"
#include "type_robots.hpp"

#include <iim/subsystem/elastic_motor_arm.hpp>
#include <iim/subsystem/flexible_link.hpp>

using namespace iim;
using namespace iim::test;

namespace {

using Beam = FlexibleLink<Revolute<double>, 1, 1, 0>;
using Parts = Assembly<RevoluteLink<double>, MotorArm<double>, ElasticMotorArm<double>, Beam>;
using Tree = decltype(DynamicTree(std::declval<Parts>()));

constexpr int samples = 40;

/// Coordinates at `samples` equally spaced times, one per column, under constant torques, from rest at zero; by
/// Runge–Kutta with `steps` steps between them.
Eigen::MatrixXd motion(const Tree& tree, const Eigen::Vector3d& torques, double duration, int steps)
{
  const Inputs<Tree> inputs(tree);
  REQUIRE(inputs.columns() == 3);
  Workspace ws(tree);
  const Eigen::VectorXd u = torques;
  Eigen::VectorXd q = Eigen::VectorXd::Zero(tree.n_q()), v = q;
  Eigen::MatrixXd path(tree.n_q(), samples);
  const double h = duration / samples / steps;
  const auto rate = [&](const Eigen::VectorXd& at, const Eigen::VectorXd& speed) -> Eigen::VectorXd {
    return forward_dynamics(at, speed, inputs, u, ws).qdd;
  };
  for (Index sample = 0; sample < samples; ++sample) {
    for (int k = 0; k < steps; ++k) {
      const Eigen::VectorXd a1 = rate(q, v);
      const Eigen::VectorXd v2 = v + h / 2 * a1, a2 = rate(q + h / 2 * v, v2);
      const Eigen::VectorXd v3 = v + h / 2 * a2, a3 = rate(q + h / 2 * v2, v3);
      const Eigen::VectorXd v4 = v + h * a3, a4 = rate(q + h * v3, v4);
      q += h / 6 * (v + 2 * v2 + 2 * v3 + v4);
      v += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
    }
    path.col(sample) = q;
  }
  return path;
}

/// base – `part` – load under gravity and torques.
template <class Part>
Tree robot(std::uint64_t seed, const Part& part, const Vec3& outlet)
{
  Random random(seed);
  Parts parts;
  const RevoluteLink<double> base{{random.unit()}, random.body()}, load{{random.unit()}, random.body()};
  const Attachment<double> on = random_attachment(random, "base");
  parts.add("base", {}, base).add("part", on, part).add("load", {"part", random.rotation(), outlet, 0}, load);
  return Tree(parts);
}

/// Compares base, joint and load (their rows) for stiffnesses 1, 10 and 100; `natural` [rad/s]: quickest oscillation
/// for 1.
template <class Make>
void converges(const Tree& rigid, const Make& make, const std::array<Index, 3>& rows, double duration, double natural)
{
  const Eigen::Vector3d torques(3, 0.4, -2);
  const Eigen::MatrixXd expected = motion(rigid, torques, duration, 10);
  const double size = expected.cwiseAbs().maxCoeff();
  REQUIRE(size > 1e-2);  // it moves
  std::array<double, 3> error;
  for (std::size_t k = 0; k < 3; ++k) {
    const double stiffer = std::pow(10.0, static_cast<double>(k));
    // Twenty steps in a radian of the quickest oscillation: their own error is 1e-6 of what is to be seen.
    const int steps = 10 + static_cast<int>(20 * duration / samples * natural * std::sqrt(stiffer));
    const Eigen::MatrixXd path = motion(make(stiffer), torques, duration, steps);
    Eigen::MatrixXd common(3, samples);
    common << path.row(rows[0]), path.row(rows[1]), path.row(rows[2]);
    error[k] = (common - expected).cwiseAbs().maxCoeff();
  }
  INFO("largest differences " << error[0] << ", " << error[1] << ", " << error[2] << " of " << size);
  // The motion swings about one that is 1/stiffness off. Forty samples may miss the top of a swing: not a third of it.
  for (std::size_t k = 1; k < 3; ++k) {
    CHECK(error[k] < 0.15 * error[k - 1]);
    CHECK(error[k] > 0.05 * error[k - 1]);
  }
  CHECK(error[2] < 1e-3 * size);  // and it is not stuck: 1/100 of a deflection of at most a tenth
}

}  // namespace

TEST_CASE("An elastic motor-arm with a stiff spring moves as a motor-arm")
{
  for (std::uint64_t seed = 101; seed <= 105; ++seed) {
    Random random(seed);
    const Motor<double> motor{20, 5e-3, random.unit(), 0.4, Vec3::Zero(), 5e-3, false};
    const Revolute<double> joint{random.unit()};
    const Body<double> body{2, random.vector(0.3), Vec3(0.1, 0.12, 0.15).asDiagonal(), false};
    INFO("seed " << seed);
    // The rotor is 2 kg m² at the joint, the arm down to 0.1: up to √(1e5/0.1) rad/s.
    converges(
        robot(seed, MotorArm<double>{joint, body, motor}, Vec3(0.2, 0.1, 0)),
        [&](double stiffer) {
          return robot(seed, ElasticMotorArm<double>{joint, body, motor, 1e5 * stiffer, 0}, Vec3(0.2, 0.1, 0));
        },
        {0, 2, 3}, 0.1, 1000);
  }
}

TEST_CASE("A flexible link of high stiffness moves as a rigid link")
{
  for (std::uint64_t seed = 111; seed <= 115; ++seed) {
    Random random(seed);
    Beam beam;
    beam.joint.axis = random.unit();
    beam.length = 0.6;
    beam.mass_per_length = 2;
    beam.rotary_y = beam.rotary_z = 1e-3;
    Body<double> rod{1.2, Vec3(0.3, 0, 0), Mat3::Zero(), false};
    const double across = rod.mass * 0.36 / 12;
    rod.inertia.diagonal() << 0.6 * 2e-3, 0.6e-3 + across, 0.6e-3 + across;
    INFO("seed " << seed);
    // 3.5 √(EI/ρAL⁴) = 500 rad/s and less for the load.
    converges(
        robot(seed, RevoluteLink<double>{beam.joint, rod}, Vec3(0.6, 0, 0)),
        [&](double stiffer) {
          beam.bending_y = beam.bending_z = 1e4 * stiffer;
          return robot(seed, beam, Vec3::Zero());
        },
        {0, 1, 4}, 0.1, 1000);
  }
}
