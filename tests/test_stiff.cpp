// PROGRAM: tests_extreme
// RUNS: optimised
// Stiff machines over seconds: the linearly implicit step where an explicit one blows up.
#include "catch.hpp"

#include <iim/iim.hpp>
#include <iim/subsystem/elastic_motor_arm.hpp>
#include <iim/subsystem/sprung.hpp>

#include <cmath>
#include <limits>

using namespace iim;
using Vec = Eigen::VectorXd;

namespace {

using Drive = ElasticMotorArm<double>;
using Link = Sprung<RevoluteLink<double>>;

Body<double> rod(double mass, double length)
{
  Body<double> body;
  body.mass = mass;
  body.com = Eigen::Vector3d(length / 2, 0, 0);
  body.inertia.diagonal() << 1e-3 * mass, mass * length * length / 12, mass * length * length / 12;
  return body;
}

/// Three links of 0.4 m on elastic drives, gear 100, that hang from x: the drives' springs of `stiffness` N m/rad.
auto elastic_arm(double stiffness)
{
  Assembly<Drive> arm;
  std::string parent = "world";
  for (int k = 0; k < 3; ++k) {
    Drive drive;
    drive.joint.axis = Eigen::Vector3d::UnitY();
    drive.body = rod(3.0 - k, 0.4);
    drive.motor.gear_ratio = 100;
    drive.motor.axial_inertia = 1e-5;
    drive.motor.axis = Eigen::Vector3d::UnitY();
    drive.stiffness = stiffness;
    const std::string name = "joint " + std::to_string(k);
    arm.add(name, {parent, Eigen::Matrix3d::Identity(), Eigen::Vector3d(k == 0 ? 0 : 0.4, 0, 0)}, drive);
    parent = name;
  }
  return DynamicTree(arm);
}

/// The same arm with rigid drives.
auto rigid_arm()
{
  Assembly<MotorArm<double>> arm;
  elastic_arm(1).outward([&]<class N, class S>(const N& node, const S& drive) {
    MotorArm<double> rigid;
    rigid.joint = drive.joint;
    rigid.body = drive.body;
    rigid.motor = drive.motor;
    arm.add("joint " + std::to_string(node.index),
            {node.parent < 0 ? "world" : "joint " + std::to_string(node.parent), Eigen::Matrix3d::Identity(),
             Eigen::Vector3d(node.parent < 0 ? 0 : 0.4, 0, 0)},
            rigid);
  });
  return DynamicTree(arm);
}

/// A chain of links that hang from x in the plane, each joint with a spring and a strong damper.
auto damped_chain(int n, double stiffness, double damping)
{
  Assembly<Link> chain;
  std::string parent = "world";
  for (int k = 0; k < n; ++k) {
    Link link;
    link.joint.axis = Eigen::Vector3d::UnitY();
    link.body = rod(0.2, 0.1);
    link.stiffness(0) = stiffness;
    link.damping(0) = damping;
    link.rest(0) = 0.02;
    const std::string name = "link " + std::to_string(k);
    chain.add(name, {parent, Eigen::Matrix3d::Identity(), Eigen::Vector3d(k == 0 ? 0 : 0.1, 0, 0)}, link);
    parent = name;
  }
  return DynamicTree(chain);
}

struct State {
  Vec q, qd;
};

template <class Tree>
State at_rest(const Tree& tree, double angle)
{
  State s{Vec::Constant(tree.n_q(), 0), Vec::Zero(tree.n_v())};
  tree.outward([&]<class N, class S>(const N& node, const S& part) {
    if constexpr (std::is_same_v<S, Drive>) {
      s.q(node.q) = angle * part.motor.gear_ratio;
      s.q(node.q + 1) = angle;
    } else {
      s.q(node.q) = angle;
    }
  });
  return s;
}

/// Implicit steps of h up to T.
template <Update update = Update::projected, class Tree>
State implicit_run(const Tree& tree, State s, double h, double T)
{
  Workspace<Tree, update> ws(tree);
  const int steps = static_cast<int>(std::lround(T / h));
  for (int k = 0; k < steps; ++k) {
    const auto fd = implicit_step(s.q, s.qd, h, ws);
    REQUIRE(fd.ok());
    s.qd += h * fd.qdd0();
    s.q += h * s.qd;
  }
  return s;
}

/// The same with all forces at the beginning of the step. Stops when the speed is beyond all reason.
template <class Tree>
State explicit_run(const Tree& tree, State s, double h, double T)
{
  Workspace<Tree> ws(tree);
  const int steps = static_cast<int>(std::lround(T / h));
  for (int k = 0; k < steps && s.qd.norm() < 1e9; ++k) {
    const auto fd = forward_dynamics(s.q, s.qd, ws);
    if (!fd.ok()) { break; }
    s.qd += h * fd.qdd0();
    s.q += h * s.qd;
  }
  return s;
}

/// Runge and Kutta's step of fourth order, for coordinates that are the integrals of the velocities.
template <class Tree>
State runge_kutta_run(const Tree& tree, State s, double h, double T)
{
  Workspace ws(tree);
  const int steps = static_cast<int>(std::lround(T / h));
  const auto f = [&](const Vec& q, const Vec& qd) { return Vec(forward_dynamics(q, qd, ws).qdd0()); };
  for (int k = 0; k < steps; ++k) {
    const Vec a1 = f(s.q, s.qd);
    const Vec a2 = f(s.q + h / 2 * s.qd, s.qd + h / 2 * a1);
    const Vec a3 = f(s.q + h / 2 * s.qd + h * h / 4 * a1, s.qd + h / 2 * a2);
    const Vec a4 = f(s.q + h * s.qd + h * h / 2 * a2, s.qd + h * a3);
    s.q += h * s.qd + h * h / 6 * (a1 + a2 + a3);
    s.qd += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
  }
  return s;
}

/// Kinetic energy and weight, planar: link k turns by φ_k = Σ q, its rotor at its own rate beside the inlet's turning.
double energy_of_arm(const State& s)
{
  double phi = 0, phi_dot = 0, energy = 0;
  Eigen::Vector2d x(0, 0), v(0, 0);
  for (int k = 0; k < 3; ++k) {
    const double m = 3.0 - k, l = 0.4, J = 1e-5;
    const double rotor = phi_dot + s.qd(2 * k);
    energy += J * rotor * rotor / 2;
    phi += s.q(2 * k + 1);
    phi_dot += s.qd(2 * k + 1);
    const Eigen::Vector2d along(std::cos(phi), -std::sin(phi));
    const Eigen::Vector2d across(-std::sin(phi), -std::cos(phi));
    const Eigen::Vector2d v_c = v + l / 2 * phi_dot * across;
    energy += m * v_c.squaredNorm() / 2 + m * l * l / 24 * phi_dot * phi_dot;
    energy += m * 9.81 * (x + l / 2 * along).y();
    x += l * along;
    v += l * phi_dot * across;
  }
  return energy;
}

}  // namespace

