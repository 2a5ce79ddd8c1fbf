// The laws that every type of subsystem must obey, to be run on a type of one's own:
//
//     const iim::LawReport report = iim::check_laws(part);
//     std::cout << report.text();   // a line per law; report.ok()
//
// The part is put on a base of three hinged links, with a hinged load on each of its frames, and into random states.
// The laws see motion(), bodies(), rotors(), internal_force() and Bbar() from outside: positions are differenced,
// energies summed.
//
//     motion pattern     motion() leaves zero what S::pattern says that it does
//     inertia            M̄_i is symmetric, the sum over bodies and rotors, without negative eigenvalue, and its q̇ block
//                        is positive definite (a point mass has no more: no motion about it costs energy)
//     velocity           frames move with [1 S_k], as differences of their placements say
//     acceleration       and accelerate with its bias, as differences of their velocities say
//     recursion          (8): V_i = T_ip V_p + F_i q̇_i, V̇_i = T_ip V̇_p + Ṫ_ip V_p + F_i q̈_i, by the same differences
//     equations          (10): F_iᵀ (M̄_i V̇_i + h̄_i − B̄_i u − coupling forces) = 0 under random u
//     power balance      d/dt (kinetic + potential energy) = q̇ᵀB̄u − q̇ᵀ internal force
//     stored energy      q̇ᵀ internal force = dU/dt + dissipation, for types that have potential(q), dissipation(q, q̇)
//     springs            ∂/∂q and ∂/∂q̇ of internal force are those of springs(), but for a part that may stay explicit
//     linear in u        q̈(u) = q̈₀ + B̂u
//     invariance         turning and moving robot and gravity together changes nothing
//     static tree        StaticTree and DynamicTree agree
//     square root        Update::square_root, which takes bodies by their principal axes, agrees with the default
#pragma once

#include <iim/iim.hpp>
#include <iim/law_suite/checks.hpp>
#include <iim/law_suite/observer.hpp>
#include <iim/law_suite/robot.hpp>
#include <iim/subsystem_matrices.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

namespace iim {

/// How to try. Coordinates are drawn by `coordinates`, for instance within the reach of a mechanism; without it they
/// are what neutral() becomes when it moves with a random velocity up to `range` for a second.
template <class S>
struct LawOptions {
  int states = 20;
  std::uint64_t seed = 1;
  double range = 1;   ///< [rad, m]
  double speed = 1;   ///< largest velocity [rad/s, m/s]
  double effort = 1;  ///< largest input [N, N m]
  /// Difference quotients have eight points `step` apart, in units of the time in which the state changes by about 1.
  double step = 2.5e-3;
  /// Of laws that are differenced: ε/step for the roundings is 1e-13, and up to 10³ for sums of unlike terms.
  double difference_tolerance = 1e-9;
  /// Of laws that compare two computations: ε times the condition number of M, up to 10⁶ for geared drives.
  double tolerance = 1e-9;
  /// How far springs() may be from the derivatives of internal_force, in units of the smaller. (What it says nothing
  /// of, as friction, is explicit.)
  double explicit_part = 0.5;
  std::function<detail::Coordinates<S>(const std::function<double(double, double)>& uniform)> coordinates;
};

namespace detail {

/// The laws on one part, state by state.
template <class S>
class Laws : LawChecks {
public:
  Laws(const S& part, const LawOptions<S>& options)
      : LawChecks(S::n_frames, options.step, options.difference_tolerance), options_(options), random_(options.seed),
        parts_(part, random_), robot_(parts_.robot, S::n_frames), turned_(parts_.elsewhere, S::n_frames),
        slim_(parts_.slim, 1), fixed_(parts_.slim, 1), root_ws_(robot_.tree), part_(part),
        node_(robot_.tree.node(number))
  {
    tree_ = &robot_.tree;
    part_.prepare("part");
  }

  LawReport report()
  {
    for (at_ = 0; at_ < options_.states && report_.failure.empty(); ++at_) { try_state(); }
    return report_;
  }

private:
  using Tree = typename LawTrees<S>::Dynamic;
  using Static = typename LawTrees<S>::Static;
  static constexpr Index number = law_number;

