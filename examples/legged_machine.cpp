// A legged robot as it is built: elastic drives at the hips, four-bar knees, ankles on push-rods, eight contact points.
// Every method computes q̈₀ and B̂ of it; the table shows how far they are apart and what they cost.
#include <iim/global_inverse.hpp>
#include <iim/iim.hpp>
#include <iim/recursive_inverse.hpp>
#include <iim/subsystem/elastic_motor_arm.hpp>
#include <iim/subsystem/four_bar.hpp>
#include <iim/subsystem/parallel_ankle.hpp>
#include <iim/unit_force.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <random>
#include <string>
#include <utility>
#include <vector>

using iim::Body, iim::Vector3;

namespace {

using Robot = iim::Assembly<iim::FloatingBase<double>, iim::ElasticMotorArm<double>, iim::FourBar<double>,
                            iim::ParallelAnkle<double>>;

Body<double> body(double mass, const Vector3<double>& com, const Vector3<double>& moments)
{
  Body<double> b{mass, com, {}, false};
  b.inertia = moments.asDiagonal();
  return b;
}

iim::ElasticMotorArm<double> hip(const Vector3<double>& axis, const Body<double>& link)
{
  iim::ElasticMotorArm<double> arm;
  arm.joint.axis = axis;
  arm.body = link;
  arm.motor.gear_ratio = 50;
  arm.motor.axial_inertia = 2e-5;
  arm.motor.axis = axis;
  arm.stiffness = 400;
  arm.damping = 0.5;
  return arm;
}

/// Motor at the hip end of the thigh, coupler along it, shank on the rocker (outlet 2).
iim::FourBar<double> knee()
{
  iim::FourBar<double> bars;
  bars.mechanism.plane = {Vector3<double>::UnitY(), Vector3<double>::UnitX()};  // its y points down
  bars.mechanism.ground = {0.0, 0.3};
  bars.mechanism.crank = 0.05;
  bars.mechanism.rocker = 0.06;
  bars.mechanism.coupler = std::hypot(0.01, 0.3);  // crank and shank at zero together
  bars.body[0] = body(0.2, {0.02, 0, 0}, {1e-4, 2e-4, 2e-4});
  bars.body[1] = body(0.3, {0.15, 0, 0}, {1e-4, 2.5e-3, 2.5e-3});
  bars.body[2] = body(2.0, {0, 0, -0.17}, {0.02, 0.02, 2e-3});
  return bars;
}

iim::ParallelAnkle<double> ankle()
{
  iim::ParallelAnkle<double> a;
  for (std::size_t k = 0; k < 2; ++k) {
    iim::PushRod<double>& rod = a.mechanism.rod[k];
    const double y = k == 0 ? 0.04 : -0.04;
    rod.hinge = {0.01, y, k == 0 ? 0.25 : 0.18};
    rod.crank = {-0.07, 0, 0};
    rod.foot = {-0.05, y, 0.01};
    rod.rod = (rod.hinge + rod.crank - rod.foot).norm();
    rod.side = 1;
    rod.rod_mass = 0.15;
    rod.gear_ratio = 9;
    rod.rotor_inertia = 1e-4;
    a.body[k + 1] = body(0.1, {-0.02, 0, 0}, {5e-5, 1e-4, 1e-4});
  }
  a.body[0] = body(0.9, {0.03, 0, -0.04}, {1.2e-3, 3e-3, 3.5e-3});
  return a;
}

Robot legged_machine()
{
  Robot robot;
  robot.add("torso", {}, iim::FloatingBase<double>{body(20, {0, 0, 0.1}, {0.4, 0.35, 0.2})});
  for (const double side : {1.0, -1.0}) {
    const std::string leg = side > 0 ? "left_" : "right_";
    const auto on = [&](const std::string& parent, const Vector3<double>& p, int outlet = 0) {
      return iim::Attachment<double>{parent, iim::Matrix3<double>::Identity(), p, outlet};
    };
    robot.add(leg + "roll", on("torso", {0, side * 0.1, -0.1}),
              hip(Vector3<double>::UnitX(), body(0.8, {0, 0, -0.03}, {1.5e-3, 1.5e-3, 1e-3})));
    robot.add(leg + "pitch", on(leg + "roll", {0, 0, -0.04}),
              hip(Vector3<double>::UnitY(), body(3, {0.01, 0, -0.16}, {0.04, 0.04, 6e-3})));
    robot.add(leg + "knee", on(leg + "pitch", {0, 0, -0.05}), knee());
    robot.add(leg + "ankle", on(leg + "knee", {0, 0, -0.38}, 2), ankle());
    for (const double x : {-0.07, 0.15}) {
      for (const double y : {-0.04, 0.04}) {
        robot.add_frame(leg + (x < 0 ? "heel_" : "toe_") + (y < 0 ? "right" : "left"), on(leg + "ankle", {x, y, -0.06}));
      }
    }
  }
  return robot;
}

struct Measured {
  const char* name;
  Eigen::VectorXd qdd0;
  Eigen::MatrixXd Bhat;
  double microseconds;
};

template <class Tree, class Method, class Workspace>
Measured measure(const char* name, Method method, Workspace& ws, const std::vector<Eigen::VectorXd>& q,
                 const std::vector<Eigen::VectorXd>& qd)
{
  Measured m{name, {}, {}, 1e9};
  bool ok = true;
  for (int trial = 0; trial < 20; ++trial) {
    const auto begin = std::chrono::steady_clock::now();
    for (std::size_t k = q.size(); k-- > 0;) {
      const auto result = method(iim::forward_dynamics(q[k], qd[k], ws));
      ok = ok && result.ok();
      if (k == 0) {
        m.qdd0 = result.qdd0;
        m.Bhat = result.Bhat;
      }
    }
    const std::chrono::duration<double, std::micro> time = std::chrono::steady_clock::now() - begin;
    m.microseconds = std::min(m.microseconds, time.count() / static_cast<double>(q.size()));
  }
  if (!ok) { m.qdd0.setConstant(std::nan("")); }
  return m;
}

}  // namespace

