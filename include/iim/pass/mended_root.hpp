// Pivots that are small against the inertia that they stand in, of joints with several velocities and of screws, in the
// projected form: weak_pivot.hpp in as many directions at once.
//
// A S, as it is, gives a root C of M̄_R⁻¹ = C Cᵀ. Its errors make the columns of S C move heavy bodies a little, but by
// no more than roundings; how much they move in all, and what with them, the bodies beyond tell:
//
//     G = Σ_b aᵀ I_b a = Cᵀ D C,        U C = Σ_b Pᵀ I_b a,        a = S C
//
// as deep as the roundings of each column ask (several_motions.hpp). G is 1 but for what C is wrong by: C to C L⁻ᵀ, L
// Lᵀ = G, and U C with it. As A' S = 0, A' is taken across S again,
//
//     W = S⁺ + C Vᵀ,        A' = E (A − V Vᵀ) E,        V = E U C,        E = 1 − S S⁺
//
// in orthonormal columns Q, S = Q R, where those of S are not. (Not of screws in groups of six parallel joints and
// more, and with rotors within.) A pivot of which A has no digits left is as large as its roundings to begin with.
//
// (Double, in brackets with C alone from sums. Trees of twelve boxes of any shape, as heavy as each other: of 480
// states the error of B̂ is over 16 ε in 11 for ball joints (87), 9 for universal ones (28), 9 for all kinds together on
// a free base (53), the worst 25, 36 and 28 ε (160, 53, 218); chains of them 23 for balls (264) and for universal
// joints (71). Four balls, universal, cylindrical or planar joints under 10⁶ times their weight 3 to 5 ε in half of the
// states (6·10⁴ to 6·10⁵), six screws 9 (61). Passes of such boxes take up to 2.2 times as long as without. From pivots
// of a fourth on, three times as many states of boxes on balls are over 16 ε.)
//
// Of several frames, and of several velocities with rotors: mended_compound.hpp.
//
// Of a free base, where nothing is handed on, C alone is mended, and limbs along its axis are followed apart from that
// (free_inward.hpp). (Of 3000 random chains on a free base like their links the error of B̂ is over 16 ε for 0.7 %, 3.5
// % without; under a limb of six with 10⁶ times its weight at the tip 740 ε, in one state of twelve over 32 ε, with
// what hangs on the limb in one 3·10⁵. Along its axis as well, the joint undoing what the base moves by to roundings of
// that: q̈₀ of a base 10⁻² to 10⁻⁴ as heavy as its limb 3000 ε instead of 53, B̂ under such a load 10³ instead of 18.)
#pragma once

#include <iim/body.hpp>
#include <iim/node_state.hpp>
#include <iim/numerics/spd.hpp>
#include <iim/pass/articulated_inertia.hpp>
#include <iim/pass/bodies_beyond.hpp>
#include <iim/pass/motion_products.hpp>
#include <iim/pass/parallel_axes.hpp>
#include <iim/pass/roundings.hpp>
#include <iim/pass/second_look.hpp>
#include <iim/pass/weak_pivot.hpp>
#include <iim/scalar.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>
#include <iim/workspace.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace iim::detail {

/// Whether a root C of M̄_R⁻¹ is to be mended: `scale` is more than `least` times one of its pivots, and what the
/// roundings of this would be in M⁻¹ is not small beside the larger parts of it, not less than largest_inverse (0:
/// whatever these are). (A biped without rotors has such a pivot of its base, least = 8, in two states of five, and in
/// one of 36 such that it would be seen; random chains on free bases keep the same digits.) unit_of_last: what the last
/// row, a coordinate's, is to be multiplied by to compare with others.
template <class Scalar, int n>
bool is_weak(const Eigen::Matrix<Scalar, n, n>& C, const Eigen::Matrix<Scalar, n, 1>& scale, const Scalar& least,
             const Scalar& largest_inverse, const Scalar& unit_of_last = Scalar(1))
{
  for (int k = 0; k < n; ++k) {
    const Scalar loss = C(k, k) * C(k, k) * scale(k);  // scale to pivot
    if (ScalarTraits<Scalar>::is_positive(least - loss)) { continue; }
    Scalar size(0);
    for (int i = 0; i <= k; ++i) {
      const Scalar part = i == n - 1 ? Scalar(C(i, k) * unit_of_last) : C(i, k);
      size += part * part;
    }
    if (!ScalarTraits<Scalar>::is_positive(largest_inverse - Scalar(4) * loss * size)) { return true; }
  }
  return false;
}