TEST_CASE("an arm with elastic drives of 1e9 N m/rad swings for ten seconds at 1 ms")
{
  const auto arm = elastic_arm(1e9);
  const State start = at_rest(arm, 1.2);
  CHECK(!(explicit_run(arm, start, 1e-3, 10).qd.norm() < 1e6));

  const State end = implicit_run(arm, start, 1e-3, 10);
  const double fall = 5.0;  // J between the start and the lowest point, roughly
  CHECK(std::abs(energy_of_arm(end) - energy_of_arm(start)) < 0.1 * fall);
  for (int k = 0; k < 3; ++k) {
    CHECK(std::abs(end.q(2 * k) / 100 - end.q(2 * k + 1)) < 1e-6);  // some 10 N m on 1e9 N m/rad
  }
}

TEST_CASE("the stiff arm moves as the rigid one does, to first order in the step")
{
  const auto arm = elastic_arm(1e9);
  const auto rigid = rigid_arm();
  const State start = at_rest(arm, 1.2);
  const State reference = runge_kutta_run(rigid, at_rest(rigid, 1.2), 1e-3, 1.0);
  const auto error = [&](double h) {
    const State end = implicit_run(arm, start, h, 1.0);
    Vec joints(3);
    joints << end.q(1), end.q(3), end.q(5);
    return (joints - reference.q).norm();
  };
  const double e1 = error(1e-3), e2 = error(5e-4), e4 = error(2.5e-4);
  INFO("errors " << e1 << " " << e2 << " " << e4);
  CHECK(e1 < 0.01);
  CHECK(std::abs(e1 / e2 - 2) < 0.2);
  CHECK(std::abs(e2 / e4 - 2) < 0.1);
}

TEST_CASE("a chain with strong dampers settles, to first order in the step")
{
  const auto chain = damped_chain(8, 200, 2);
  const State start = at_rest(chain, 0.1);
  CHECK(!(explicit_run(chain, start, 1e-3, 10).qd.norm() < 1e6));

  const State reference = runge_kutta_run(chain, start, 2e-6, 0.2);
  const auto error = [&](double h) { return (implicit_run(chain, start, h, 0.2).q - reference.q).norm(); };
  const double e1 = error(1e-3), e2 = error(5e-4), e4 = error(2.5e-4);
  INFO("errors " << e1 << " " << e2 << " " << e4);
  CHECK(e1 < 0.01 * (start.q - reference.q).norm());
  CHECK(std::abs(e1 / e2 - 2) < 0.2);
  CHECK(std::abs(e2 / e4 - 2) < 0.1);

  // At rest in the end, where springs carry the weight: torque K (q − rest) = weight's moment about each joint.
  const State end = implicit_run(chain, start, 1e-3, 90);
  CHECK(end.qd.norm() < 1e-9);
  double phi = 0;
  Eigen::ArrayXd lever(8), at(8);
  for (int k = 0; k < 8; ++k) {
    phi += end.q(k);
    at(k) = (k == 0 ? 0 : at(k - 1) + lever(k - 1));
    lever(k) = 0.1 * std::cos(phi);
  }
  for (int k = 0; k < 8; ++k) {
    double moment = 0;
    for (int j = k; j < 8; ++j) { moment += 0.2 * 9.81 * (at(j) + lever(j) / 2 - at(k)); }
    CHECK(std::abs(200 * (end.q(k) - 0.02) - moment) < 1e-9);
  }
}

TEST_CASE("the square-root form takes the stiffest springs and gives what the projected form gives")
{
  const auto arm = elastic_arm(1e9);
  const State start = at_rest(arm, 1.2);
  const State a = implicit_run<Update::square_root>(arm, start, 1e-3, 0.1);
  const State b = implicit_run<Update::projected>(arm, start, 1e-3, 0.1);
  CHECK((a.q - b.q).norm() < 1e-7 * a.q.norm());
}
