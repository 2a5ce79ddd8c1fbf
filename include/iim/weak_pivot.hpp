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
// differences, and the moments of a body meet the motion in its own axes.
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
// Of a free base, where such a pivot is one of six, all of A⁻¹ = C Cᵀ is made right (mend_root): with a = C G = Cᵀ A C
// is 1 but for what C is wrong by, and A⁻¹ = C G⁻¹ Cᵀ. (Of 3000 random chains on a free base like their links the error
// of B̂ is over 16 ε for 0.7 %, 3.5 % without; on a base 10⁻⁶ as heavy, its limbs about one axis, 13 ε at most, 10⁸
// without.)
#pragma once

#include <iim/articulated_inertia.hpp>
#include <iim/bodies_beyond.hpp>
#include <iim/carried.hpp>
#include <iim/internal_inertia.hpp>
#include <iim/roundings.hpp>
#include <iim/spatial.hpp>
#include <iim/spd.hpp>
#include <iim/subsystem.hpp>
#include <iim/workspace.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace iim::detail {

/// Whether the steps of S do so: of a joint that moves one frame along one unit column, turning it or sliding, without
/// springs of its own (an implicit step adds their inertia to D).
template <class S, class Data>
constexpr bool mends_pivots()
{
  if constexpr (Data::update == Update::projected && !bodies_first<typename S::Scalar>) {
    return has_own_twist<S>() && spring_count<S>() == 0 && S::pattern.linear != S::pattern.angular;
  }
  return false;
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

/// D of a pivot D that is small against `scale`, if it is one of those above; else 0. largest_inverse: of all M̄_R⁻¹ of
/// one velocity so far, which ‖M⁻¹‖ is not less than. (By value: what a function that is not inlined may write to would
/// not stay in registers.)
template <class S, class Data>
[[gnu::noinline]] typename S::Scalar mended_pivot(
    const Node& node, const NodeState<S>& state,
    const std::array<SpunRotor<S>, static_cast<std::size_t>(rotor_count<S>())>& spun, const typename S::Scalar scale,
    const typename S::Scalar largest_inverse, bool springs, Data& ws, const typename S::Scalar D)
{
  using Scalar = typename S::Scalar;
  constexpr Index most_subsystems = 32;  // what is summed takes as long as the step of one joint for every two
  const Index beyond = node.subtree_end - node.index - 1;
  if (beyond == 0 || beyond > most_subsystems || ws.axes().of(node.frame) != nullptr) { return Scalar(0); }
  if (ws.frame(node.frame).loses) {
    const Scalar along = along_loss(&ws.frame(node.frame), state)(0);
    if (!ScalarTraits<Scalar>::is_positive(D - Scalar(1024) * along * along)) { return Scalar(0); }
  }
  if (!ScalarTraits<Scalar>::is_positive(D - pivot_tolerance<Scalar>() * scale)) { return Scalar(0); }
  // What the roundings of this pivot would be in M⁻¹, against the larger parts of it.
  if (!ScalarTraits<Scalar>::is_positive(scale - Scalar(2) * D * D * largest_inverse)) { return Scalar(0); }
  for (const SpunRotor<S>& rotor : spun) {  // A' S = 0 is for joints without inertia of their own
    if (!(rotor.J == Scalar(0))) { return Scalar(0); }
  }
  const Vector6<Scalar> S_0 = unit_column(state);
  Scalar sum = state.own.D;
  ws.bodies_beyond().add_up(node, Motions<Scalar>{S_0(0), S_0(1), S_0(2), S_0(3), S_0(4), S_0(5)}, springs, ws, sum);
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

/// C_T of a free base to C_T L⁻ᵀ, L Lᵀ = G, of the motions C = T C_T. By the roundings of A_T, ε·scale, and by those
/// of the motions, ε·a·√size, of inertias `size` that these meet, each entry of G is taken from the sums or left as it
/// is: along the axis of the limb's first joint, where A_T is made of what is held, it is better than they are.
template <class Scalar, class Data>
[[gnu::noinline]] void mend_root(const Node& node, const FrameMass<Scalar>& body, const Matrix6<Scalar>& T,
                                 const Vector6<Scalar>& scale, const Vector6<Scalar>& size, bool springs, Data& ws,
                                 Matrix6<Scalar>& C_T)
{
  using std::max;
  using std::sqrt;
  const auto abs = [](const Scalar& x) { return ScalarTraits<Scalar>::is_positive(x) ? x : Scalar(-x); };
  const FrameState<Scalar>& f = ws.frame(node.frame);
  Matrix6<Scalar> C = Matrix6<Scalar>::Zero();  // T C_T
  for (int k = 0; k < 6; ++k) {
    for (int j = 0; j <= k; ++j) {
      for (int i = 0; i < 6; ++i) { C(i, k) += T(i, j) * C_T(j, k); }
    }
  }
  Motions<SixLanes<Scalar>> a, G;
  const auto set_motions = [&] {
    for (std::size_t i = 0; i < 6; ++i) {
      for (int k = 0; k < 8; ++k) { a[i][k] = k < 6 ? C(static_cast<Index>(i), k) : Scalar(0); }
    }
  };
  set_motions();
  for (SixLanes<Scalar>& column : G) { clear<Scalar>(column); }
  add_body(body, f.R, f.r, a, G);
  if (const auto* axes = ws.axes().of(node.frame)) {  // all beyond are in the world's
    turn_triples(*axes, true, C.data(), 12);
    set_motions();
  }
  ws.bodies_beyond().add_up(node, a, springs, ws, G);
  Vector6<Scalar> of_motions;
  for (int k = 0; k < 6; ++k) {
    of_motions(k) = Scalar(0);
    for (int i = 0; i <= k; ++i) { of_motions(k) += abs(C_T(i, k)) * sqrt(size(i)); }
    for (int j = 0; j <= k; ++j) {
      Scalar of_A(0);
      for (int i = 0; i <= j; ++i) { of_A += abs(C_T(i, j) * C_T(i, k)) * scale(i); }
      if (!(Scalar(4) * of_A > max(of_motions(j), of_motions(k)))) {
        G[static_cast<std::size_t>(k)][j] = Scalar(j == k ? 1 : 0);
      }
    }
  }
  Matrix6<Scalar> L;
  for (int k = 0; k < 6; ++k) {
    for (int j = 0; j <= k; ++j) {
      Scalar left = G[static_cast<std::size_t>(k)][j];
      for (int i = 0; i < j; ++i) { left -= L(k, i) * L(j, i); }
      if (j < k) {
        L(k, j) = left / L(j, j);
      } else {
        if (!ScalarTraits<Scalar>::is_positive(left)) { return; }
        L(k, k) = sqrt(left);
      }
    }
  }
  for (int k = 0; k < 6; ++k) {
    for (int i = 0; i <= k; ++i) {
      for (int j = i; j < k; ++j) { C_T(i, k) -= L(k, j) * C_T(i, j); }
      C_T(i, k) /= L(k, k);
    }
  }
}

}  // namespace iim::detail
