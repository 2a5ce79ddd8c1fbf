// Pivots that are small against the inertia that they stand in, in the projected form.
//
// Where thin parts lie along a joint's axis, as a wrist that is stretched along the forearm, D = Sᵀ A S is a difference
// of large entries of A, and wrong by ‖A‖/D roundings; with D all that M⁻¹ says of this joint. By Gauss's principle D
// is also
//
//     D = Σ_b a_bᵀ I_b a_b + Σ_r J_r (g_r a)²,        a: q̈_i = 1, and beyond it q̈_j = −W_j y_j
//
// over all bodies and rotors from the joint on, that is what the joint moves where the joints beyond it are free. Of
// all motions beyond this is the least such sum, so that errors of W count by their squares only; it has no
// differences, and the moments of a body meet the motion in its own axes. What hangs on the joint's children counts in
// one (why: bodies_beyond.hpp).
//
// A' = PᵀA P would bring the roundings of A along S in again, times ‖W‖². As A' S = 0, it is taken across S alone:
//
//     A' = E (A − ½ (U W + Wᵀ Uᵀ)) E,        E = 1 − S Sᵀ
//
// however weak the pivot, if it does not count as zero: joints about one line with a light link between them lose what
// that link is lighter by (10⁻³: 2500 ε of B̂, with this 3). It is for the first weak pivot on the way inward, and for
// those behind it along whose axis it has lost nothing (roundings.hpp), as in joints about one line. In others the
// roundings of A, U and D hang together, and are better left together (masses × 10 per link, 12 links: thirty times
// worse with this than without; B̂ of an arm under a load of 10⁶ kg a thousand times better, but its q̈₀ twice as bad).
//
// Measured (double, B̂, worst of 1000 random states in ε): an arm of six axes whose wrist is of light thin links 61,
// with this 15; a robot with two arms of seven 27 and 9. Where a pivot's roundings would not be seen beside larger
// parts of M⁻¹ nothing is done: of the robots tried two humanoids have such a pivot in half of their states, which take
// 5 % longer, a biped without gears in a quarter, arms in up to one in six; chains and trees have none.
//
// Of several velocities, and of a free base: mended_root.hpp.
#pragma once

#include <iim/articulated_inertia.hpp>
#include <iim/bodies_beyond.hpp>
#include <iim/carried.hpp>
#include <iim/internal_inertia.hpp>
#include <iim/kinematics.hpp>
#include <iim/roundings.hpp>
#include <iim/second_look.hpp>
#include <iim/spatial.hpp>
#include <iim/spd.hpp>
#include <iim/subsystem.hpp>
#include <iim/workspace.hpp>

#include <array>
#include <cstddef>

