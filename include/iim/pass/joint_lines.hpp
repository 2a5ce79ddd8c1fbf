// Joints about one line, or along one direction, whatever the state: what passes through one of two such joints is not
// felt by the other but for its load. As A' S = 0 and Sᵀp' = ±τ hold exactly, nothing of them is to be taken from sums,
// which have them up to roundings of all that passes (weak_pivot.hpp, free_inward.hpp, square_root.hpp).
#pragma once

#include <iim/numerics/array.hpp>
#include <iim/scalar.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>
#include <iim/tree_data.hpp>

#include <cstddef>

namespace iim::detail {

/// Of two joints about one line.
enum class Sense : signed char {
  opposite = -1,
  none = 0,  ///< they have no line in common
  same = 1
};
/// x along one joint's column, as it is along the other's.
template <class Scalar>
[[gnu::always_inline]] inline Scalar in_sense(Sense sense, const Scalar& x)
{
  return sense == Sense::opposite ? Scalar(-x) : x;
}

/// Of each subsystem the line that it turns about, or the direction it slides along, its frame's coupling point on it.
template <class Scalar>
class JointLines {
  /// In axes of some frame.
  struct Line {
    Vector3<Scalar> direction{Scalar(0), Scalar(0), Scalar(0)};  ///< 0: neither turns nor slides
    bool turns = false;
  };

public:
  /// Of none of so many subsystems yet.
  [[gnu::cold]] explicit JointLines(Index subsystems) : lines_(static_cast<std::size_t>(subsystems)) {}

  /// Of subsystem i.
  template <class S>
  void set(Index i, const S& s)
  {
    if constexpr (has_unit_column<S>()) {
      lines_[at(i)] = {S::pattern.angular ? angular(s.own_twist()) : linear(s.own_twist()), S::pattern.angular};
    }
  }

  /// Of subsystem i, in the axes of the frame that it hangs on.
  Vector3<Scalar> direction(Index i, const TreeData<Scalar>& tree) const { return placed(i, tree).direction; }
  /// Its twist in these axes, about that frame's origin; 0 if it neither turns nor slides.
  Vector6<Scalar> twist(Index i, const TreeData<Scalar>& tree) const
  {
    const Line line = placed(i, tree);
    const Vector3<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
    Vector6<Scalar> V;
    if (line.turns) {
      detail::set(V, cross(tree.placement(i).p, line.direction), line.direction);
    } else {
      detail::set(V, line.direction, zero);
    }
    return V;
  }
  /// Of subsystem i against the joint that its inlet hangs on.
  Sense against_inlet(Index i, const TreeData<Scalar>& tree) const
  {
    const Index parent = tree.node(i).parent;
    const Vector3<Scalar> origin(Scalar(0), Scalar(0), Scalar(0));
    return parent < 0 ? Sense::none : compare(lines_[at(parent)], origin, placed(i, tree), tree.placement(i).p);
  }
  /// Of subsystem i against another one on the same frame.
  Sense against_other(Index i, Index other, const TreeData<Scalar>& tree) const
  {
    return compare(placed(other, tree), tree.placement(other).p, placed(i, tree), tree.placement(i).p);
  }

private:
  /// In the axes of the frame that it hangs on.
  Line placed(Index i, const TreeData<Scalar>& tree) const
  {
    const Line& line = lines_[at(i)];
    return {times(tree.placement(i).R, line.direction), line.turns};
  }

  [[gnu::cold]] static Sense compare(const Line& one, const Vector3<Scalar>& at_one, const Line& other,
                                     const Vector3<Scalar>& at_other)
  {
    const auto positive = [](const Scalar& x) { return ScalarTraits<Scalar>::is_positive(x); };
    const Scalar length = one.direction.squaredNorm(), tolerance = Scalar(16) * Eigen::NumTraits<Scalar>::epsilon();
    if (one.turns != other.turns || !positive(length) || !positive(other.direction.squaredNorm())) {
      return Sense::none;
    }
    const auto is_along = [&](const Vector3<Scalar>& x, const Scalar& size) {  // up to roundings of x, squared
      return !positive(cross(one.direction, x).squaredNorm() - tolerance * tolerance * length * size);
    };
    const Vector3<Scalar> between = at_other - at_one;
    const bool share = is_along(other.direction, other.direction.squaredNorm()) &&
                       (!one.turns || is_along(between, at_one.squaredNorm() + at_other.squaredNorm()));
    if (!share) { return Sense::none; }
    return positive(one.direction.dot(other.direction)) ? Sense::same : Sense::opposite;
  }

  Array<Line> lines_;
};

}  // namespace iim::detail
