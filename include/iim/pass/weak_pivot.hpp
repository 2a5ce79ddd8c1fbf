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
// differences, and the moments of a body meet the motion in its own axes. U is the same of a and of the motions that
// the inlet's axes make, Uₑ = Σ_b a_bᵀ I_b aₑ. The sums go on, body by body, until A of a frame is good enough for what
// hangs on it: until the roundings of A along a are no more than those of a pivot that is not small.
//
// A' = PᵀA P would bring the roundings of A along S in again, times ‖W‖². As A' S = 0, it is taken across S alone:
//
//     A' = E (A − ½ (U W + Wᵀ Uᵀ)) E,        E = 1 − S Sᵀ
//
// or, where the joint has inertia of its own, from A with U in place of its A S. So what is wrong of A stays as large
// as ε A, however small the pivots, and each pivot looks through it to where it has digits. (D alone from the sum, with
// U as A S, loses what the two have in common: masses × 10 per link a hundred times more.)
//
// q̈ has the roundings of the forces by which heavy bodies are held, which h is a difference of; it is made right once
// by what the equations of motion leave of it (second_look.hpp) where a pivot is below 1/64.
//
// Measured (double, median and worst of 100 states in ε; in brackets without all this): B̂ of seven links under 10³, 10⁶
// and 10⁹ times their weight 5, 45 (340, 8000), 5, 144 (3·10⁵, 4·10⁶) and 7, 430 (2·10⁸, 3·10⁹), q̈₀ 1, 506 (300, 8000),
// 1, 6 (2·10⁵, 3·10⁶) and 1, 7 (2·10⁸, 3·10⁹); masses × 10 per link, 12 links, B̂ 13, 1200 (8·10⁴, 10⁷), q̈₀ 2, 2·10⁴
// (7·10⁴, 2·10⁷); thin links on sliding and turning joints B̂ 6, 38 (9, 170). A joint takes 60 to 100 ns more where it
// is done, q̈ 0.2 µs and 40 ns a joint: loaded arms take up to three times as long, others in few states (a wrist
// stretched along the forearm; 4 % of the whole), chains of thin links in every third joint.
//
// Of several velocities, of screws, and of a free base: mended_root.hpp.
#pragma once

#include <iim/pass/articulated_inertia.hpp>
#include <iim/pass/bodies_beyond.hpp>
#include <iim/pass/carried.hpp>
#include <iim/pass/internal_inertia.hpp>
#include <iim/pass/kinematics.hpp>
#include <iim/pass/roundings.hpp>
#include <iim/pass/second_look.hpp>
#include <iim/spatial.hpp>
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

/// Whether the steps of S do so: of a joint that moves its frame along one unit column, turning it or sliding.
template <class S, class Data>
constexpr bool mends_pivots()
{
  return mends_any<S, Data>() && has_own_twist<S>() && S::pattern.linear != S::pattern.angular;
}