int main()
{
  const iim::DynamicTree tree(legged_machine());
  using Tree = std::remove_const_t<decltype(tree)>;
  iim::Inputs<Tree> inputs(tree);
  for (const std::string leg : {"left_", "right_"}) {
    for (const char* point : {"heel_right", "heel_left", "toe_right", "toe_left"}) { inputs.add_force(leg + point); }
  }
  iim::Workspace ws(tree);

  std::mt19937_64 bits(7);
  const auto uniform = [&](double size) { return size * (static_cast<double>(bits() >> 11) * 0x1p-52 - 1); };
  std::vector<Eigen::VectorXd> q, qd;
  for (int k = 0; k < 64; ++k) {
    Eigen::VectorXd at(tree.n_q()), rate(tree.n_v());
    for (double& x : at) { x = uniform(0.4); }
    for (double& x : rate) { x = uniform(2); }
    at.segment<4>(3).normalize();
    // Rotors about where their links are, the springs stretched a little.
    tree.outward([&]<class N, class S>(const N& node, const S& s) {
      if constexpr (requires { s.motor.gear_ratio; }) {
        at(node.q) = s.motor.gear_ratio * (at(node.q + 1) + uniform(0.02));
        rate(node.v) = s.motor.gear_ratio * (rate(node.v + 1) + uniform(0.1));
      }
    });
    q.push_back(at);
    qd.push_back(rate);
  }

  const std::vector<Measured> methods{
      measure<Tree>("implicit inversion", iim::ImplicitInversion<Tree>(tree, inputs), ws, q, qd),
      measure<Tree>("unit forces", iim::UnitForce<Tree>(tree, inputs), ws, q, qd),
      measure<Tree>("recursive inverse", iim::RecursiveInverse<Tree>(tree, inputs), ws, q, qd),
      measure<Tree>("global inverse", iim::GlobalInverse<Tree>(tree, inputs), ws, q, qd),
  };
  std::printf("%ld subsystems, %ld degrees of freedom, %ld inputs\n\n", static_cast<long>(tree.size()),
              static_cast<long>(tree.n_v()), static_cast<long>(inputs.columns()));
  std::printf("%-20s %10s %22s %22s\n", "method", "time [us]", "difference of qdd0", "of Bhat");
  bool agree = true;
  for (const Measured& m : methods) {
    // Row by row: a light rotor accelerates a thousand times as much as the torso.
    const double of_qdd0 = ((m.qdd0 - methods[0].qdd0).array() / methods[0].qdd0.array()).abs().maxCoeff();
    const double of_Bhat =
        ((m.Bhat - methods[0].Bhat).rowwise().norm().array() / methods[0].Bhat.rowwise().norm().array()).maxCoeff();
    std::printf("%-20s %10.2f %22.1e %22.1e\n", m.name, m.microseconds, of_qdd0, of_Bhat);
    agree = agree && of_qdd0 < 1e-9 && of_Bhat < 1e-9;  // false for NaN
  }
  return agree ? 0 : 1;
}
