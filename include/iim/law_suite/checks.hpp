// The law suite's part that no type of subsystem enters: what is compared with what.
#pragma once

#include <iim/body.hpp>
#include <iim/iim.hpp>
#include <iim/law_suite/observer.hpp>
#include <iim/subsystem_matrices.hpp>

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <initializer_list>
#include <limits>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

namespace iim {

/// Worst case of one law over all states.
struct LawResult {
  std::string law;
  double error = 0;  ///< largest, relative
  double tolerance = 0;
  int state = -1;                                 ///< where
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

namespace detail {

inline constexpr Index law_number = 3;                 ///< of the part in the tree
inline const Eigen::Vector3d law_tip{0.1, 0.2, -0.1};  ///< where wrenches act, in the load's axes

/// Of a type's laws what is the same for all types: compiled once for all that a file tries.
class LawChecks {
protected:
  using Vec = Eigen::VectorXd;
  using Mat = Eigen::MatrixXd;

  /// By differences: power of all kinetic and potential energy, and what the part's own potential gains in time.
  struct Change {
    double power, potential_rate;
  };

  LawChecks(Index loads, double step, double difference_tolerance)
      : loads_(loads), step_(step), difference_tolerance_(difference_tolerance)
  {
  }

  /// M̄_i of the part, against what its bodies and rotors sum up to at an inlet at rest in world axes.
  void check_inertia(const Mat& Mbar, const Mat& at_rest, const Eigen::Matrix3d& R)
  {
    const Index n_i = Mbar.rows() - 6;
    Mat to_world = Mat::Identity(6 + n_i, 6 + n_i);
    to_world.topLeftCorner(3, 3) = R;
    to_world.block(3, 3, 3, 3) = R;
    const Mat summed = to_world * at_rest * to_world.transpose();
    // Some 30 roundings per entry, and those of the elimination.
    hold("inertia", is_definite(0, 1, Mat(Mbar.bottomRightCorner(n_i, n_i))) ? negative_part(summed) : 1, 1e-13);
    hold("inertia", apart(Mbar, summed), 1e-13);
    hold("inertia", apart(Mat(Mbar.transpose()), Mbar), 1e-13);
  }

  /// (10), from the loads inward: what is left of the forces on the internal velocities, against their sizes.
  void check_equations(const std::vector<SubsystemMatrices<double>>& subsystems, const Vec& qdd, const Observation& now)
  {
    const TreeData<double>& tree = *tree_;
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
    for (Index k = 0; k < loads_; ++k, column += 6) {
      const auto& load = tree.node(law_number + 1 + k);
      const auto i = static_cast<std::size_t>(load.index), f = static_cast<std::size_t>(load.frame);
      const Eigen::Vector3d arm = now.origin[f] + now.R[f] * law_tip - now.coupling[i];
      Vector6<double> wrench;
      wrench << now.R[f] * u_.segment<3>(column), now.R[f] * u_.segment<3>(column + 3);
      wrench.tail<3>() += arm.cross(wrench.head<3>());
      force[i] -= subsystems[i].frame[0].transpose() * wrench;
    }
    double left = 0, size = 0;
    for (Index i = tree.size(); i-- > 0;) {
      const auto k = static_cast<std::size_t>(i);
      const auto& m = subsystems[k];
      left = largest({left, (m.F.transpose() * force[k]).norm()});
      size = std::max({size, (m.Mbar * Vdot[k]).norm(), force[k].norm(), m.hbar.norm()});
      if (tree.node(i).inlet >= 0) {
        force[static_cast<std::size_t>(tree.node(i).parent)] += m.T_ip.transpose() * force[k];
      }
    }
    hold("equations", left / size, 1e-12);  // whatever the condition of M: some 10³ roundings
  }

