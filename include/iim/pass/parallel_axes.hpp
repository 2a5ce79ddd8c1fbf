// Chains that turn about one direction, oblique to the world's axes: their inertias are kept in axes of their own.
//
// Across its plane a chain of n links is one rigid body, whose inertia grows like n³; in the plane its joints take all
// but a link's from it. In axes of which one is the joints' both stand in entries of their own. In other axes each
// entry has a share of both, and the roundings of the large one are what is left of the small one: 100 links lose three
// digits.
//
// So joints that hang on one another and are parallel, whatever q, form a group. Where its direction is not a
// coordinate axis of the world at the state, A and h of the group's frames (FrameState) are in the group's axes, all
// else of it turns there and back around its step inward, and what it hands on to another group or to the world turns
// once.
//
// The same in small is a link that is thin about its joint's axis, between joints that turn about others: in any axes
// but the joint's, the thin moment is a difference of large entries. One such joint loses little; many in a row do, the
// more the longer the limb. There each joint has axes of its own (thinness), unless small pivots are mended, which
// leaves less of an error and costs a quarter as much (weak_pivot.hpp). (Bars a third as wide as long, joints at
// random, 100 of them: over 16 ε of B̂ for 3 of 20 states, worst 31 ε; in the world's axes for all, 305 ε. A tenth as
// wide, x, y, z in turn, 31 of them: for 8, 28 ε; in the world's for 17, 948 ε. Mended 1, 21 ε, or without fused
// operations 140, and none, 8 ε.)
#pragma once

#include <iim/body.hpp>
#include <iim/numerics/array.hpp>
#include <iim/pass/type_facts.hpp>
#include <iim/scalar.hpp>
#include <iim/spatial.hpp>
#include <iim/tree_data.hpp>

#include <array>
#include <cstddef>
#include <type_traits>
#include <utility>

