// Chains that turn about one direction, oblique to the world's axes: their inertias are kept in axes of their own.
//
// Across its plane a chain of n links is one rigid body, whose inertia grows like n³; in the plane its joints take all but a
// link's from it. In axes of which one is the joints' both stand in entries of their own. In other axes each entry has a
// share of both, and the roundings of the large one are what is left of the small one: 100 links lose three digits.
//
// So joints that hang on one another and are parallel, whatever q, form a group. Where its direction is not a coordinate
// axis of the world at the state, A and h of the group's frames (FrameState) are in the group's axes, all else of it turns
// there and back around its step inward, and what it hands on to another group or to the world turns once.
#pragma once

#include <iim/scalar.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>

#include <cstddef>
#include <type_traits>
#include <utility>
#include <vector>

namespace iim::detail {

/// Joints of one direction, in the axes of the frame that each moves.
template <class Scalar>
struct ParallelGroup {
  Vector3<Scalar> axis;        ///< of the first joint, in its frame's axes
  Matrix3<Scalar> own;         ///< the group's axes in these
  Matrix3<Scalar> R = own;     ///< the group's axes in the world's
  bool turned = false;         ///< whether they are used at the state; else the world's
  Index frame;                 ///< that the first joint moves
  int joints = 0;
};

/// a ← Qᵀ a, or back: Q a, for triples a that lie one behind the other.
template <class Scalar>
[[gnu::noinline]] void turn_triples(const Matrix3<Scalar>& Q, bool back, Scalar* triples, int count)
{
  for (Scalar* a = triples; a != triples + 3 * count; a += 3) {
    const Vector3<Scalar> x(a[0], a[1], a[2]);
    for (int i = 0; i < 3; ++i) {
      a[i] = back ? Scalar(Q(i, 0) * x(0) + Q(i, 1) * x(1) + Q(i, 2) * x(2))
                  : Scalar(Q(0, i) * x(0) + Q(1, i) * x(1) + Q(2, i) * x(2));
    }
  }
}

/// Y += E X Eᵀ for a block X of A. Of a symmetric block the upper triangle, where no other is kept.
template <class Scalar, class Block>
void add_turned(const Matrix3<Scalar>& E, const Matrix6<Scalar>& A, int row, int column, Block& Y)
{
  Matrix3<Scalar> X;
  for (int j = 0; j < 3; ++j) {
    for (int i = 0; i < 3; ++i) { X(i, j) = A(row + i, column + j); }
  }
  X = turned(E, X);
  for (int j = 0; j < 3; ++j) {
    for (int i = 0; i <= (std::is_same_v<Block, Symmetric3<Scalar>> ? j : 2); ++i) { Y(i, j) += X(i, j); }
  }
}

template <class S>
constexpr bool turns_about_axis()
{
  return has_own_twist<S>() && S::pattern.angular;
}
/// Whether a subsystem may belong to a group.
template <class S>
constexpr bool shares_axes()
{
  return S::n_frames == 1 && S::n_i <= 1 && (turns_about_axis<S>() || !S::pattern.angular);
}

/// The groups of a tree, and their axes at a state.
template <class Scalar>
class ParallelAxes {
public:
  using Group = ParallelGroup<Scalar>;
  /// Fewer joints lose no more than two bits (5 links: 14 ε of B̂; 7: 30), which turning would cost a third of the pass.
  static constexpr int fewest_joints = 6;

  ParallelAxes() = default;

  template <class Tree>
  [[gnu::cold]] explicit ParallelAxes(const Tree& tree) : group_(static_cast<std::size_t>(tree.n_frames()), -1)
  {
    std::vector<Vector3<Scalar>> axis(group_.size());
    tree.outward([&]<class N, class S>(const N& node, const S& s) {
      if constexpr (shares_axes<S>()) {
        const auto at = static_cast<std::size_t>(node.frame);
        const Index of_inlet = node.inlet < 0 ? -1 : group_[static_cast<std::size_t>(node.inlet)];
        Vector3<Scalar> inherited(Scalar(0), Scalar(0), Scalar(0));
        if (of_inlet >= 0) {
          const Vector3<Scalar>& there = axis[static_cast<std::size_t>(node.inlet)];
          for (int i = 0; i < 3; ++i) {
            inherited(i) = dot(column(tree.placement(node.index).R, i), triple(there));
          }
        }
        if constexpr (turns_about_axis<S>()) {
          const Vector6<Scalar> twist = s.own_twist();
          axis[at] = angular(twist);
          const bool joins = of_inlet >= 0 && nearly_zero(cross(axis[at], inherited));
          group_[at] = joins ? of_inlet : static_cast<Index>(groups_.size());
          if (!joins) { groups_.push_back({.axis = axis[at], .own = with_axis(axis[at]), .frame = node.frame}); }
          ++groups_[static_cast<std::size_t>(group_[at])].joints;
        } else {
          axis[at] = inherited;
          group_[at] = of_inlet;
        }
      }
    });
    join_free(tree);
    keep_large();
  }