/// Columns X C of an upper triangular C.
template <class Scalar, int n>
[[gnu::always_inline]] inline void times_root(const SixColumns<Scalar, n>& X, const Eigen::Matrix<Scalar, n, n>& C,
                                              SixColumns<Scalar, n>& result)
{
#pragma GCC unroll 8
  for (int k = 0; k < n; ++k) {
    result[k] = X[0] * C(0, k);
#pragma GCC unroll 8
    for (int d = 1; d <= k; ++d) { result[k] += X[d] * C(d, k); }
  }
}
/// X Cᵀ.
template <class Scalar, int n>
[[gnu::always_inline]] inline void times_transposed_root(const SixColumns<Scalar, n>& X,
                                                         const Eigen::Matrix<Scalar, n, n>& C,
                                                         SixColumns<Scalar, n>& result)
{
#pragma GCC unroll 8
  for (int d = 0; d < n; ++d) {
    result[d] = X[d] * C(d, d);
#pragma GCC unroll 8
    for (int k = d + 1; k < n; ++k) { result[d] += X[k] * C(d, k); }
  }
}

/// L, lower triangular, of L Lᵀ = G, whose lower triangle is read. False if there is none.
template <class Scalar, int n, class Lane>
[[gnu::always_inline]] inline bool lower_root(const std::array<Lane, static_cast<std::size_t>(n)>& G,
                                              Eigen::Matrix<Scalar, n, n>& L)
{
  using std::sqrt;
#pragma GCC unroll 8
  for (int k = 0; k < n; ++k) {
#pragma GCC unroll 8
    for (int j = 0; j <= k; ++j) {
      Scalar left = G[static_cast<std::size_t>(k)][j];
#pragma GCC unroll 8
      for (int i = 0; i < j; ++i) { left -= L(k, i) * L(j, i); }
      if (j < k) {
        L(k, j) = left / L(j, j);
      } else {
        if (!ScalarTraits<Scalar>::is_positive(left)) { return false; }
        L(k, k) = sqrt(left);
      }
    }
  }
  return true;
}
/// C, upper triangular, to C L⁻ᵀ.
template <class Scalar, int n>
[[gnu::always_inline]] inline void divide(Eigen::Matrix<Scalar, n, n>& C, const Eigen::Matrix<Scalar, n, n>& L)
{
#pragma GCC unroll 8
  for (int k = 0; k < n; ++k) {
#pragma GCC unroll 8
    for (int i = 0; i <= k; ++i) {
#pragma GCC unroll 8
      for (int j = i; j < k; ++j) { C(i, k) -= L(k, j) * C(i, j); }
      C(i, k) /= L(k, k);
    }
  }
}

/// V = X L⁻ᵀ, the columns of X in lanes.
template <class Scalar, int n, class Lane>
[[gnu::always_inline]] inline void divided_columns(const Motions<Lane>& X, const Eigen::Matrix<Scalar, n, n>& L,
                                                   SixColumns<Scalar, n>& V)
{
#pragma GCC unroll 8
  for (int k = 0; k < n; ++k) {
    V[k] = {Triple<Scalar>(X[0][k], X[1][k], X[2][k]), Triple<Scalar>(X[3][k], X[4][k], X[5][k])};
#pragma GCC unroll 8
    for (int j = 0; j < k; ++j) { V[k] -= V[j] * L(k, j); }
    V[k] = V[k] * (Scalar(1) / L(k, k));
  }
}

/// S = Q R, columns of Q orthonormal, R upper triangular.
template <class Scalar, int n>
struct Orthonormal {
  SixColumns<Scalar, n> Q, inverse;  ///< Q⁺ᵀ: to all digits Q, but where Q = S
  Eigen::Matrix<Scalar, n, n> R;
  bool is_S = true;  ///< Q = S, but for roundings; R is not set