  void try_state()
  {
    draw();
    const Tree& tree = robot_.tree;
    const Vec qdd = forward_dynamics(q_, qd_, robot_.inputs, u_, robot_.ws).qdd;
    const auto receipt = forward_dynamics(q_, qd_, robot_.ws);
    const auto answer = robot_.method(receipt);
    check_pattern();
    if (!answer.ok()) {
      const Coordinates<S> q_i = q_.template segment<S::n_q>(node_.q);
      report_.failure = "state " + std::to_string(at_) + ", q_i = " + to_text(q_i) + ": " + to_string(answer.status);
      return;
    }
    const Vec qdd0 = answer.qdd0;
    const Mat Bhat = answer.Bhat;  // the next answer comes in the same memory
    hold("linear in u", apart(Vec(qdd0 + Bhat * u_), qdd), options_.tolerance);
    const auto turned = turned_.method(forward_dynamics(q_, qd_, turned_.ws));
    hold("invariance", apart(turned.qdd0, qdd0), options_.tolerance);
    hold("invariance", apart(turned.Bhat, Bhat), options_.tolerance);
    const Vec q = q_.segment(number - 1, S::n_q + 2), qd = qd_.segment(number - 1, S::n_i + 2);
    const auto slim = slim_.method(forward_dynamics(q, qd, slim_.ws));
    const auto fixed = fixed_.method(forward_dynamics(q, qd, fixed_.ws));
    hold("static tree", apart(fixed.qdd0, slim.qdd0), options_.tolerance);
    hold("static tree", apart(fixed.Bhat, slim.Bhat), options_.tolerance);

    const auto root = robot_.method(forward_dynamics(q_, qd_, root_ws_));
    hold("square root", apart(root.qdd0, qdd0), options_.tolerance);
    hold("square root", apart(root.Bhat, Bhat), options_.tolerance);

    std::vector<SubsystemMatrices<double>> subsystems;
    for (Index i = 0; i < tree.size(); ++i) { subsystems.push_back(subsystem_matrices(receipt, i)); }
    if constexpr (S::n_i > 0) {
      const Coordinates<S> q_i = q_.template segment<S::n_q>(node_.q);
      const NodeState<S>& state = robot_.ws.template node<S>(node_);
      check_inertia(subsystems[static_cast<std::size_t>(number)].Mbar, internal_inertia(part_, q_i),
                    robot_.ws.inlet_axes(node_, state));
    }
    const Observation now = observe(tree, q_, qd_);
    check_equations(subsystems, qdd, now);
    check_motion(subsystems, qdd, now);
  }

  void draw()
  {
    const Tree& tree = robot_.tree;
    q_.resize(tree.n_q());
    qd_.resize(tree.n_v());
    u_.resize(robot_.inputs.columns());
    for (double& x : q_) { x = random_(-1, 1); }
    for (double& x : qd_) { x = random_(-options_.speed, options_.speed); }
    for (double& x : u_) { x = random_(-options_.effort, options_.effort); }
    if (options_.coordinates) {
      q_.template segment<S::n_q>(node_.q) =
          options_.coordinates([&](double low, double high) { return random_(low, high); });
      return;
    }
    Vec from = q_, velocity = Vec::Zero(tree.n_v());
    from.template segment<S::n_q>(node_.q) = neutral(part_);
    for (Index k = 0; k < S::n_i; ++k) { velocity(node_.v + k) = random_(-options_.range, options_.range); }
    from = moved(tree, from, velocity, Vec::Zero(tree.n_v()), 1.0);
    q_.template segment<S::n_q>(node_.q) = from.template segment<S::n_q>(node_.q);
  }

  /// At the inlet's last orientation.
  void check_pattern()
  {
    std::array<Matrix3<double>, S::n_frames> R;
    std::array<Vector3<double>, S::n_frames> r;
    std::array<Eigen::Matrix<double, 6, S::n_i>, S::n_frames> S_k;
    std::array<Vector6<double>, S::n_frames> bias;
    R.fill(Matrix3<double>::Zero());
    r.fill(Vector3<double>::Zero());
    S_k.fill(Eigen::Matrix<double, 6, S::n_i>::Zero());
    bias.fill(Vector6<double>::Zero());
    auto frames = [&]<std::size_t... K>(std::index_sequence<K...>) {
      return std::array<FrameMotion<double, S::n_i>, sizeof...(K)>{
          FrameMotion<double, S::n_i>{R[K], r[K], S_k[K], bias[K]}...};
    }(std::make_index_sequence<S::n_frames>());
    const Coordinates<S> q_i = q_.template segment<S::n_q>(node_.q);
    const Velocities<S> qd_i = qd_.template segment<S::n_i>(node_.v);
    if (!part_.motion(robot_.ws.frame(node_.inlet).R, q_i, qd_i, frames)) { return; }
    double written = 0;
    for (std::size_t k = 0; k < R.size(); ++k) {
      if (!S::pattern.linear) { written = largest({written, S_k[k].template topRows<3>().norm()}); }
      if (!S::pattern.angular) { written = largest({written, S_k[k].template bottomRows<3>().norm()}); }
      if (!S::pattern.offset) { written = largest({written, r[k].norm()}); }
      if (!S::pattern.bias) { written = largest({written, bias[k].norm()}); }
    }
    hold("motion pattern", written, 0);
  }