namespace iim::detail {

/// Joints of one direction, in the axes of the frame that each moves.
template <class Scalar>
struct ParallelGroup {
  Vector3<Scalar> axis;     ///< of the first joint, in its frame's axes
  Matrix3<Scalar> own;      ///< the group's axes in these
  Matrix3<Scalar> R = own;  ///< the group's axes in the world's
  bool turned = false;      ///< whether they are used at the state; else the world's
  Index frame;              ///< that the first joint moves
  Index limb;               ///< the subsystem that its limb begins with
  int joints = 0;
};

/// R, by columns.
template <class Scalar>
struct Columns {
  Triple<Scalar> e0, e1, e2;
  [[gnu::always_inline]] explicit Columns(const Matrix3<Scalar>& R)
      : e0(column(R, 0)), e1(column(R, 1)), e2(column(R, 2))
  {
  }
  [[gnu::always_inline]] Triple<Scalar> operator*(const Triple<Scalar>& x) const
  {
    return e0 * x(0) + e1 * x(1) + e2 * x(2);
  }
};

/// Rᵀ.
template <class Scalar>
struct TransposedRotation {
  std::array<Triple<Scalar>, 3> e;
  [[gnu::always_inline]] explicit TransposedRotation(const std::array<Triple<Scalar>, 3>& columns) : e(columns) {}
  [[gnu::always_inline]] explicit TransposedRotation(const Matrix3<Scalar>& R)
      : e{column(R, 0), column(R, 1), column(R, 2)}
  {
  }
  [[gnu::always_inline]] Triple<Scalar> operator*(const Triple<Scalar>& x) const
  {
    return {dot(e[0], x), dot(e[1], x), dot(e[2], x)};
  }
};
template <class Scalar>
  requires three_in_register<Scalar>
struct TransposedRotation<Scalar> {
  ColumnBlock<Scalar> rows;
  [[gnu::always_inline]] explicit TransposedRotation(const std::array<Triple<Scalar>, 3>& columns)
      : rows(ColumnBlock<Scalar>{columns}.transposed())
  {
  }
  [[gnu::always_inline]] explicit TransposedRotation(const Matrix3<Scalar>& R)
      : rows(ColumnBlock<Scalar>{{column(R, 0), column(R, 1), column(R, 2)}}.transposed())
  {
  }
  [[gnu::always_inline]] Triple<Scalar> operator*(const Triple<Scalar>& x) const { return rows * x; }
};

/// a ← Q a, or with Qᵀ, for triples a that lie one behind the other.
template <class Scalar, class Rotation>
[[gnu::always_inline]] inline void turn_each(const Rotation& Q, Scalar* triples, int count)
{
  for (Scalar* a = triples; a != triples + 3 * count; a += 3) { (Q * Triple<Scalar>(a)).put(a); }
}
/// a ← Qᵀ a, or back: Q a.
template <class Scalar>
[[gnu::noinline]] void turn_triples(const Matrix3<Scalar>& Q, bool back, Scalar* triples, int count)
{
  if (back) {
    turn_each(Columns<Scalar>(Q), triples, count);
  } else {
    turn_each(TransposedRotation<Scalar>(Q), triples, count);
  }
}

/// E X Eᵀ for a block X of A; of a symmetric block the upper triangle, where no other is kept.
template <class Scalar, class Block>
[[gnu::always_inline]] inline Block turned_block(const Matrix3<Scalar>& E, const Block& X)
{
  Block result;
  if constexpr (three_in_register<Scalar>) {
    const ColumnBlock<Scalar> axes{{column(E, 0), column(E, 1), column(E, 2)}};
    const ColumnBlock<Scalar> EX{{axes * X.column[0], axes * X.column[1], axes * X.column[2]}};
#pragma GCC unroll 8
    for (int j = 0; j < 3; ++j) { result.column[static_cast<std::size_t>(j)] = EX.times(E(j, 0), E(j, 1), E(j, 2)); }
  } else {
    Matrix3<Scalar> whole;
    for (int j = 0; j < 3; ++j) {
      for (int i = 0; i < 3; ++i) { whole(i, j) = X(i, j); }
    }
    whole = turned(E, whole);
    for (int j = 0; j < 3; ++j) {
      for (int i = 0; i <= (std::is_same_v<Block, Symmetric3<Scalar>> ? j : 2); ++i) { result(i, j) = whole(i, j); }
    }
  }
  return result;
}

/// The groups of a tree, and their axes at a state.
template <class Scalar>
class ParallelAxes {
public:
  using Group = ParallelGroup<Scalar>;
  /// Fewer joints lose no more than two bits (5 links: 14 ε of B̂; 7: 30), which turning would cost a third of the pass.
  static constexpr int fewest_joints = 6;
  /// Of the sum of thinness along a limb but for its first joint, whose roundings no other joint has, times the square
  /// of its velocities and its free base's. What is above takes axes of its own, and 50 to 100 ns more for each joint.
  static constexpr int most_thinness = 20000;

  ParallelAxes() = default;

  /// thin_limbs: whether these have axes of their own.
  [[gnu::cold]] ParallelAxes(const TreeData<Scalar>& tree, const Array<TypeFacts<Scalar>>& facts, bool thin_limbs)
      : group_(static_cast<std::size_t>(tree.n_frames()), -1)
  {
    const Limbs limbs = find_groups(tree, facts, thin_limbs);
    join_free(tree, facts);
    keep([&](const Group& group) {
      return group.joints >= fewest_joints || limbs[static_cast<std::size_t>(group.limb)].thin;
    });
  }
  /// Those of two joints and more, which nothing but slides and free bodies moves: across their plane they hold what
  /// they carry.
  [[gnu::cold]] static ParallelAxes of_planes(const TreeData<Scalar>& tree, const Array<TypeFacts<Scalar>>& facts)
  {
    ParallelAxes planes;
    planes.group_.assign(static_cast<std::size_t>(tree.n_frames()), -1);
    planes.find_groups(tree, facts, false);
    planes.keep([&](const Group& group) {
      bool holds = group.joints >= 2;
      for (Index i = tree.node(tree.owner(group.frame)).parent; i >= 0; i = tree.node(i).parent) {
        const TypeFacts<Scalar>& part = facts[static_cast<std::size_t>(i)];
        holds = holds && (part.is_free || part.velocities == 0 || (part.shares_axes && !part.turns_about_axis));
      }
      return holds;
    });
    return planes;
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
  /// Whether a frame's may be turned.
  bool has_group(Index frame) const { return !empty() && group_[static_cast<std::size_t>(frame)] >= 0; }
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
      straighten(group.R);
    }
  }

private:
  /// What leads to a subsystem from the first of its limb on, which hangs on the world or a free base.
  struct Limb {
    Index first = -1;
    Scalar velocities = Scalar(0), thinness = Scalar(0);  ///< of the joints, those of the base included
    bool thin = false;                                    ///< of the first: whether some joint of the limb loses digits
  };
  using Limbs = Array<Limb>;

