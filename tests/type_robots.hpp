// Robots around one subsystem under test, and what two of them are compared by.
#pragma once

#include "random_tree.hpp"
#include "worst.hpp"

#include <iim/iim.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

namespace iim::test {

/// q̈₀ and B̂ of a tree at a state, by implicit inversion, with all inputs active.
struct Answer {
  Eigen::VectorXd qdd0;
  Eigen::MatrixXd Bhat;
  Status status;
};

template <class Tree>
Answer solve(const Tree& tree, const Inputs<Tree>& inputs, const Eigen::VectorXd& q, const Eigen::VectorXd& qd)
{
  Workspace ws(tree);
  ImplicitInversion<Tree> method(tree, inputs);
  const auto receipt = forward_dynamics(q, qd, ws);
  const auto result = method(receipt);
  return {result.qdd0, result.Bhat, result.status};
}

/// Where something hangs, at random.
inline Attachment<double> random_attachment(Random& random, const std::string& parent, int outlet = 0)
{
  return {parent, random.rotation(), random.vector(0.4), outlet};
}

inline double relative_error(const Eigen::MatrixXd& value, const Eigen::MatrixXd& reference)
{
  return (value - reference).norm() / reference.norm();
}

/// Two points that a loop keeps together in some directions.
struct Cut {
  std::string frame_a;
  Vec3 point_a;
  std::string frame_b;
  Vec3 point_b;
  Eigen::Matrix<double, 3, Eigen::Dynamic> directions;  // columns, world axes
};

/// Answer of a robot with loops from the tree that is left when they are cut, by Lagrange multipliers. All parts of the
/// tree have as many motors as velocities.
///     q̈ = q̈_free − M⁻¹Jᵀ (J M⁻¹ Jᵀ)⁻¹ (distance)¨ of q̈_free
struct Multipliers {
  Answer answer;
  double gap, speed;  // of the loops, at the state: [m], [m/s]
};

template <class Tree>
Multipliers cut_loops(const Tree& tree, const Inputs<Tree>& inputs, const std::vector<Cut>& cuts,
                      const Eigen::VectorXd& q, const Eigen::VectorXd& qd)
{
  Inputs<Tree> motors(tree), points(tree, Start::empty);
  for (const Cut& cut : cuts) {
    points.add_force(cut.frame_a, cut.point_a);
    points.add_force(cut.frame_b, cut.point_b);
  }
  Eigen::MatrixXd M_inv = solve(tree, motors, q, qd).Bhat;
  tree.outward([&]<class N, class S>(const N& node, const S& s) {  // per generalised force, not per motor
    const Eigen::Matrix<double, S::n_i, S::n_i> Bbar = s.Bbar(q.template segment<S::n_q>(node.q));
    M_inv.middleCols<S::n_i>(node.v) = M_inv.middleCols<S::n_i>(node.v) * Bbar.inverse().eval();
  });
  const Eigen::MatrixXd at_points = solve(tree, points, q, qd).Bhat;
  Multipliers result{solve(tree, inputs, q, qd), 0, 0};
  Workspace ws(tree);
  REQUIRE(forward_dynamics(q, qd, ws).ok());
  const auto point = [&](const std::string& name, const Vec3& at) {
    const FrameReference<double>& f = tree.frame(name);
    const auto& state = ws.frame(f.frame);
    const Vec3 x = state.r + state.R * (f.at.R * at + f.at.p);
    Vec3 position = x;
    for (Index i = f.subsystem; i >= 0; i = tree.node(i).parent) {
      tree.visit(i, [&]<class N, class S>(const N& n, const S&) { position += ws.template node<S>(n).r; });
    }
    const Vec3 alpha = state.Vdot.template tail<3>();
    const Vec3 acceleration = state.Vdot.template head<3>() + alpha.cross(x) + state.omega.cross(state.omega.cross(x));
    return std::pair(position, acceleration);
  };
  const Index n = tree.n_v();
  Eigen::MatrixXd MinvJt(n, 0);
  Eigen::VectorXd drift(0);
  for (std::size_t c = 0; c < cuts.size(); ++c) {
    const auto a = point(cuts[c].frame_a, cuts[c].point_a);
    const auto b = point(cuts[c].frame_b, cuts[c].point_b);
    const auto& directions = cuts[c].directions;
    const Index k = MinvJt.cols(), more = directions.cols(), at = 6 * static_cast<Index>(c);
    MinvJt.conservativeResize(Eigen::NoChange, k + more);
    drift.conservativeResize(k + more);
    MinvJt.rightCols(more) = (at_points.middleCols(at, 3) - at_points.middleCols(at + 3, 3)) * directions;
    drift.tail(more) = directions.transpose() * (a.second - b.second);
    keep_worst(result.gap, (directions.transpose() * (a.first - b.first)).norm());
  }
  const Eigen::MatrixXd J = M_inv.llt().solve(MinvJt).transpose();
  const Eigen::LDLT<Eigen::MatrixXd> compliance(J * MinvJt);
  result.speed = (J * qd).norm();
  result.answer.qdd0 -= MinvJt * compliance.solve(drift);
  result.answer.Bhat -= Eigen::MatrixXd(MinvJt * compliance.solve(J * result.answer.Bhat));
  return result;
}

/// Rows of an answer that both robots have, by name of the subsystem.
template <class Tree>
Eigen::MatrixXd rows_of(const Tree& tree, const Answer& answer, const std::vector<std::string>& names)
{
  Eigen::MatrixXd rows(0, answer.Bhat.cols() + 1);
  for (const std::string& name : names) {
    const Index i = tree.index(name);
    const Index begin = tree.node(i).v, end = i + 1 < tree.size() ? tree.node(i + 1).v : tree.n_v();
    rows.conservativeResize(rows.rows() + end - begin, Eigen::NoChange);
    rows.bottomRows(end - begin) << answer.qdd0.segment(begin, end - begin), answer.Bhat.middleRows(begin, end - begin);
  }
  return rows;
}

inline constexpr double eps = std::numeric_limits<double>::epsilon();

}  // namespace iim::test