namespace iim::detail {

/// Whether the steps of S may: of one frame.
template <class S, class Data>
constexpr bool mends_any()
{
  return mends<Data> && S::n_frames == 1 && !is_free<S>();
}

/// Whether an implicit step adds inertia of springs to D: A' S = 0 is for joints without inertia of their own.
template <class S>
bool is_sprung(const NodeState<S>& state)
{
  for (const auto& spring : state.springs) {
    if (!(spring.inertia == typename S::Scalar(0))) { return true; }
  }
  return false;
}

/// Whether the steps of S do so: of a joint that moves its frame along one unit column, turning it or sliding.
template <class S, class Data>
constexpr bool mends_pivots()
{
  return mends_any<S, Data>() && has_own_twist<S>() && S::pattern.linear != S::pattern.angular;
}

/// S in all six rows.
template <class S>
Vector6<typename S::Scalar> unit_column(const NodeState<S>& state)
{
  using Scalar = typename S::Scalar;
  Vector6<Scalar> column;
  for (int i = 0; i < 6; ++i) {
    column(i) = (i < 3 ? S::pattern.linear : S::pattern.angular) ? state.S_k[0](i, 0) : Scalar(0);
  }
  return column;
}

/// Of a pivot below pivot_tolerance.
template <class Data>
[[gnu::cold, gnu::noinline]] void note_small_pivot(const Node& node, Data& ws, Diagnosis& diagnosis)
{
  if constexpr (looks_again<Data>) {
    ws.second_look().note_small_pivot(node.index);
  } else {
    diagnosis.fail(Status::not_positive_definite, node.index);
  }
}

/// A S and Sᵀ A S of a frame that moves along one column.
template <class Scalar>
struct Pivot {
  TriplePair<Scalar> U;
  Scalar D;  ///< 0: left as it was
};

/// Of a pivot that is small against `scale`. (By value: what a function that is not inlined may write to would not stay
/// in registers.)
template <class S, class Data>
[[gnu::noinline]] Pivot<typename S::Scalar> mended_pivot(const Node& node, const NodeState<S>& state,
                                                         const typename S::Scalar scale, bool springs, Data& ws)
{
  using Scalar = typename S::Scalar;
  using Lane = SixLanes<Scalar>;
  using Sum = FirstWithEach<Lane, Scalar>;
  const FrameState<Scalar>& f = ws.frame(node.frame);
  const TriplePair<Scalar> U = own_column(state, f);
  if (!f.arrived || ws.axes().of(node.frame) != nullptr) { return {U, Scalar(0)}; }
  const Vector6<Scalar> S_0 = unit_column(state);
  Motions<Lane> a;  // along S, and along each of six axes
  Sum sum;
  clear<Scalar>(sum.G);
  sum.G[0] = state.own.D;
  for (int i = 0; i < 6; ++i) {
    Lane& lane = a[static_cast<std::size_t>(i)];
    clear<Scalar>(lane);
    lane[0] = S_0(i);
    lane[i + 1] = Scalar(1);
    sum.G[i + 1] = U(i);
  }
  const auto is_enough = [](const FrameState<Scalar>& at, const Motions<Lane>& motion, const Sum& so_far) {
    if (at.loses) { return false; }
    const TriplePair<Scalar> size = largest(at, at.A);
    Scalar rounding(0);
    for (int i = 0; i < 6; ++i) {
      const Scalar x = motion[static_cast<std::size_t>(i)][0];
      rounding += x * x * size(i);
    }
    return ScalarTraits<Scalar>::is_positive(Scalar(8) * so_far.G[0] - rounding);
  };
  ws.bodies_beyond().add_up_until(is_enough, node, a, springs, ws, sum);
  const Lane& G = sum.G;
  const Scalar rounding = Scalar(64) * Eigen::NumTraits<Scalar>::epsilon();  // of accelerations
  if (!ScalarTraits<Scalar>::is_positive(G[0] - rounding * rounding * (scale + sum.turning))) { return {U, Scalar(0)}; }
  return {{Triple<Scalar>(G[1], G[2], G[3]), Triple<Scalar>(G[4], G[5], G[6])}, G[0]};
}

/// A −= a bᵀ + b aᵀ.
template <class Scalar>
[[gnu::always_inline]] inline void subtract_both(const TriplePair<Scalar>& a, const TriplePair<Scalar>& b,
                                                 SpatialInertia<Scalar>& A)
{
  SixColumns<Scalar, 2> left, right;
  left[0] = right[1] = a;
  left[1] = right[0] = b;
  subtract_product(left, right, A);
}

/// A with A S = U, S a unit column, and all else as it was.
template <class Scalar>
[[gnu::noinline]] SpatialInertia<Scalar> with_column(SpatialInertia<Scalar> A, const Vector6<Scalar>& S,
                                                     const TriplePair<Scalar>& U)
{
  const TriplePair<Scalar> s(S.data());
  // x = A S − U, less ½ (S·x) S, which both terms have
  TriplePair<Scalar> x = A.of_linear(s.linear);
  x += A.of_angular(s.angular);
  x -= U;
  x -= s * (Scalar(0.5) * dot(s, x));
  subtract_both(s, x, A);
  return A;
}

/// A' of such a pivot, where the joint has no inertia of its own.
template <class Scalar>
[[gnu::noinline]] SpatialInertia<Scalar> across(SpatialInertia<Scalar> A, const Vector6<Scalar>& S,
                                                const TriplePair<Scalar>& U, const TriplePair<Scalar>& W)
{
  const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
  subtract_both(U, W * Scalar(0.5), A);
  return with_column(A, S, {zero, zero});
}

}  // namespace iim::detail