  /// Whether any group is turned.
  bool turned() const { return turned_; }
  /// Axes of A and h of a frame in the world's; null: the world's.
  const Matrix3<Scalar>* of(Index frame) const
  {
    if (frame < 0 || !turned_) { return nullptr; }
    const Index group = group_[static_cast<std::size_t>(frame)];
    if (group < 0 || !groups_[static_cast<std::size_t>(group)].turned) { return nullptr; }
    return &groups_[static_cast<std::size_t>(group)].R;
  }

  bool empty() const { return groups_.empty(); }
  /// Whether A of both frames is in the same axes at any state.
  bool share(Index frame, Index other) const
  {
    return group_[static_cast<std::size_t>(frame)] == group_[static_cast<std::size_t>(other)];
  }

  /// Chooses the axes at a state. orientation(frame): R.
  template <class Orientation>
  void choose(Orientation orientation)
  {
    turned_ = false;
    for (Group& group : groups_) {
      const Matrix3<Scalar>& R = orientation(group.frame);
      group.turned = !along_coordinate(times(R, group.axis));
      if (!group.turned) { continue; }
      turned_ = true;
      multiply(R, group.own, group.R);
      for (int twice = 0; twice < 2; ++twice) { straighten(group.R); }
    }
  }

private:
  /// To some digits: a joint that is not quite parallel may keep its inertia in any axes.
  static bool nearly_zero(const Vector3<Scalar>& a)
  {
    return ScalarTraits<Scalar>::is_positive(Scalar(1.0 / (1 << 28)) - (a(0) * a(0) + a(1) * a(1) + a(2) * a(2)));
  }
  static bool along_coordinate(const Vector3<Scalar>& a)
  {
    const Scalar zero(0);
    return nearly_zero({zero, a(1), a(2)}) || nearly_zero({a(0), zero, a(2)}) || nearly_zero({a(0), a(1), zero});
  }

  /// Axes of which one is a (or −a): 1, turned the short way.
  static Matrix3<Scalar> with_axis(Vector3<Scalar> a)
  {
    int m = 0;
    while (m < 2 && !ScalarTraits<Scalar>::is_positive(a(m) * a(m) - Scalar(0.25))) { ++m; }
    if (!ScalarTraits<Scalar>::is_positive(a(m))) { a = -a; }
    Vector3<Scalar> e(Scalar(0), Scalar(0), Scalar(0));
    e(m) = Scalar(1);
    const Matrix3<Scalar> V = skew(cross(e, a));
    Matrix3<Scalar> axes, V_squared;
    multiply(V, V, V_squared);
    for (int k = 0; k < 9; ++k) {
      axes.data()[k] = Scalar(k % 4 == 0 ? 1 : 0) + V.data()[k] + V_squared.data()[k] * (Scalar(1) / (Scalar(1) + a(m)));
    }
    return axes;
  }

  /// A free frame joins the largest group on it.
  template <class Tree>
  [[gnu::cold]] void join_free(const Tree& tree)
  {
    const auto at = [](Index k) { return static_cast<std::size_t>(k); };
    tree.outward([&]<class N, class S>(const N& node, const S&) {
      if constexpr (is_free<S>()) {
        for (Index i = node.index + 1; i < node.subtree_end; i = tree.node(i).subtree_end) {
          const Index other = group_[at(tree.node(i).frame)], own = group_[at(node.frame)];
          if (other >= 0 && (own < 0 || groups_[at(own)].joints < groups_[at(other)].joints)) { group_[at(node.frame)] = other; }
        }
      }
    });
  }

  [[gnu::cold]] void keep_large()
  {
    std::vector<Index> number;
    std::vector<Group> large;
    for (const Group& group : groups_) {
      number.push_back(group.joints < fewest_joints ? Index(-1) : static_cast<Index>(large.size()));
      if (number.back() >= 0) { large.push_back(group); }
    }
    for (Index& group : group_) {
      if (group >= 0) { group = number[static_cast<std::size_t>(group)]; }
    }
    groups_ = std::move(large);
  }

  std::vector<Index> group_;  // of a frame; −1: none
  std::vector<Group> groups_;
  bool turned_ = false;
};

}  // namespace iim::detail
