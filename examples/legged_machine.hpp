// A legged robot as it is built: elastic drives at the hips, four-bar knees, ankles on push-rods, eight contact points.
// And what every method makes of it: time, and error against the same robot in long double.
#pragma once

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
#include <cstddef>
#include <random>
#include <string>
#include <type_traits>
#include <vector>

namespace legged {

using iim::Body, iim::Vector3;

using Robot = iim::Assembly<iim::FloatingBase<double>, iim::ElasticMotorArm<double>, iim::FourBar<double>,
                            iim::ParallelAnkle<double>>;

inline Body<double> body(double mass, const Vector3<double>& com, const Vector3<double>& moments)
{
  Body<double> b{mass, com, {}, false};
  b.inertia = moments.asDiagonal();
  return b;
}

inline iim::ElasticMotorArm<double> hip(const Vector3<double>& axis, const Body<double>& link)
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
inline iim::FourBar<double> knee()
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

inline iim::ParallelAnkle<double> ankle()
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

inline Robot machine()
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

struct State {
  Eigen::VectorXd q, qd;
};

/// Random states within reach: angles up to 0.4 rad, springs stretched a little.
template <class Tree>
std::vector<State> random_states(const Tree& tree, int count)
{
  std::mt19937_64 bits(7);
  const auto uniform = [&](double size) { return size * (static_cast<double>(bits() >> 11) * 0x1p-52 - 1); };
  std::vector<State> states;
  for (int k = 0; k < count; ++k) {
    Eigen::VectorXd q(tree.n_q()), qd(tree.n_v());
    for (double& x : q) { x = uniform(0.4); }
    for (double& x : qd) { x = uniform(2); }
    iim::normalize(tree, q);
    // Rotors about where their links are.
    tree.outward([&]<class N, class S>(const N& node, const S& s) {
      if constexpr (requires { s.motor.gear_ratio; }) {
        q(node.q) = s.motor.gear_ratio * (q(node.q + 1) + uniform(0.02));
        qd(node.v) = s.motor.gear_ratio * (qd(node.v + 1) + uniform(0.1));
      }
    });
    states.push_back({q, qd});
  }
  return states;
}

/// All motors, and forces at the eight contact points.
template <class Tree>
iim::Inputs<Tree> inputs_of(const Tree& tree)
{
  iim::Inputs<Tree> inputs(tree);
  for (const std::string leg : {"left_", "right_"}) {
    for (const char* point : {"heel_right", "heel_left", "toe_right", "toe_left"}) { inputs.add_force(leg + point); }
  }
  return inputs;
}

/// (q̈₀, B̂) in every state; an empty matrix where there was none.
template <class Method, class Workspace>
std::vector<iim::MatrixX<typename Workspace::Scalar>> answers(Method& method, Workspace& ws, const std::vector<State>& states)
{
  using Scalar = typename Workspace::Scalar;
  std::vector<iim::MatrixX<Scalar>> all;
  for (const State& state : states) {
    const iim::VectorX<Scalar> q = state.q.template cast<Scalar>(), qd = state.qd.template cast<Scalar>();
    const auto result = method(iim::forward_dynamics(q, qd, ws));
    iim::MatrixX<Scalar> answer;
    if (result.ok()) {
      answer.resize(result.qdd0.size(), 1 + result.Bhat.cols());
      answer << result.qdd0, result.Bhat;
    }
    all.push_back(answer);
  }
  return all;
}

/// Largest relative errors of a row of q̈₀ and of B̂: a light rotor accelerates a thousand times as much as the torso.
struct Errors {
  double qdd0 = 0, Bhat = 0;
};

template <class Scalar>
Errors errors(const std::vector<iim::MatrixX<Scalar>>& values, const std::vector<iim::MatrixX<long double>>& reference)
{
  Errors worst;
  for (std::size_t k = 0; k < values.size(); ++k) {
    if (values[k].size() == 0 || reference[k].size() == 0) { return {std::nan(""), std::nan("")}; }
    for (Eigen::Index row = 0; row < values[k].rows(); ++row) {
      const iim::VectorX<long double> exact = reference[k].row(row);
      const iim::VectorX<long double> off = values[k].row(row).template cast<long double>().transpose() - exact;
      const auto columns = exact.size() - 1;
      worst.qdd0 = std::max(worst.qdd0, static_cast<double>(std::abs(off(0) / exact(0))));
      worst.Bhat = std::max(worst.Bhat, static_cast<double>(off.tail(columns).norm() / exact.tail(columns).norm()));
    }
  }
  return worst;
}

struct Result {
  std::string method;
  Errors error;
  double microseconds = 0;  ///< for q̈₀ and B̂, median over passes through all states
};

struct Comparison {
  long subsystems = 0, n_v = 0, columns = 0;
  Errors doubt;  ///< of the reference: implicit inversion against unit forces, both in long double
  std::vector<Result> results;

  bool agree(double tolerance) const
  {
    return std::all_of(results.begin(), results.end(), [&](const Result& r) {
      return r.error.qdd0 < tolerance && r.error.Bhat < tolerance;  // false for NaN
    });
  }
};

/// All methods in `states` random states, each timed `passes` times.
inline Comparison compare(int count, int passes)
{
  const Robot robot = machine();
  const iim::DynamicTree tree(robot);
  const auto inputs = inputs_of(tree);
  const std::vector<State> states = random_states(tree, count);
  Comparison comparison{static_cast<long>(tree.size()), static_cast<long>(tree.n_v()),
                        static_cast<long>(inputs.columns()), {}, {}};

  const iim::DynamicTree exact_tree(robot.cast<long double>());
  const auto exact_inputs = inputs_of(exact_tree);
  iim::Workspace exact_ws(exact_tree);
  iim::ImplicitInversion exact_method(exact_tree, exact_inputs);
  iim::UnitForce other_method(exact_tree, exact_inputs);
  const auto reference = answers(exact_method, exact_ws, states);
  comparison.doubt = errors<long double>(answers(other_method, exact_ws, states), reference);

  using Tree = std::remove_const_t<decltype(tree)>;
  const auto add = [&](const std::string& name, auto method, auto& ws) {
    Result result{name, errors<double>(answers(method, ws, states), reference), 0};
    std::vector<double> times;
    for (int pass = 0; pass < passes; ++pass) {
      const auto begin = std::chrono::steady_clock::now();
      for (const State& state : states) {
        if constexpr (requires { method(state.q, state.qd, ws); }) {  // with no more of the O(n) pass than it needs
          static_cast<void>(method(state.q, state.qd, ws));
        } else {
          static_cast<void>(method(iim::forward_dynamics(state.q, state.qd, ws)));
        }
      }
      const std::chrono::duration<double, std::micro> time = std::chrono::steady_clock::now() - begin;
      times.push_back(time.count() / count);
    }
    std::nth_element(times.begin(), times.begin() + passes / 2, times.end());
    result.microseconds = times[static_cast<std::size_t>(passes / 2)];
    comparison.results.push_back(result);
  };
  iim::Workspace ws(tree);
  iim::Workspace<Tree, iim::Update::square_root> root_ws(tree);
  add("implicit inversion", iim::ImplicitInversion<Tree>(tree, inputs), ws);
  add("implicit inversion, square root", iim::ImplicitInversion<Tree>(tree, inputs), root_ws);
  add("unit forces", iim::UnitForce<Tree>(tree, inputs), ws);
  add("recursive M⁻¹, times B", iim::RecursiveInverse<Tree>(tree, inputs), ws);
  add("global inverse", iim::GlobalInverse<Tree>(tree, inputs), ws);
  return comparison;
}

}  // namespace legged
