// M̄_R⁻¹ = C Cᵀ of several velocities in the projected form, where a pivot is small against the inertia that it stands
// in: weak_pivot.hpp in as many directions at once.
//
// With the columns of S C as motions a, G = Σ_b aᵀ I_b a = Cᵀ D C is 1 but for what C is wrong by, and D⁻¹ = C G⁻¹ Cᵀ:
// these sums have no number in them that is larger than 1, and bodies meet the motions in their own axes. What hangs on
// the frame counts in one, with A of it; body by body (bodies_beyond.hpp) where the pivot is small against that, too.
// As A' S = 0, A' is taken across S again,
//
//     W = S⁺ + D⁻¹ Vᵀ,        A' = E (A − V D⁻¹ Vᵀ) E,        V = E U,        E = 1 − S S⁺
//
// (Trees of twelve boxes of any shape, as heavy as each other, double: of 480 states the error of B̂ is over 16 ε in 16
// for ball joints, 37 for universal ones, 1 to 23 for all kinds of joints together, the worst 45, 48 and 44 ε; without
// this in 138, 112 and 26 to 50, 330, 129 and 158. The pass of balls takes twice as long. From pivots of an eighth on,
// as for one velocity, twice as many states are over 16 ε. With V as the sum of all forces beyond, which has its
// digits, more are: the errors of A and V hang together.)
//
// Of a free base, where nothing is handed on, C alone is mended. (Of 3000 random chains on a free base like their links
// the error of B̂ is over 16 ε for 0.7 %, 3.5 % without; on a base 10⁻⁶ as heavy, its limbs about one axis, 13 ε at
// most, 10⁸ without.)
#pragma once

#include <iim/articulated_inertia.hpp>
#include <iim/bodies_beyond.hpp>
#include <iim/body.hpp>
#include <iim/kinematics.hpp>
#include <iim/node_state.hpp>
#include <iim/parallel_axes.hpp>
#include <iim/roundings.hpp>
#include <iim/spatial.hpp>
#include <iim/spd.hpp>
#include <iim/subsystem.hpp>
#include <iim/weak_pivot.hpp>
#include <iim/workspace.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <type_traits>