/// Column d of S, in all six rows.
template <MotionPattern pattern, class Scalar, int n>
[[gnu::always_inline]] inline TriplePair<Scalar> column_of(const Eigen::Matrix<Scalar, 6, n>& S, int d)
{
  const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
  const Scalar* const column = S.data() + 6 * d;
  return {pattern.linear ? Triple<Scalar>(column) : zero, pattern.angular ? Triple<Scalar>(column + 3) : zero};
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

/// Whether A of a frame is good enough for a sum that is `so_far`, in a lane of the frame's motions.
template <class Scalar, class Lane, class Data>
[[gnu::always_inline]] inline bool has_digits(const Data& ws, Index frame, const Motions<Lane>& motions, int lane,
                                              const Scalar& so_far)
{
  const FrameState<Scalar>& f = ws.frame(frame);
  if (f.loses) { return false; }
  Vector6<Scalar> a;
  for (int i = 0; i < 6; ++i) { a(i) = motions[static_cast<std::size_t>(i)][lane]; }
  if (const auto* own = ws.axes().of(frame)) { turn_triples(*own, false, a.data(), 2); }
  const TriplePair<Scalar> size = largest(f, f.A);
  Scalar rounding(0);
  for (int i = 0; i < 6; ++i) { rounding += a(i) * a(i) * size(i); }
  return ScalarTraits<Scalar>::is_positive(Scalar(8) * so_far - rounding);
}

/// Roundings of accelerations, squared: a share of `scale` that sums are told from zero by.
template <class Scalar>
Scalar squared_roundings()
{
  const Scalar rounding = Scalar(64) * Eigen::NumTraits<Scalar>::epsilon();
  return rounding * rounding;
}

/// Of a joint along the unit column S, as it is: own: of what its frame does not take from others. D: small against
/// `scale`.
template <class Scalar, class Data>
[[gnu::noinline]] Pivot<Scalar> mended_pivot_along(const Node& node, const TriplePair<Scalar>& S,
                                                   const Pivot<Scalar>& own, const Scalar& D, const Scalar& scale,
                                                   bool springs, Data& ws)
{
  using Lane = EightLanes<Scalar>;
  using Sum = FirstWithEach<Lane, Scalar>;
  if (!ws.frame(node.frame).arrived) { return {own.U, Scalar(0)}; }
  Vector6<Scalar> S_0;
  S.put(S_0.data());
  Matrix3<Scalar> axes = Matrix3<Scalar>::Identity();  // of A
  const Matrix3<Scalar>* const in_group = ws.axes().of(node.frame);
  if (in_group != nullptr) {
    // The plane that a group's joints move in has its digits as it is, but under loads. (From 1/256 on, 9 joints under
    // 10³ times their weight 16, 230 ε; so 6, 28.)
    if (ScalarTraits<Scalar>::is_positive(Scalar(16) * D - scale)) { return {own.U, Scalar(0)}; }
    axes = *in_group;
    turn_triples(axes, true, S_0.data(), 2);
  }
  Motions<Lane> a;  // along S, and along each of the six axes of A
  Sum sum;
  clear<Scalar>(sum.G);
  sum.G[0] = own.D;
  for (int i = 0; i < 6; ++i) {
    Lane& lane = a[static_cast<std::size_t>(i)];
    clear<Scalar>(lane);
    lane[0] = S_0(i);
    for (int j = 0; j < 3; ++j) { lane[(i < 3 ? 1 : 4) + j] = axes(i % 3, j); }
    sum.G[i + 1] = own.U(i);
  }
  const auto is_enough = [&ws](Index frame, const Motions<Lane>& motions, const Sum& so_far) {
    return has_digits<Scalar>(ws, frame, motions, 0, so_far.G[0]);
  };
  ws.bodies_beyond().add_up_until(is_enough, node, a, springs, ws, sum);
  const Lane& G = sum.G;
  if (!ScalarTraits<Scalar>::is_positive(G[0] - squared_roundings<Scalar>() * (scale + sum.turning))) {
    return {own.U, Scalar(0)};
  }
  // What the equations of motion leave has the roundings of what is held across a group's plane.
  if (in_group == nullptr && !ScalarTraits<Scalar>::is_positive(Scalar(64) * G[0] - scale)) {
    ws.second_look().note_mended_pivot();
  }
  return {{Triple<Scalar>(G[1], G[2], G[3]), Triple<Scalar>(G[4], G[5], G[6])}, G[0]};
}

/// Of subsystem S. (By value: what a function that is not inlined may write to would not stay in registers. All but
/// this is compiled once for all types: a controller is 12 % smaller.)
template <class S, class Data>
[[gnu::noinline]] Pivot<typename S::Scalar> mended_pivot(const Node& node, const NodeState<S>& state,
                                                         const typename S::Scalar D, const typename S::Scalar scale,
                                                         bool springs, Data& ws)
{
  using Scalar = typename S::Scalar;
  const Pivot<Scalar> own{own_column(state, ws.frame(node.frame)), state.own.D};
  return mended_pivot_along(node, column_of<S::pattern>(state.S_k[0], 0), own, D, scale, springs, ws);
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

/// A with A s = U, s a unit column, and all else as it was.
template <class Scalar>
[[gnu::noinline]] SpatialInertia<Scalar> with_column(SpatialInertia<Scalar> A, const TriplePair<Scalar>& s,
                                                     const TriplePair<Scalar>& U)
{
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
[[gnu::noinline]] SpatialInertia<Scalar> across(SpatialInertia<Scalar> A, const TriplePair<Scalar>& s,
                                                const TriplePair<Scalar>& U, const TriplePair<Scalar>& W)
{
  const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
  subtract_both(U, W * Scalar(0.5), A);
  return with_column(A, s, {zero, zero});
}

}  // namespace iim::detail
