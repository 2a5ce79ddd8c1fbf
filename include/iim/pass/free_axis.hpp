// A free frame moves by six columns, one of which is that of a joint on it: free_inward.hpp, free_root.hpp.
#pragma once

#include <iim/body.hpp>
#include <iim/numerics/array.hpp>
#include <iim/numerics/triple.hpp>
#include <iim/pass/joint_lines.hpp>
#include <iim/scalar.hpp>
#include <iim/spatial.hpp>
#include <iim/tree_data.hpp>

#include <cmath>
#include <cstddef>

namespace iim::detail {

/// The joint `child` that carries most of what hangs on a free frame, and its column S; in square-root form also what
/// two such joints of several velocities have in common.
template <class Scalar>
struct FreeAxis {
  Index frame;
  Index child;                                       ///< −1: none
  Scalar turning = Scalar(1);                        ///< matrix form: length of the angular part of S
  Vector6<Scalar> common = Vector6<Scalar>::Zero();  ///< S without `child`: about the frame's origin, in its axes
  // Matrix form: about the frame's point, in the axes of its A.
  /// The limbs that begin with `child` or another joint about its line (WorkspaceData::limbs).
  std::size_t first_limb = 0, end_of_limbs = 0;
  /// FrameState that takes what they hand on; −1: the frame's own, where nothing comes later.
  Index receiver = -1;
  Vector6<Scalar> S = Vector6<Scalar>::Unit(5);
  Vector6<Scalar> held = Vector6<Scalar>::Zero();  ///< of what the limbs hand on, A' S; then A S of all
  Scalar force = Scalar(0);   ///< of what the limbs hand on, Sᵀ p'; then Sᵀ p of all but bias accelerations
  Scalar within = Scalar(0);  ///< Sᵀ A' S of what the limbs hand on
  TriplePair<Scalar> size{};  ///< of all else that the frame carries, and Sᵀ loss (roundings.hpp)
  Scalar loss = Scalar(0);
  // What moves the frame apart from S, in world axes: V̇ = E e + S·rate, rate = last·e₅, for C e of M̄_R⁻¹ = C Cᵀ.
  Matrix6<Scalar> E = Matrix6<Scalar>::Zero();
  Scalar last = Scalar(0);
  Vector6<Scalar> rest = Vector6<Scalar>::Zero();  ///< of the O(n) pass, V̇ = rest + S·rate
  Scalar rate = Scalar(0);
};

/// A limb on a free frame whose first joint, `child`, has the axis' S or −S for its column S_i.
template <class Scalar>
struct FreeLimb {
  Index child;
  std::size_t axis;  ///< which of WorkspaceData::free_axes
  Sense sense;
  // As in FreeAxis, but along S_i.
  Vector6<Scalar> S = Vector6<Scalar>::Zero();
  Vector6<Scalar> held = Vector6<Scalar>::Zero();
  Scalar force = Scalar(0), within = Scalar(0);
  Scalar slip = Scalar(0);    ///< 1 − W S_i: what rotors and springs within hold
  Scalar undone = Scalar(1);  ///< W S_i
};

/// Of each subsystem the moment of what it carries about its coupling point, at most.
template <class Scalar>
[[gnu::cold]] Array<Scalar> moments_about_joints(const TreeData<Scalar>& tree)
{
  using std::sqrt;
  const auto at = [](Index i) { return static_cast<std::size_t>(i); };
  const auto norm = [](const Vector3<Scalar>& x) { return Scalar(sqrt(x(0) * x(0) + x(1) * x(1) + x(2) * x(2))); };
  Array<Scalar> mass(at(tree.size()), Scalar(0)), lever = mass, moments = mass;
  for (Index i = tree.size(); i-- > 0;) {
    const Node& node = tree.node(i);
    for (Index f = node.frame; f < tree.end_of_frames(i); ++f) {
      const FrameMass<Scalar>& body = tree.frame_mass(f);
      if (!body.present) { continue; }
      mass[at(i)] += body.mass;
      moments[at(i)] += sum_of_moments(body.central_inertia);
      lever[at(i)] = larger(lever[at(i)], norm(body.com));
    }
    if (node.parent >= 0) {
      mass[at(node.parent)] += mass[at(i)];
      moments[at(node.parent)] += moments[at(i)];
      Scalar& longest = lever[at(node.parent)];
      longest = larger(longest, Scalar(norm(tree.placement(i).p) + lever[at(i)]));
    }
    moments[at(i)] += mass[at(i)] * lever[at(i)] * lever[at(i)];
  }
  return moments;
}

/// Whether a free frame's own body turns so easily about its axis that what other limbs about that line hand on would
/// be too large for it. (Kept apart where it is not, they cost robots on four legs 4 % of one state's time, and 4 to
/// 6 % of several states'.)
template <class Scalar>
[[gnu::cold]] bool is_outweighed(const FreeAxis<Scalar>& axis, const JointLines<Scalar>& lines,
                                 const Array<Scalar>& moments, const TreeData<Scalar>& tree)
{
  Scalar others(0);
  for (const Node& node : tree.nodes()) {
    if (node.inlet != axis.frame || node.index == axis.child) { continue; }
    if (lines.against_other(node.index, axis.child, tree) == Sense::none) { continue; }
    others += moments[static_cast<std::size_t>(node.index)];
  }
  const FrameMass<Scalar>& body = tree.frame_mass(axis.frame);
  if (!body.present) { return ScalarTraits<Scalar>::is_positive(others); }
  const Vector3<Scalar> a = lines.direction(axis.child, tree);
  Vector3<Scalar> arm = body.com;
  for (int i = 0; i < 3; ++i) { arm(i) -= tree.placement(axis.child).p(i); }
  const Vector3<Scalar> moved = cross(a, arm);
  const Scalar own = a.dot(times(body.central_inertia, a)) + body.mass * moved.dot(moved);
  return ScalarTraits<Scalar>::is_positive(others - Scalar(16) * own);
}

}  // namespace iim::detail