  /// Groups of one joint and more; the limbs, by their first subsystem.
  [[gnu::cold]] Limbs find_groups(const TreeData<Scalar>& tree, const Array<TypeFacts<Scalar>>& facts, bool thin_limbs)
  {
    const auto at = [](Index k) { return static_cast<std::size_t>(k); };
    Array<Vector3<Scalar>> axis(group_.size());
    Limbs limbs(at(tree.size()));
    for (const Node& node : tree.nodes()) {
      const TypeFacts<Scalar>& part = facts[at(node.index)];
      Limb& limb = limbs[at(node.index)];
      if (node.parent >= 0) { limb = limbs[at(node.parent)]; }
      if (part.is_free) {
        limb.velocities = Scalar(part.velocities);
      } else if (limb.first < 0) {
        limb.first = node.index;
      }
      if (!part.shares_axes) { continue; }
      const Index of_inlet = node.inlet < 0 ? -1 : group_[at(node.inlet)];
      Index& own = group_[at(node.frame)];
      Vector3<Scalar> inherited(Scalar(0), Scalar(0), Scalar(0));
      if (of_inlet >= 0) { inherited = transposed_times(tree.placement(node.index).R, axis[at(node.inlet)]); }
      if (!part.turns_about_axis) {
        axis[at(node.frame)] = inherited;
        own = of_inlet;
        continue;
      }
      axis[at(node.frame)] = part.axis;
      const bool joins = of_inlet >= 0 && nearly_zero(cross(part.axis, inherited));
      own = joins ? of_inlet : static_cast<Index>(groups_.size());
      if (!joins) {
        groups_.push_back({.axis = part.axis, .own = with_axis(part.axis), .frame = node.frame, .limb = limb.first});
      }
      ++groups_[at(own)].joints;
      limb.velocities += Scalar(1);
      if (node.index != limb.first) { limb.thinness += part.thinness; }
      const Scalar loss = limb.thinness * limb.velocities * limb.velocities;
      if (thin_limbs && ScalarTraits<Scalar>::is_positive(loss - Scalar(most_thinness))) {
        limbs[at(limb.first)].thin = true;
      }
    }
    return limbs;
  }

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
      axes.data()[k] =
          Scalar(k % 4 == 0 ? 1 : 0) + V.data()[k] + V_squared.data()[k] * (Scalar(1) / (Scalar(1) + a(m)));
    }
    return axes;
  }

  static Vector3<Scalar> transposed_times(const Matrix3<Scalar>& R, const Vector3<Scalar>& x)
  {
    return {dot(column(R, 0), triple(x)), dot(column(R, 1), triple(x)), dot(column(R, 2), triple(x))};
  }

  /// A free frame joins the largest group on it.
  [[gnu::cold]] void join_free(const TreeData<Scalar>& tree, const Array<TypeFacts<Scalar>>& facts)
  {
    const auto at = [](Index k) { return static_cast<std::size_t>(k); };
    for (const Node& node : tree.nodes()) {
      if (!facts[at(node.index)].is_free) { continue; }
      Index& own = group_[at(node.frame)];
      for (Index i = node.index + 1; i < node.subtree_end; i = tree.node(i).subtree_end) {
        const Index other = group_[at(tree.node(i).frame)];
        if (other >= 0 && (own < 0 || groups_[at(own)].joints < groups_[at(other)].joints)) { own = other; }
      }
    }
  }

  /// Of the groups those that are needed(group).
  template <class Needed>
  [[gnu::cold]] void keep(Needed&& needed)
  {
    Array<Index> number;
    Array<Group> kept;
    for (const Group& group : groups_) {
      const bool stays = needed(group);
      number.push_back(stays ? static_cast<Index>(kept.size()) : Index(-1));
      if (stays) { kept.push_back(group); }
    }
    for (Index& group : group_) {
      if (group >= 0) { group = number[static_cast<std::size_t>(group)]; }
    }
    groups_ = std::move(kept);
  }

  Array<Index> group_;  // of a frame; −1: none
  Array<Group> groups_;
  bool turned_ = false;
};

}  // namespace iim::detail
