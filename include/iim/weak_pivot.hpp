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
  return Data::update == Update::projected && !bodies_first<typename S::Scalar> && S::n_frames == 1 && !is_free<S>();
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

/// D of a pivot D that is small against `scale`, if it is one of those above; else 0. largest_inverse: on the
/// diagonal of all M̄_R⁻¹ so far, which ‖M⁻¹‖ is not less than. (By value: what a function that is not inlined may write
/// to would not stay in registers.)
template <class S, class Data>
[[gnu::noinline]] typename S::Scalar mended_pivot(
    const Node& node, const NodeState<S>& state,
    const std::array<SpunRotor<S>, static_cast<std::size_t>(rotor_count<S>())>& spun, const typename S::Scalar scale,
    const typename S::Scalar largest_inverse, bool springs, Data& ws, const typename S::Scalar D)
{
  using Scalar = typename S::Scalar;
  if (node.subtree_end == node.index + 1 || ws.axes().of(node.frame) != nullptr) { return Scalar(0); }
  if (ws.frame(node.frame).loses) {
    const Scalar along = along_loss(&ws.frame(node.frame), state)(0);
    if (!ScalarTraits<Scalar>::is_positive(D - Scalar(1024) * along * along)) { return Scalar(0); }
  }
  if (!ScalarTraits<Scalar>::is_positive(D - Scalar(4) * Eigen::NumTraits<Scalar>::epsilon() * scale)) {
    return Scalar(0);
  }
  // What the roundings of this pivot would be in M⁻¹, against the larger parts of it.
  if (!ScalarTraits<Scalar>::is_positive(scale - Scalar(2) * D * D * largest_inverse)) { return Scalar(0); }
  for (const SpunRotor<S>& rotor : spun) {
    if (!(rotor.J == Scalar(0))) { return Scalar(0); }
  }
  if (springs && is_sprung(state)) { return Scalar(0); }
  const Vector6<Scalar> S_0 = unit_column(state);
  Scalar sum = state.own.D;
  const bool small = !ScalarTraits<Scalar>::is_positive(D - pivot_tolerance<Scalar>() * scale);
  ws.bodies_beyond().add_up(node, Motions<Scalar>{S_0(0), S_0(1), S_0(2), S_0(3), S_0(4), S_0(5)}, springs, ws, sum,
                            small ? most_one_by_one : 0);
  return sum;
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

/// A' of such a pivot.
template <class Scalar>
[[gnu::noinline]] SpatialInertia<Scalar> across(SpatialInertia<Scalar> A, const Vector6<Scalar>& S,
                                                TriplePair<Scalar> U, TriplePair<Scalar> W)
{
  const TriplePair<Scalar> s(S.data());
  subtract_both(U, W * Scalar(0.5), A);
  // E A E = A − S xᵀ − x Sᵀ, x = A S − ½ (Sᵀ A S) S
  TriplePair<Scalar> x = A.of_linear(s.linear);
  x += A.of_angular(s.angular);
  x -= s * (Scalar(0.5) * dot(s, x));
  subtract_both(s, x, A);
  return A;
}

}  // namespace iim::detail