  /// False if columns of S coincide.
  template <MotionPattern pattern>
  [[gnu::always_inline]] bool set(const Eigen::Matrix<Scalar, 6, n>& S)
  {
    const Scalar roundings = Scalar(16) * Eigen::NumTraits<Scalar>::epsilon();
    Eigen::Matrix<Scalar, n, n> off;
#pragma GCC unroll 8
    for (int d = 0; d < n; ++d) {
      Q[d] = column_of<pattern>(S, d);
#pragma GCC unroll 8
      for (int e = 0; e <= d; ++e) {
        off(e, d) = off(d, e) = dot(Q[e], Q[d]) - Scalar(e == d ? 1 : 0);
        is_S &= is_below(off(e, d), roundings);
      }
    }
    if (!is_S) {
      if (!orthogonalise()) { return false; }
      inverse = Q;
      return true;
    }
    // (With Q itself the error of q̈₀ is twice as large.)
#pragma GCC unroll 8
    for (int d = 0; d < n; ++d) {
      inverse[d] = Q[d];
#pragma GCC unroll 8
      for (int e = 0; e < n; ++e) { inverse[d] -= Q[e] * off(e, d); }
    }
    return true;
  }

private:
  [[gnu::noinline]] bool orthogonalise()
  {
    using std::sqrt;
    R.setZero();
    for (int d = 0; d < n; ++d) {
      TriplePair<Scalar>& q = Q[d];
      const Scalar square = dot(q, q);
      for (int time = 0; time < 2; ++time) {  // once is not enough for columns that are close to each other
        for (int e = 0; e < d; ++e) {
          const Scalar along = dot(Q[e], q);
          q -= Q[e] * along;
          R(e, d) += along;
        }
      }
      const Scalar left = dot(q, q);
      if (!ScalarTraits<Scalar>::is_positive(left - squared_roundings<Scalar>() * square)) { return false; }
      R(d, d) = sqrt(left);
      q = q * (Scalar(1) / R(d, d));
    }
    return true;
  }
};

/// C of Qᵀ A Q, with pivots of roundings, ε·scale, where nothing is left of them.
template <class Scalar, int n>
[[gnu::noinline]] void root_along(const SixColumns<Scalar, n>& Q, const SpatialInertia<Scalar>& A,
                                  const Eigen::Matrix<Scalar, n, 1>& scale, Eigen::Matrix<Scalar, n, n>& C)
{
  Eigen::Matrix<Scalar, n, n> D;
  for (int d = 0; d < n; ++d) {
    const TriplePair<Scalar> U = times(A, Q[d]);
    for (int e = d; e < n; ++e) { D(e, d) = dot(Q[e], U); }
  }
  root_of_inverse<Scalar, n, true>(D, scale, C);
}

/// E A E.
template <class Scalar, int n>
[[gnu::noinline]] void take_across(const SixColumns<Scalar, n>& Q, SpatialInertia<Scalar>& A)
{
  const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
  for (int d = 0; d < n; ++d) { set_column(Q[d], TriplePair<Scalar>{zero, zero}, A); }
}

/// R⁻¹ C and R⁻¹ W.
template <class Scalar, int n>
[[gnu::noinline]] void to_columns_of_S(const Eigen::Matrix<Scalar, n, n>& R, Eigen::Matrix<Scalar, n, n>& C,
                                       SixColumns<Scalar, n>& W)
{
  for (int d = n; d-- > 0;) {
    const Scalar inverse = Scalar(1) / R(d, d);
    for (int e = d + 1; e < n; ++e) {
      W[d] -= W[e] * R(d, e);
      for (int k = e; k < n; ++k) { C(d, k) -= R(d, e) * C(e, k); }
    }
    W[d] = W[d] * inverse;
    for (int k = d; k < n; ++k) { C(d, k) *= inverse; }
  }
}

