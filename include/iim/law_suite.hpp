// The laws that every type of subsystem must obey, to be run on a type of one's own:
//
//     const iim::LawReport report = iim::check_laws(part);
//     std::cout << report.text();   // a line per law; report.ok()
//
// The part is put on a base of three hinged links, with a hinged load on each of its frames, and into random states. The
// laws see motion(), bodies(), rotors(), internal_force() and Bbar() from outside: positions are differenced, energies
// summed.
//
//     inertia            M̄_i is symmetric, the sum over bodies and rotors, without negative eigenvalue, and its q̇ block
//                        is positive definite (a point mass has no more: no motion about it costs energy)
//     velocity           frames move with [1 S_k], as differences of their placements say
//     acceleration       and accelerate with its bias, as differences of their velocities say
//     recursion          (8): V_i = T_ip V_p + F_i q̇_i, V̇_i = T_ip V̇_p + Ṫ_ip V_p + F_i q̈_i, by the same differences
//     equations          (10): F_iᵀ (M̄_i V̇_i + h̄_i − B̄_i u − coupling forces) = 0 under random u
//     power balance      d/dt (kinetic + potential energy) = q̇ᵀB̄u − q̇ᵀ internal force
//     stored energy      q̇ᵀ internal force = dU/dt + dissipation, for types that have potential(q), dissipation(q, q̇)
//     linear in u        q̈(u) = q̈₀ + B̂u
//     invariance         turning and moving robot and gravity together changes nothing
//     static tree        StaticTree and DynamicTree agree
//     square root        Update::square_root, which takes bodies by their principal axes, agrees with the default
#pragma once