  /// All that differences along q̇(t) = q̇ + q̈ t can say, and the power of inputs and internal forces.
  void check_motion(const std::vector<SubsystemMatrices<double>>& subsystems, const Vec& qdd, const Observation& now)
  {
    const Tree& tree = robot_.tree;
    const Coordinates<S> q_i = q_.template segment<S::n_q>(node_.q);
    const auto later = [&](double time) -> std::pair<Observation, double> {
      const Vec q = moved(tree, q_, qd_, qdd, time);
      double potential = 0;
      if constexpr (requires { part_.potential(q_i); }) {
        const Coordinates<S> q_then = q.template segment<S::n_q>(node_.q);
        potential = part_.potential(q_then) - part_.potential(q_i);
      }
      return {observe(tree, q, qd_ + time * qdd), potential};
    };
    static_cast<void>(forward_dynamics(q_, qd_, robot_.inputs, u_, robot_.ws));  // leaves V̇ under the inputs
    const Change change = check_differences(subsystems, qdd, now, later, robot_.ws);

    std::vector<double> motors;
    Index column = 0;
    tree.outward([&]<class T>(const Node& n, const T& s) {
      if constexpr (T::n_u > 0) {
        const Velocities<T> qd_n = qd_.template segment<T::n_i>(n.v);
        const Coordinates<T> q_n = q_.template segment<T::n_q>(n.q);
        const Eigen::Matrix<double, T::n_u, 1> u_n = u_.template segment<T::n_u>(column);
        motors.push_back(qd_n.dot(s.Bbar(q_n) * u_n));
        column += T::n_u;
      }
    });
    double taken = 0;
    static_assert(has_internal_force<S>() || !(requires { part_.potential(q_i); } || spring_count<S>() > 0),
                  "a type with potential() or springs() has internal_force(q, qd)");
    if constexpr (has_internal_force<S>()) {
      const Velocities<S> qd_i = qd_.template segment<S::n_i>(node_.v);
      taken = qd_i.dot(part_.internal_force(q_i, qd_i));
      if constexpr (requires { part_.potential(q_i); }) {
        double known = change.potential_rate;
        if constexpr (requires { part_.dissipation(q_i, qd_i); }) { known += part_.dissipation(q_i, qd_i); }
        hold("stored energy", std::abs(taken - known) / (1 + std::abs(taken) + std::abs(change.potential_rate)),
             options_.difference_tolerance);
      }
    }
    check_power(change, motors, taken, now);
    if constexpr (spring_count<S>() > 0) { check_springs(q_i, qd_.template segment<S::n_i>(node_.v)); }
  }

  /// Central differences of internal_force along each q̇_i, and in it.
  void check_springs(const Coordinates<S>& q, const Velocities<S>& qd)
  {
    using Square = Eigen::Matrix<double, S::n_i, S::n_i>;
    Square stiffness = Square::Zero(), damping = Square::Zero(), by_q, by_qd;
    for (const auto& spring : part_.springs(q, qd)) {
      stiffness += spring.ratio.transpose() * spring.stiffness * spring.ratio;
      damping += spring.ratio.transpose() * spring.damping * spring.ratio;
    }
    const double h = 1e-5;
    for (Index d = 0; d < S::n_i; ++d) {
      const Velocities<S> along = h * Velocities<S>::Unit(d);
      const Coordinates<S> there = coordinate_rate(part_, q, along);
      const Velocities<S> ahead = part_.internal_force(q + there, qd), behind = part_.internal_force(q - there, qd);
      by_q.col(d) = (ahead - behind) / (2 * h);
      const Velocities<S> faster = part_.internal_force(q, qd + along), slower = part_.internal_force(q, qd - along);
      by_qd.col(d) = (faster - slower) / (2 * h);
    }
    const auto compare = [&](const Square& found, const Square& told) {
      if (told.norm() > 0) {
        hold("springs", (found - told).norm() / std::min(found.norm(), told.norm()), options_.explicit_part);
      }
    };
    compare(by_q, stiffness);
    compare(by_qd, damping);
  }

  LawOptions<S> options_;
  LawRandom random_;
  LawParts<S> parts_;
  LawRobot<Tree> robot_, turned_, slim_;
  LawRobot<Static> fixed_;
  Workspace<Tree, Update::square_root> root_ws_;
  S part_;
  const Node& node_;
};

}  // namespace detail

/// Tries all laws on `part` (parameters as for a tree; not yet prepared). Throws ModelError if they are wrong.
template <Subsystem S>
  requires std::same_as<typename S::Scalar, double>
LawReport check_laws(const S& part, const LawOptions<S>& options = {})
{
  return detail::Laws<S>(part, options).report();
}

}  // namespace iim