/// For add_up_until: whether A of a frame is good enough for each of n motions with itself.
template <class Scalar, class Data>
auto is_enough_for_each(const Data& ws)
{
  return
      [&ws]<class Lane, std::size_t n>(Index frame, const Motions<Lane>& motions, const std::array<Lane, n>& so_far) {
#pragma GCC unroll 1
        for (int k = 0; k < static_cast<int>(n); ++k) {
          if (!has_digits<Scalar>(ws, frame, motions, k, Scalar(so_far[static_cast<std::size_t>(k)][k]))) {
            return false;
          }
        }
        return true;
      };
}

/// Whether the pivots of a mended C are more than roundings of motions. positive: whether none is below
/// pivot_tolerance.
template <class Scalar, int n, class Data>
[[gnu::always_inline]] inline bool stand_out(const Eigen::Matrix<Scalar, n, n>& C,
                                             const Eigen::Matrix<Scalar, n, 1>& scale, Data& ws, bool& positive)
{
  positive = true;
#pragma GCC unroll 8
  for (int k = 0; k < n; ++k) {
    const Scalar pivot = Scalar(1) / (C(k, k) * C(k, k));
    if (!ScalarTraits<Scalar>::is_positive(pivot - squared_roundings<Scalar>() * scale(k))) { return false; }
    positive &= ScalarTraits<Scalar>::is_positive(pivot - pivot_tolerance<Scalar>() * scale(k));
    ws.second_look().note_mended_pivot(pivot, scale(k));
  }
  return true;
}

/// What of a joint's step mend() makes right: all but D and U, which nothing needs from there on.
template <class Scalar, int n>
struct Reduction {
  Eigen::Matrix<Scalar, n, n>& C;  ///< D⁻¹ = C Cᵀ
  Eigen::Matrix<Scalar, n, n>& D_inv;
  SixColumns<Scalar, n>& W;
  SpatialInertia<Scalar>& A;  ///< of what the frame carries; to A' if there is an inlet
  bool& positive;             ///< whether no pivot is below pivot_tolerance
};

/// False, and all as it was, if that cannot be. size: of the inertia that pivots stand in (roundings.hpp).
template <MotionPattern pattern, class Scalar, int n, class Data>
[[gnu::noinline]] bool mend(const Node& node, const Eigen::Matrix<Scalar, 6, n>& S, const TriplePair<Scalar>& size,
                            bool springs, Data& ws, const Reduction<Scalar, n>& reduction)
{
  using Lane = EightLanes<Scalar>;
  using Sum = std::array<Lane, static_cast<std::size_t>(n)>;
  Orthonormal<Scalar, n> columns;
  if (ws.axes().of(node.frame) != nullptr || !columns.template set<pattern>(S)) { return false; }
  const SixColumns<Scalar, n>& Q = columns.Q;
  const FrameState<Scalar>& f = ws.frame(node.frame);
  Eigen::Matrix<Scalar, n, 1> scale;
#pragma GCC unroll 8
  for (int d = 0; d < n; ++d) {
    scale(d) = dot(TriplePair<Scalar>(Q[d].linear * Q[d].linear, Q[d].angular * Q[d].angular), size);
  }
  Eigen::Matrix<Scalar, n, n> C = reduction.C, L;
  if (!(columns.is_S && reduction.positive)) [[unlikely]] { root_along(Q, reduction.A, scale, C); }

  SixColumns<Scalar, n> X;
  times_root(Q, C, X);
  const Motions<Lane> a = abreast<Lane, Scalar, n>(X);
  Motions<Lane> wrench;
  Sum G;
  for (Lane& column : G) { clear<Scalar>(column); }
  add_body(ws.tree().frame_mass(node.frame), f.R, f.r, a, G, wrench);
  ws.bodies_beyond().add_up_until(is_enough_for_each<Scalar>(ws), node, a, springs, ws, G, &wrench);
  if (!lower_root<Scalar, n>(G, L)) { return false; }
  divide(C, L);
  bool positive;
  if (!stand_out(C, scale, ws, positive)) { return false; }

  SixColumns<Scalar, n> V, W;
  divided_columns<Scalar, n>(wrench, L, V);
#pragma GCC unroll 8
  for (int k = 0; k < n; ++k) {
#pragma GCC unroll 8
    for (int d = 0; d < n; ++d) { V[k] -= columns.inverse[d] * dot(Q[d], V[k]); }
  }
  // Entries of D⁻¹ would round what is small of W (twice as many states over 16 ε).
  times_transposed_root(V, C, W);
#pragma GCC unroll 8
  for (int d = 0; d < n; ++d) { W[d] += columns.inverse[d]; }
  if (!columns.is_S) { to_columns_of_S(columns.R, C, W); }
  if (node.inlet >= 0) {
    subtract_product(V, V, reduction.A);
    if (columns.is_S) {
      SixColumns<Scalar, n> U;
      inertia_times<pattern>(reduction.A, S, U);
      reduction.A = projected<pattern>(SpatialInertia<Scalar>(reduction.A), S, U, columns.inverse);
    } else {
      take_across(Q, reduction.A);
    }
  }
  reduction.C = C;
  square_of_root(C, reduction.D_inv);
  reduction.W = W;
  reduction.positive = positive;
  return true;
}