  /// All that differences along q̇(t) = q̇ + q̈ t can say, q̈ that under u.
  /// later: what is seen a time later, and the part's own potential then less that now. ws: with the motion under u.
  Change check_differences(const std::vector<SubsystemMatrices<double>>& subsystems, const Vec& qdd,
                           const Observation& now,
                           const std::function<std::pair<Observation, double>(double time)>& later,
                           const WorkspaceData<double, Update::projected>& ws)
  {
    const TreeData<double>& tree = *tree_;
    const double quickness = std::max({1.0, qd_.cwiseAbs().maxCoeff(), std::sqrt(qdd.cwiseAbs().maxCoeff())});
    const double h = step_ / quickness;
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
      const auto [then, potential] = later(point * h);
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
      potential_rate += c * potential;
    }

    // Accelerations in the workspace are those for the motion under u, and without the fall of an observer at rest.
    double v_error = 0, a_error = 0, v_size = 1, a_size = 1;
    for (std::size_t f = 0; f < frames; ++f) {
      const auto& state = ws.frame(static_cast<Index>(f));
      const Eigen::Matrix3d spin = Rdot[f] * now.R[f].transpose();
      v_error = largest({v_error, (spin - skew<double>(now.omega[f])).norm(), (rdot[f] - now.v[f]).norm()});
      v_size = std::max({v_size, now.v[f].norm(), now.omega[f].norm()});
      const Eigen::Vector3d a =
          vdot[f] - omegadot[f].cross(state.r) - now.omega[f].cross(now.omega[f].cross(state.r)) - tree.gravity();
      a_error = largest({a_error, (state.Vdot.head<3>() - a).norm(), (state.Vdot.tail<3>() - omegadot[f]).norm()});
      a_size = std::max({a_size, a.norm(), omegadot[f].norm()});
    }
    hold("velocity", v_error / v_size, difference_tolerance_);
    hold("acceleration", a_error / a_size, difference_tolerance_);

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
      error = largest({error, (velocity - V[static_cast<std::size_t>(i)]).norm() / v_size,
                       (acceleration - Vdot[static_cast<std::size_t>(i)]).norm() / a_size,
                       m.T_ip.bottomRows(m.T_ip.rows() - 6).norm(),
                       (m.F - Mat::Identity(m.F.rows(), m.F.rows()).rightCols(m.F.cols())).norm()});
    }
    hold("recursion", error, difference_tolerance_);
    return {power, potential_rate};
  }

  /// Power of inputs: of motors as it is, of wrenches at points of the loads in the loads' axes. taken: by internal
  /// forces.
  void check_power(const Change& change, const std::vector<double>& motors, double taken, const Observation& now)
  {
    double expected = 0, size = 1;
    const auto work = [&](double watts) {
      expected += watts;
      size += std::abs(watts);
    };
    for (const double watts : motors) { work(watts); }
    Index column = u_.size() - 6 * loads_;
    for (Index k = 0; k < loads_; ++k, column += 6) {
      const auto f = static_cast<std::size_t>(tree_->node(law_number + 1 + k).frame);
      const Eigen::Vector3d arm = now.R[f] * law_tip;
      work((now.R[f] * u_.segment<3>(column)).dot(now.v[f] + now.omega[f].cross(arm)));
      work((now.R[f] * u_.segment<3>(column + 3)).dot(now.omega[f]));
    }
    work(-taken);
    hold("power balance", std::abs(change.power - expected) / size, difference_tolerance_);
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

  /// NaN if one of them is, which std::max passes over.
  static double largest(std::initializer_list<double> numbers)
  {
    double most = 0;
    for (const double x : numbers) {
      if (!(x <= most)) { most = x; }
      if (std::isnan(most)) { break; }
    }
    return most;
  }

  /// How far below zero the eigenvalues of A reach, against the sum of all, to a factor of 2; 0 if they do not.
  static double negative_part(const Mat& A)
  {
    const double sum = A.trace();
    double part = 0;
    while (part <= 1 && !is_definite(part * sum, 1, A)) { part = part > 0 ? 2 * part : 1e-16; }
    return part;
  }

  static double apart(const Mat& a, const Mat& b)
  {
    const double size = b.norm();
    return (a - b).norm() / (size > 0 ? size : 1);
  }

  const TreeData<double>* tree_ = nullptr;
  Index loads_;
  double step_, difference_tolerance_;
  Vec q_, qd_, u_;
  int at_ = 0;
  LawReport report_;
};

}  // namespace detail
}  // namespace iim