namespace iim::detail {

/// Whether the steps of S do so: of several velocities, with nothing within that has inertia of its own.
template <class S, class Data>
constexpr bool mends_roots()
{
  return mends_any<S, Data>() && S::n_i > 1 && S::n_i <= 6 && rotor_count<S>() == 0;
}

/// Whether a root C of M̄_R⁻¹ is to be mended: `scale` is more than `least` times one of its pivots, and what the
/// roundings of this would be in M⁻¹ is not small beside the larger parts of it, not less than largest_inverse (0:
/// whatever these are). (A biped without rotors has such a pivot of its base, least = 8, in two states of five, and in
/// one of 36 such that it would be seen; random chains on free bases keep the same digits.)
template <class Scalar, int n>
bool is_weak(const Eigen::Matrix<Scalar, n, n>& C, const Eigen::Matrix<Scalar, n, 1>& scale, const Scalar& least,
             const Scalar& largest_inverse)
{
  for (int k = 0; k < n; ++k) {
    const Scalar loss = C(k, k) * C(k, k) * scale(k);  // scale to pivot
    if (ScalarTraits<Scalar>::is_positive(least - loss)) { continue; }
    Scalar size(0);
    for (int i = 0; i <= k; ++i) { size += C(i, k) * C(i, k); }
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

/// Column d of S.
template <MotionPattern pattern, class Scalar, int n>
[[gnu::always_inline]] inline TriplePair<Scalar> column_of(const Eigen::Matrix<Scalar, 6, n>& S, int d)
{
  const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
  const Scalar* const column = S.data() + 6 * d;
  return {pattern.linear ? Triple<Scalar>(column) : zero, pattern.angular ? Triple<Scalar>(column + 3) : zero};
}

/// Motions S C of an upper triangular C.
template <class Lane, class Scalar, int n>
[[gnu::always_inline]] inline Motions<Lane> motions(const Eigen::Matrix<Scalar, 6, n>& S,
                                                    const Eigen::Matrix<Scalar, n, n>& C)
{
  std::array<Lane, static_cast<std::size_t>(n)> row;
#pragma GCC unroll 8
  for (int d = 0; d < n; ++d) {
    Lane& lane = row[static_cast<std::size_t>(d)];
    clear<Scalar>(lane);
#pragma GCC unroll 8
    for (int k = d; k < n; ++k) { lane[k] = C(d, k); }
  }
  Motions<Lane> a;
#pragma GCC unroll 8
  for (int i = 0; i < 6; ++i) {
    Lane sum = row[0] * S(i, 0);
#pragma GCC unroll 8
    for (int d = 1; d < n; ++d) { sum += row[static_cast<std::size_t>(d)] * S(i, d); }
    a[static_cast<std::size_t>(i)] = sum;
  }
  return a;
}

/// C to C L⁻ᵀ, L Lᵀ = G, whose lower triangle is read. False, and C as it was, if there is no L.
template <class Scalar, int n, class Lane, std::size_t columns>
[[gnu::always_inline]] inline bool divide_by_root(const std::array<Lane, columns>& G, Eigen::Matrix<Scalar, n, n>& C)
{
  using std::sqrt;
  Eigen::Matrix<Scalar, n, n> L;
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
#pragma GCC unroll 8
  for (int k = 0; k < n; ++k) {
#pragma GCC unroll 8
    for (int i = 0; i <= k; ++i) {
#pragma GCC unroll 8
      for (int j = i; j < k; ++j) { C(i, k) -= L(k, j) * C(i, j); }
      C(i, k) /= L(k, k);
    }
  }
  return true;
}

/// S⁺ = (SᵀS)⁻¹ Sᵀ, row by row. False if columns of S are within 20° of each other, so that this would lose digits. (By
/// orthogonal columns, which would not, a quarter more states of balls are over 16 ε.)
template <MotionPattern pattern, class Scalar, int n>
[[gnu::always_inline]] inline bool invert(const Eigen::Matrix<Scalar, 6, n>& S, SixColumns<Scalar, n>& inverse)
{
  Eigen::Matrix<Scalar, n, n> squares, C;
  SixColumns<Scalar, n> column, T;
#pragma GCC unroll 8
  for (int d = 0; d < n; ++d) {
    column[d] = column_of<pattern>(S, d);
#pragma GCC unroll 8
    for (int e = 0; e <= d; ++e) { squares(d, e) = dot(column[d], column[e]); }
  }
  bool apart = root_of_inverse<Scalar, n>(squares, squares.diagonal(), C);
#pragma GCC unroll 8
  for (int d = 0; d < n; ++d) {
    apart &= ScalarTraits<Scalar>::is_positive(Scalar(8) - C(d, d) * C(d, d) * squares(d, d));
  }
  times_root(column, C, T);
  times_transposed_root(T, C, inverse);
  return apart;
}

/// What a subsystem's step makes of A.
template <class Scalar, int n>
struct Reduction {
  Eigen::Matrix<Scalar, n, n>& C;  ///< D⁻¹ = C Cᵀ
  Eigen::Matrix<Scalar, n, n>& D_inv;
  const SixColumns<Scalar, n>& U;
  SixColumns<Scalar, n>& W;
  SixColumns<Scalar, n>& S_inverse;  ///< A' = E A E then
  SpatialInertia<Scalar>& A;
};

/// Makes a reduction right, all but D and U, which nothing needs from there on. False, and all but S⁺ as it was, if
/// that cannot be. arrived: A of what hangs on the frame, if anything does.
template <MotionPattern pattern, class Scalar, int n, class Data>
[[gnu::noinline]] bool mend(const Node& node, const Eigen::Matrix<Scalar, 6, n>& S,
                            const SpatialInertia<Scalar>& arrived, bool springs, Data& ws,
                            const Reduction<Scalar, n>& reduction)
{
  constexpr int columns = n <= 4 ? 4 : 6;  // of which up to four share a function
  using Lane = std::conditional_t<columns == 4, FourLanes<Scalar>, EightLanes<Scalar>>;
  if (ws.axes().of(node.frame) != nullptr || !invert<pattern>(S, reduction.S_inverse)) { return false; }
  Eigen::Matrix<Scalar, n, n> C = reduction.C;
  std::array<Lane, static_cast<std::size_t>(columns)> G;
  for (Lane& column : G) { clear<Scalar>(column); }
  const FrameState<Scalar>& f = ws.frame(node.frame);
  const Motions<Lane> a = motions<Lane>(S, C);
  add_body(ws.tree().frame_mass(node.frame), f.R, f.r, a, G);
  if (f.arrived) {
    Eigen::Matrix<Scalar, n, 1> scale = Eigen::Matrix<Scalar, n, 1>::Zero();
    add_scale<pattern>(f.size, S, scale);
    if (is_weak(C, scale, Scalar(3), Scalar(0))) {
      ws.bodies_beyond().add_up(node, a, springs, ws, G);
    } else {
      add_inertia(arrived, a, G);
    }
  }
  if (!divide_by_root<Scalar, n>(G, C)) { return false; }
  reduction.C = C;
  square_of_root(C, reduction.D_inv);

  SixColumns<Scalar, n> U = reduction.U, UC;  // across S
#pragma GCC unroll 8
  for (int d = 0; d < n; ++d) {
    const TriplePair<Scalar> u = U[d];
#pragma GCC unroll 8
    for (int e = 0; e < n; ++e) { U[d] -= reduction.S_inverse[e] * column_dot<pattern>(S, e, u); }
  }
  // Entries of D⁻¹ would round what is small of W (twice as many states over 16 ε).
  times_root(U, C, UC);
  times_transposed_root(UC, C, reduction.W);
  subtract_product(UC, UC, reduction.A);
#pragma GCC unroll 8
  for (int d = 0; d < n; ++d) { reduction.W[d] += reduction.S_inverse[d]; }
  return true;
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
  Motions<EightLanes<Scalar>> G;
  for (EightLanes<Scalar>& column : G) { clear<Scalar>(column); }
  const auto abreast = [&] { return motions<EightLanes<Scalar>>(C, Matrix6<Scalar>(Matrix6<Scalar>::Identity())); };
  add_body(body, f.R, f.r, abreast(), G);
  if (const auto* axes = ws.axes().of(node.frame)) { turn_triples(*axes, true, C.data(), 12); }  // the world's beyond
  ws.bodies_beyond().add_up(node, abreast(), springs, ws, G);
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
  divide_by_root<Scalar, 6>(G, C_T);
}

}  // namespace iim::detail
