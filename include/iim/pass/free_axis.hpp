// A free frame moves by six columns, one of which is that of a joint on it: free_inward.hpp, free_root.hpp.
#pragma once

#include <iim/numerics/triple.hpp>
#include <iim/pass/joint_lines.hpp>
#include <iim/spatial.hpp>

#include <cstddef>

namespace iim::detail {

/// The joint `child` that carries most of what hangs on a free frame, and its column S.
template <class Scalar>
struct FreeAxis {
  Index frame;
  Index child;  ///< −1: none
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

}  // namespace iim::detail