/// C_T of a free base to C_T L⁻ᵀ, L Lᵀ = G, of the motions C = T C_T. By the roundings of A_T, ε·scale, and by those
/// of the motions, ε·a·√size, of inertias `size` that these meet, each entry of G is taken from the sums or left as it
/// is: along the axis of the limb's first joint, where A_T is made of what is held, it is better than they are. (The
/// factor: with 4, limbs under loads have up to a hundred times the error.) False, and C_T as it was, if G has no root.
template <class Scalar, class Data>
[[gnu::noinline]] bool mend_root(const Node& node, const FrameMass<Scalar>& body, const Matrix6<Scalar>& T,
                                 const Vector6<Scalar>& scale, const Vector6<Scalar>& size, bool springs, Data& ws,
                                 Matrix6<Scalar>& C_T)
{
  using Lane = EightLanes<Scalar>;
  using std::max;
  using std::sqrt;
  const auto abs = [](const Scalar& x) { return ScalarTraits<Scalar>::is_positive(x) ? x : Scalar(-x); };
  const FrameState<Scalar>& f = ws.frame(node.frame);
  Matrix6<Scalar> apart = Matrix6<Scalar>::Zero();  // T C_T, but for the column along the axis
  for (int k = 0; k < 6; ++k) {
    for (int j = 0; j <= std::min(k, 4); ++j) {
      for (int i = 0; i < 6; ++i) { apart(i, k) += T(i, j) * C_T(j, k); }
    }
  }
  Matrix6<Scalar> C = apart;
  for (int i = 0; i < 6; ++i) { C(i, 5) += T(i, 5) * C_T(5, 5); }
  Lane rates;
  clear<Scalar>(rates);
  rates[5] = C_T(5, 5);
  std::array<Lane, 6> G;
  for (Lane& column : G) { clear<Scalar>(column); }
  Motions<Lane> wrench;
  add_body(body, f.R, f.r, abreast<Lane, Scalar, 6>(C), G, wrench);
  if (const auto* axes = ws.axes().of(node.frame)) {  // the world's beyond
    turn_triples(*axes, true, C.data(), 12);
    turn_triples(*axes, true, apart.data(), 12);
  }
  ws.bodies_beyond().add_beyond_free(is_enough_for_each<Scalar>(ws), node, abreast<Lane, Scalar, 6>(C),
                                     abreast<Lane, Scalar, 6>(apart), rates, springs, ws, G);
  Vector6<Scalar> of_motions;
  for (int k = 0; k < 6; ++k) {
    of_motions(k) = Scalar(0);
    for (int i = 0; i <= k; ++i) { of_motions(k) += abs(C_T(i, k)) * sqrt(size(i)); }
    for (int j = 0; j <= k; ++j) {
      Scalar of_A(0);
      for (int i = 0; i <= j; ++i) { of_A += abs(C_T(i, j) * C_T(i, k)) * scale(i); }
      if (!(Scalar(1024) * of_A > max(of_motions(j), of_motions(k)))) {
        G[static_cast<std::size_t>(k)][j] = Scalar(j == k ? 1 : 0);
      }
    }
  }
  Matrix6<Scalar> L;
  if (!lower_root<Scalar, 6>(G, L)) { return false; }
  divide(C_T, L);
  return true;
}

}  // namespace iim::detail