#include <iim/iim.hpp>
#include <iim/law_suite_observer.hpp>
#include <iim/law_suite_robot.hpp>
#include <iim/subsystem_matrices.hpp>

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <sstream>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace iim {

/// Worst case of one law over all states.
struct LawResult {
  std::string law;
  double error = 0;      ///< largest, relative
  double tolerance = 0;
  int state = -1;        ///< where
  bool ok() const { return error <= tolerance; }  // false for NaN
};

struct LawReport {
  std::vector<LawResult> laws;
  std::string failure;  ///< what kept the laws from being tried

  bool ok() const
  {
    return failure.empty() && std::all_of(laws.begin(), laws.end(), [](const LawResult& l) { return l.ok(); });
  }

  std::string text() const
  {
    std::ostringstream out;
    if (!failure.empty()) { out << failure << '\n'; }
    for (const LawResult& l : laws) {
      out << (l.ok() ? "holds  " : "BROKEN ") << l.law << ": error " << l.error << " (at most " << l.tolerance << ")";
      if (!l.ok()) { out << " in state " << l.state; }
      out << '\n';
    }
    return out.str();
  }
};

/// How to try. Coordinates are drawn by `coordinates`, for instance within the reach of a mechanism; without it they
/// are what neutral() becomes when it moves with a random velocity up to `range` for a second.
template <class S>
struct LawOptions {
  int states = 20;
  std::uint64_t seed = 1;
  double range = 1;    ///< [rad, m]
  double speed = 1;    ///< largest velocity [rad/s, m/s]
  double effort = 1;   ///< largest input [N, N m]
  /// Difference quotients have eight points `step` apart, in units of the time in which the state changes by about 1.
  double step = 2.5e-3;
  /// Of laws that are differenced: ε/step for the roundings is 1e-13, and up to 10³ for sums of unlike terms.
  double difference_tolerance = 1e-9;
  /// Of laws that compare two computations: ε times the condition number of M, up to 10⁶ for geared drives.
  double tolerance = 1e-9;
  std::function<detail::Coordinates<S>(const std::function<double(double, double)>& uniform)> coordinates;
};

namespace detail {

/// The laws on one part, state by state.
template <class S>
class Laws {
public:
  Laws(const S& part, const LawOptions<S>& options)
      : options_(options),
        random_(options.seed),
        parts_(part, random_),
        robot_(parts_.robot, S::n_frames),
        turned_(parts_.elsewhere, S::n_frames),
        slim_(parts_.slim, 1),
        fixed_(parts_.slim, 1),
        root_ws_(robot_.tree),
        part_(part),
        node_(robot_.tree.node(number))
  {
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
  using Vec = Eigen::VectorXd;
  using Mat = Eigen::MatrixXd;
  static constexpr Index number = LawParts<S>::number;

  void try_state()
  {
    draw();
    const Tree& tree = robot_.tree;
    const Vec qdd = forward_dynamics(q_, qd_, robot_.inputs, u_, robot_.ws).qdd;
    const auto receipt = forward_dynamics(q_, qd_, robot_.ws);
    const auto answer = robot_.method(receipt);
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
    check_inertia(subsystems[static_cast<std::size_t>(number)].Mbar);
    const Observation now = observe(tree, q_, qd_);
    check_equations(subsystems, qdd, now);
    check_differences(subsystems, qdd, now);
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
      q_.template segment<S::n_q>(node_.q) = options_.coordinates([&](double low, double high) { return random_(low, high); });
      return;
    }
    Vec from = q_, velocity = Vec::Zero(tree.n_v());
    from.template segment<S::n_q>(node_.q) = neutral(part_);
    for (Index k = 0; k < S::n_i; ++k) { velocity(node_.v + k) = random_(-options_.range, options_.range); }
    from = moved(tree, from, velocity, Vec::Zero(tree.n_v()), 1.0);
    q_.template segment<S::n_q>(node_.q) = from.template segment<S::n_q>(node_.q);
  }

  void check_inertia(const Mat& Mbar)
  {
    if constexpr (S::n_i > 0) {
      const Coordinates<S> q_i = q_.template segment<S::n_q>(node_.q);
      Mat to_world = Mat::Identity(6 + S::n_i, 6 + S::n_i);
      const Eigen::Matrix3d& R = robot_.ws.template node<S>(node_).R;
      to_world.topLeftCorner<3, 3>() = R;
      to_world.block<3, 3>(3, 3) = R;
      const Mat summed = to_world * internal_inertia(part_, q_i) * to_world.transpose();
      const Eigen::SelfAdjointEigenSolver<Mat> spectrum(summed, Eigen::EigenvaluesOnly);
      const bool definite = Eigen::LLT<Mat>(Mbar.template bottomRightCorner<S::n_i, S::n_i>()).info() == Eigen::Success;
      // Some 30 roundings per entry, and those of the eigenvalues.
      hold("inertia", definite ? -spectrum.eigenvalues().minCoeff() / spectrum.eigenvalues().maxCoeff() : 1, 1e-13);
      hold("inertia", apart(Mbar, summed), 1e-13);
      hold("inertia", apart(Mat(Mbar.transpose()), Mbar), 1e-13);
    }
  }

  /// (10), from the loads inward: what is left of the forces on the internal velocities, against their sizes.
  void check_equations(const std::vector<SubsystemMatrices<double>>& subsystems, const Vec& qdd, const Observation& now)
  {
    const Tree& tree = robot_.tree;
    std::vector<Vec> Vdot, force;
    for (Index i = 0; i < tree.size(); ++i) {
      const auto& m = subsystems[static_cast<std::size_t>(i)];
      Vec a = m.T_ip_dot_V_p + m.F * qdd.segment(tree.node(i).v, m.F.cols());
      if (tree.node(i).inlet >= 0) { a += m.T_ip * Vdot[static_cast<std::size_t>(tree.node(i).parent)]; }
      Vdot.push_back(a);
      force.push_back(m.Mbar * a + m.hbar);
    }
    Index column = 0;
    for (Index i = 0; i < tree.size(); ++i) {
      const auto& m = subsystems[static_cast<std::size_t>(i)];
      force[static_cast<std::size_t>(i)] -= m.Bbar * u_.segment(column, m.Bbar.cols());
      column += m.Bbar.cols();
    }
    for (int k = 0; k < S::n_frames; ++k, column += 6) {
      const auto& load = tree.node(number + 1 + k);
      const auto i = static_cast<std::size_t>(load.index), f = static_cast<std::size_t>(load.frame);
      const Eigen::Vector3d arm = now.origin[f] + now.R[f] * LawRobot<Tree>::tip - now.coupling[i];
      Vector6<double> wrench;
      wrench << now.R[f] * u_.segment<3>(column), now.R[f] * u_.segment<3>(column + 3);
      wrench.tail<3>() += arm.cross(wrench.head<3>());
      force[i] -= subsystems[i].frame[0].transpose() * wrench;
    }
    double left = 0, size = 0;
    for (Index i = tree.size(); i-- > 0;) {
      const auto k = static_cast<std::size_t>(i);
      const auto& m = subsystems[k];
      left = std::max(left, (m.F.transpose() * force[k]).norm());
      size = std::max({size, (m.Mbar * Vdot[k]).norm(), force[k].norm(), m.hbar.norm()});
      if (tree.node(i).inlet >= 0) { force[static_cast<std::size_t>(tree.node(i).parent)] += m.T_ip.transpose() * force[k]; }
    }
    hold("equations", left / size, 1e-12);  // whatever the condition of M: some 10³ roundings
  }

  /// All that differences along q̇(t) = q̇ + q̈ t can say, q̈ that under u.
  void check_differences(const std::vector<SubsystemMatrices<double>>& subsystems, const Vec& qdd, const Observation& now)
  {
    const Tree& tree = robot_.tree;
    const Coordinates<S> q_i = q_.template segment<S::n_q>(node_.q);
    const double quickness = std::max({1.0, qd_.cwiseAbs().maxCoeff(), std::sqrt(qdd.cwiseAbs().maxCoeff())});
    const double h = options_.step / quickness;
    const auto frames = now.R.size(), count = subsystems.size();
    const auto pivot = [&](Index i) {  // the coupling point in the axes of the frame that it is on
      const auto f = static_cast<std::size_t>(tree.node(i).inlet);
      return Eigen::Vector3d(now.R[f].transpose() * (now.coupling[static_cast<std::size_t>(i)] - now.origin[f]));
    };
    std::vector<Eigen::Matrix3d> Rdot(frames, Eigen::Matrix3d::Zero());
    std::vector<Eigen::Vector3d> rdot(frames, Eigen::Vector3d::Zero()), vdot = rdot, omegadot = rdot;
    std::vector<Vector6<double>> V(count, Vector6<double>::Zero()), Vdot = V;
    for (Index i = 0; i < tree.size(); ++i) {
      if (tree.node(i).inlet >= 0) { V[static_cast<std::size_t>(i)] = now.twist(tree.node(i).inlet, pivot(i)); }
    }
    double power = 0, potential_rate = 0;
    for (int point = -4; point <= 4; ++point) {
      if (point == 0) { continue; }
      const double c = (point > 0 ? 1 : -1) * difference_weights[static_cast<std::size_t>(std::abs(point) - 1)] / h;
      const Vec q = moved(tree, q_, qd_, qdd, point * h);
      const Observation then = observe(tree, q, qd_ + point * h * qdd);
      for (std::size_t f = 0; f < frames; ++f) {
        Rdot[f] += c * (then.R[f] - now.R[f]);
        rdot[f] += c * (then.origin[f] - now.origin[f]);
        vdot[f] += c * (then.v[f] - now.v[f]);
        omegadot[f] += c * (then.omega[f] - now.omega[f]);
      }
      for (Index i = 0; i < tree.size(); ++i) {
        const auto k = static_cast<std::size_t>(i);
        if (tree.node(i).inlet >= 0) { Vdot[k] += c * (then.twist(tree.node(i).inlet, pivot(i)) - V[k]); }
      }
      power += c * ((then.kinetic - now.kinetic) + (then.potential - now.potential));
      if constexpr (requires { part_.potential(q_i); }) {
        const Coordinates<S> q_then = q.template segment<S::n_q>(node_.q);
        potential_rate += c * (part_.potential(q_then) - part_.potential(q_i));
      }
    }

    // Accelerations in the workspace are those for the motion under u, and without the fall of an observer at rest.
    forward_dynamics(q_, qd_, robot_.inputs, u_, robot_.ws);
    double v_error = 0, a_error = 0, v_size = 1, a_size = 1;
    for (std::size_t f = 0; f < frames; ++f) {
      const auto& state = robot_.ws.frame(static_cast<Index>(f));
      const Eigen::Matrix3d spin = Rdot[f] * now.R[f].transpose();
      v_error = std::max({v_error, (spin - skew<double>(now.omega[f])).norm(), (rdot[f] - now.v[f]).norm()});
      v_size = std::max({v_size, now.v[f].norm(), now.omega[f].norm()});
      const Eigen::Vector3d a =
          vdot[f] - omegadot[f].cross(state.r) - now.omega[f].cross(now.omega[f].cross(state.r)) - tree.gravity();
      a_error = std::max({a_error, (state.Vdot.template head<3>() - a).norm(),
                          (state.Vdot.template tail<3>() - omegadot[f]).norm()});
      a_size = std::max({a_size, a.norm(), omegadot[f].norm()});
    }
    hold("velocity", v_error / v_size, options_.difference_tolerance);
    hold("acceleration", a_error / a_size, options_.difference_tolerance);

    double error = 0;
    for (Index i = 0; i < tree.size(); ++i) {
      if (tree.node(i).inlet < 0) { continue; }
      const auto& m = subsystems[static_cast<std::size_t>(i)];
      const Index p = tree.node(i).parent, n_p = m.T_ip.cols() - 6;
      const auto rows = m.T_ip.topRows<6>();
      Vec of_parent(6 + n_p), rate = of_parent;
      of_parent << V[static_cast<std::size_t>(p)], qd_.segment(tree.node(p).v, n_p);
      rate << Vdot[static_cast<std::size_t>(p)], qdd.segment(tree.node(p).v, n_p);
      const Vector6<double> velocity = rows * of_parent;
      const Vector6<double> acceleration = rows * rate + m.T_ip_dot_V_p.head<6>();
      error = std::max({error, (velocity - V[static_cast<std::size_t>(i)]).norm() / v_size,
                        (acceleration - Vdot[static_cast<std::size_t>(i)]).norm() / a_size,
                        m.T_ip.bottomRows(m.T_ip.rows() - 6).norm(), (m.F - Mat::Identity(m.F.rows(), m.F.rows())
                                                                               .rightCols(m.F.cols())).norm()});
    }
    hold("recursion", error, options_.difference_tolerance);
    check_power(power, potential_rate, now);
  }

  /// Power of inputs: motors on their own velocities, wrenches at points of the loads in the loads' axes.
  void check_power(double power, double potential_rate, const Observation& now)
  {
    double expected = 0, size = 1;
    const auto work = [&](double watts) {
      expected += watts;
      size += std::abs(watts);
    };
    Index column = 0;
    robot_.tree.outward([&]<class N, class T>(const N& n, const T& s) {
      if constexpr (T::n_u > 0) {
        const Velocities<T> qd_n = qd_.template segment<T::n_i>(n.v);
        const Coordinates<T> q_n = q_.template segment<T::n_q>(n.q);
        const Eigen::Matrix<double, T::n_u, 1> u_n = u_.template segment<T::n_u>(column);
        work(qd_n.dot(s.Bbar(q_n) * u_n));
        column += T::n_u;
      }
    });
    for (int k = 0; k < S::n_frames; ++k, column += 6) {
      const auto f = static_cast<std::size_t>(robot_.tree.node(number + 1 + k).frame);
      const Eigen::Vector3d arm = now.R[f] * LawRobot<Tree>::tip;
      work((now.R[f] * u_.segment<3>(column)).dot(now.v[f] + now.omega[f].cross(arm)));
      work((now.R[f] * u_.segment<3>(column + 3)).dot(now.omega[f]));
    }
    if constexpr (has_internal_force<S>()) {
      const Coordinates<S> q_i = q_.template segment<S::n_q>(node_.q);
      const Velocities<S> qd_i = qd_.template segment<S::n_i>(node_.v);
      const double taken = qd_i.dot(part_.internal_force(q_i, qd_i));
      work(-taken);
      if constexpr (requires { part_.potential(q_i); }) {
        double known = potential_rate;
        if constexpr (requires { part_.dissipation(q_i, qd_i); }) { known += part_.dissipation(q_i, qd_i); }
        hold("stored energy", std::abs(taken - known) / (1 + std::abs(taken) + std::abs(potential_rate)),
             options_.difference_tolerance);
      }
    }
    hold("power balance", std::abs(power - expected) / size, options_.difference_tolerance);
  }

  /// Keeps the worst; a law is known from its first state on.
  void hold(const std::string& law, double error, double tolerance)
  {
    auto& laws = report_.laws;
    auto found = std::find_if(laws.begin(), laws.end(), [&](const LawResult& l) { return l.law == law; });
    if (found == laws.end()) { found = laws.insert(found, {law, 0, tolerance, 0}); }
    if (!(error <= found->error)) {
      found->error = std::isnan(error) ? std::numeric_limits<double>::infinity() : error;
      found->state = at_;
    }
  }

  template <class A, class B>
  static double apart(const A& a, const B& b)
  {
    const double size = b.norm();
    return (a - b).norm() / (size > 0 ? size : 1);
  }

  LawOptions<S> options_;
  LawRandom random_;
  LawParts<S> parts_;
  LawRobot<Tree> robot_, turned_, slim_;
  LawRobot<Static> fixed_;
  Workspace<Tree, Update::square_root> root_ws_;
  S part_;
  const std::remove_cvref_t<decltype(std::declval<const Tree&>().node(0))>& node_;
  Vec q_, qd_, u_;
  int at_ = 0;
  LawReport report_;
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
