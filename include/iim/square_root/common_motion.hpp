// What two joints of several velocities on one free frame have in common, in every state: of two balls the turn about
// the line through their centres, of two planes the slide along the line where they meet, of a ball and a plane the
// turn about the normal through the ball's centre, of two universal joints the turn about their first axes if these are
// one line.
//
// Nothing of what limbs pass on through such joints acts along that motion but their loads, as of joints about one line
// (joint_lines.hpp): a frame far lighter than its limbs moves along it by what acts on its own body alone.
#pragma once

#include <iim/numerics/array.hpp>
#include <iim/scalar.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>
#include <iim/tree_data.hpp>

#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>

namespace iim::detail {

/// Of subsystems with inlet_twists() what these span, seen from the frame that they hang on.
template <class Scalar>
class InletTwists {
  using Twist = Vector6<Scalar>;
  struct Basis {
    Index subsystem = -1;
    int size = 0;
    std::array<Twist, 6> column;
  };

public:
  template <class S>
  [[gnu::cold]] void add(const Node& node, const S& s, const TreeData<Scalar>& tree)
  {
    if constexpr (has_inlet_twists<S>()) {
      const auto twists = s.inlet_twists();
      Basis basis;
      basis.subsystem = node.index;
      for (Index d = 0; d < twists.cols(); ++d) { put(placed(twists.col(d), node.index, tree), basis); }
      known_.push_back(basis);
    }
  }

  bool is_known(Index i) const { return basis(i).size > 0; }

  /// Whether subsystem i can always move along V, about the origin of the frame that it hangs on, in its axes. Not
  /// along none, 0.
  [[gnu::cold]] bool contain(Index i, const Twist& V) const
  {
    return ScalarTraits<Scalar>::is_positive(V.squaredNorm()) && is_known(i) && is_small(beyond(basis(i), V), V);
  }

  /// What two subsystems on one frame can both always move along, as such a V; the first such of several.
  [[gnu::cold]] std::optional<Twist> common(Index one, Index other) const
  {
    const Basis& first = basis(one);
    Basis left = basis(other), rest = left;  // rest: what is beyond `first` of the motions `left`
    if (first.size == 0) { return std::nullopt; }
    for (int d = 0; d < rest.size; ++d) { rest.column[at(d)] = beyond(first, left.column[at(d)]); }
    for (int step = 0; step < left.size; ++step) {
      int largest = step;
      for (int d = step; d < left.size; ++d) {
        if (is_small(rest.column[at(d)], left.column[at(d)])) { return tidy(left.column[at(d)]); }
        const Scalar more = rest.column[at(d)].squaredNorm() - rest.column[at(largest)].squaredNorm();
        if (ScalarTraits<Scalar>::is_positive(more)) { largest = d; }
      }
      std::swap(rest.column[at(largest)], rest.column[at(step)]);
      std::swap(left.column[at(largest)], left.column[at(step)]);
      const Twist pivot = rest.column[at(step)];
      for (int d = step + 1; d < left.size; ++d) {
        const Scalar share = pivot.dot(rest.column[at(d)]) / pivot.squaredNorm();
        rest.column[at(d)] -= pivot * share;
        left.column[at(d)] -= left.column[at(step)] * share;
      }
    }
    return std::nullopt;
  }

private:
  [[gnu::cold]] const Basis& basis(Index i) const
  {
    static const Basis none;
    for (const Basis& known : known_) {
      if (known.subsystem == i) { return known; }
    }
    return none;
  }

  static Twist twist(const Vector3<Scalar>& v, const Vector3<Scalar>& omega)
  {
    Twist V;
    set(V, v, omega);
    return V;
  }

  /// From the subsystem's inlet coupling point to the origin of the frame.
  [[gnu::cold]] static Twist placed(const Twist& V, Index i, const TreeData<Scalar>& tree)
  {
    const auto& on = tree.placement(i);
    const Vector3<Scalar> omega = times(on.R, angular(V));
    Vector3<Scalar> v = times(on.R, linear(V));
    v += cross(on.p, omega);
    return twist(v, omega);
  }

  [[gnu::cold]] static void put(const Twist& V, Basis& basis)
  {
    using std::sqrt;
    const Twist rest = beyond(basis, beyond(basis, V));
    basis.column[at(basis.size++)] = rest * (Scalar(1) / Scalar(sqrt(rest.squaredNorm())));
  }

  [[gnu::cold]] static Twist beyond(const Basis& basis, Twist V)
  {
    for (int d = 0; d < basis.size; ++d) {
      const Twist& q = basis.column[at(d)];
      V -= q * Scalar(q.dot(V));
    }
    return V;
  }

  /// Up to roundings.
  static bool is_small(const Twist& rest, const Twist& V)
  {
    const Scalar tolerance = Scalar(64) * Eigen::NumTraits<Scalar>::epsilon();
    return !ScalarTraits<Scalar>::is_positive(rest.squaredNorm() - tolerance * tolerance * V.squaredNorm());
  }

  /// A slide does not turn by roundings; what turns does so by 1.
  [[gnu::cold]] static Twist tidy(const Twist& V)
  {
    using std::sqrt;
    const Vector3<Scalar> zero(Scalar(0), Scalar(0), Scalar(0)), v = linear(V), omega = angular(V);
    const Scalar turns = omega.squaredNorm(), slides = v.squaredNorm();
    const Scalar tolerance = Scalar(64) * Eigen::NumTraits<Scalar>::epsilon();
    const bool turning = ScalarTraits<Scalar>::is_positive(turns - tolerance * tolerance * slides);
    const Scalar scale = Scalar(1) / Scalar(sqrt(turning ? turns : slides));
    return twist(v, turning ? omega : zero) * scale;
  }

  Array<Basis> known_;  // orthonormal
};

/// What two joints on a free frame have in common, and what the lighter of the two limbs weighs.
template <class Scalar>
struct CommonMotion {
  Vector6<Scalar> twist = Vector6<Scalar>::Zero();
  Scalar carried = Scalar(0);
};

/// Of the heaviest two; nothing (0 kg) if no two joints on the frame have a motion in common.
template <class Scalar>
[[gnu::cold]] CommonMotion<Scalar> heaviest_common(Index frame, const InletTwists<Scalar>& twists,
                                                   const Array<Scalar>& carried, const TreeData<Scalar>& tree)
{
  CommonMotion<Scalar> most;
  for (const Node& one : tree.nodes()) {
    if (one.inlet != frame || !twists.is_known(one.index)) { continue; }
    for (const Node& other : tree.nodes()) {
      if (other.inlet != frame || other.index <= one.index || !twists.is_known(other.index)) { continue; }
      const Scalar &first = carried[static_cast<std::size_t>(one.index)],
                   &second = carried[static_cast<std::size_t>(other.index)], &lighter = second < first ? second : first;
      if (!(most.carried < lighter)) { continue; }
      if (const auto twist = twists.common(one.index, other.index)) { most = {*twist, lighter}; }
    }
  }
  return most;
}

}  // namespace iim::detail
