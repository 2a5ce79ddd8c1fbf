// The square-root form of the O(n) pass: the articulated inertia as N with A = NᵀN, never A itself.
//
// By Gauss's principle the accelerations a_b of all bodies minimise Σ_b ‖N_b a_b − z_b‖² (less the work of applied
// forces), where N_bᵀN_b is the inertia of body b and z_b = N_b × (its acceleration if it were free). With the rows
// [N | z] of all that a subsystem's frames carry, a_k = y + bias_k + S_k q̈ and v = N S, one orthogonal Q gives
//
//     Q [ v  N  z − N bias ] = [ T  N₁  z₁ ]        D = M̄_R = TᵀT,   W = T⁻¹N₁,   q̈ = T⁻¹z₁ − W y      (17), (18)
//                              [ 0  N'  z' ]        A' = A − U W = N'ᵀN'                               (14), (16)
//
// so that the rows below are what the parent sees; the same Q reduces them to as many as A' has rank, and the rows
// [N' X(r) | z' − N' c] are stacked on the parent's own. Nothing is subtracted from anything of its own size: the error of
// A' is relative to each row, whatever the other rows weigh, if rows and columns are pivoted (Powell and Reid 1969; Cox
// and Higham 1998, "Stability of Householder QR factorization for weighted least squares problems").
// v of a row is formed where it has most digits, not from the sums N: for the frame's own body from constants in its own
// axes, and for a child's rows, N' S_child = 0, from what S differs by from S_child.
// Applied forces have no square root; they stay a wrench p beside N, p' = p − Wᵀ (Sᵀp − τ).
#pragma once

#include <iim/body_root.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <tuple>
#include <type_traits>
#include <utility>

namespace iim::detail {

/// One row [n | z | v]: six columns for (v̇, ω̇), the right-hand side, and where the frame moves by one column S, n S.
template <class Scalar>
using RootRow = Eigen::Array<Scalar, 8, 1>;
inline constexpr int rhs = 6;      ///< lane of z
inline constexpr int along_S = 7;  ///< lane of v

/// [N | z] of what one frame carries: its own body's rows as they are, six or fewer of each child. Room for two children
/// before anything has to be compressed; reducing own and child's rows to six before v is eliminated gains no digit.
template <class Scalar>
struct RootInertia {
  static constexpr int most = 18;
  static constexpr int within = 4;  ///< and for rotors and springs
  std::array<RootRow<Scalar>, most + within> row;
  int rows = 0;
  bool keeps_v = false;  ///< the rows have v = n S in their last lane
  Vector6<Scalar> S;     ///< if so
  Scalar scale;          ///< and Σ |v| as if nothing had cancelled in it
  Vector6<Scalar> h;     ///< bias wrench of the children alone
  Scalar h_along;        ///< and Sᵀ h
  Vector6<Scalar> rest;  ///< acceleration of the frame without S·rate
  Scalar rate;           ///< coefficient of S in it
};

/// S of the inlet as a child sees it: X(r) S_inlet = difference + share S_i. Where A'S_i = 0, a share of the inlet's rate
/// is undone by the child's own joint without anything else moving, so that only the difference acts on what follows;
/// of axes that nearly coincide it is all there is to see. share = 0 where that does not hold.
template <class Scalar>
struct SharedAxis {
  Vector6<Scalar> difference;
  Scalar share;
};

/// What v of a frame's own body is made from.
enum class Along {
  nothing,    ///< v is not kept in the rows
  column,     ///< S in world axes
  own_twist,  ///< constants of the body
};

template <class S>
constexpr Along along()
{
  const int within = rotor_count<S>() + spring_count<S>();
  if (S::n_i != 1 || S::n_frames != 1 || is_free<S>() || within > RootInertia<typename S::Scalar>::within) { return Along::nothing; }
  return has_own_twist<S>() ? Along::own_twist : Along::column;
}

/// N_b and z_b in world axes at the coupling point: √m (1, −s̃) with s the centre of mass, √θ_k (0, p_kᵀ).
template <bool velocity, Along along, class Scalar>
[[gnu::always_inline]] inline void place_roots(const BodyRoot<Scalar>& body, const Matrix3<Scalar>& R,
                                               const Vector3<Scalar>& r, const Vector3<Scalar>& omega,
                                               RootInertia<Scalar>& N)
{
  using std::abs;
  N.rows = body.rows;
  N.scale = Scalar(0);
  if (body.rows == 0) { return; }
  const Scalar& m = body.root_mass;
  const Scalar zero(0);
  Vector3<Scalar> s = times(R, body.com);
  add(s, r);
  Vector3<Scalar> centripetal(zero, zero, zero);
  if constexpr (velocity) { centripetal = cross(omega, cross(omega, s)); }
  Vector3<Scalar> v(zero, zero, zero);
  if constexpr (along == Along::own_twist) {
    v = times(R, body.linear);
    N.scale = body.own_scale;
  } else if constexpr (along == Along::column) {
    for (int i = 0; i < 3; ++i) {
      const int j = (i + 1) % 3, k = (i + 2) % 3;
      const Scalar a = N.S(j + 3) * s(k), b = N.S(k + 3) * s(j);
      v(i) = m * (N.S(i) + (a - b));
      N.scale += m * (abs(N.S(i)) + abs(a) + abs(b));
    }
  }
  N.row[0] << m, zero, zero, zero, m * s(2), -m * s(1), -m * centripetal(0), v(0);
  N.row[1] << zero, m, zero, -m * s(2), zero, m * s(0), -m * centripetal(1), v(1);
  N.row[2] << zero, zero, m, m * s(1), -m * s(0), zero, -m * centripetal(2), v(2);
  Matrix3<Scalar> p;
  multiply(R, body.axes, p);
  Vector3<Scalar> spin(zero, zero, zero);  // ω in principal axes
  if constexpr (velocity) {
    for (int k = 0; k < 3; ++k) { spin(k) = p(0, k) * omega(0) + p(1, k) * omega(1) + p(2, k) * omega(2); }
  }
  for (int k = 0; k + 3 < body.rows; ++k) {
    const Scalar& t = body.root_moment(k);
    Scalar turn(0);
    if constexpr (along == Along::own_twist) {
      turn = body.angular(k);
    } else if constexpr (along == Along::column) {
      turn = t * (p(0, k) * N.S(3) + p(1, k) * N.S(4) + p(2, k) * N.S(5));
      N.scale += t * (abs(p(0, k) * N.S(3)) + abs(p(1, k) * N.S(4)) + abs(p(2, k) * N.S(5)));
    }
    N.row[static_cast<std::size_t>(k + 3)] << zero, zero, zero, t * p(0, k), t * p(1, k), t * p(2, k),
        -body.gyration(k) * spin((k + 1) % 3) * spin((k + 2) % 3), turn;
  }
}

/// The same rows seen from the inlet's reference point: N X(r), z − N c. c is what velocities add at the outer point.
template <bool velocity, class Scalar>
[[gnu::always_inline]] inline void shift_row(RootRow<Scalar>& n, const Vector3<Scalar>& r, const Vector3<Scalar>& c)
{
  if constexpr (velocity) { n(rhs) -= n(0) * c(0) + n(1) * c(1) + n(2) * c(2); }
  n(3) += r(1) * n(2) - r(2) * n(1);
  n(4) += r(2) * n(0) - r(0) * n(2);
  n(5) += r(0) * n(1) - r(1) * n(0);
}

/// z − N a for an acceleration a that is already known.
template <class Scalar>
[[gnu::always_inline]] inline void subtract_known(RootRow<Scalar>& n, const Vector6<Scalar>& a)
{
  n(rhs) -= (n(0) * a(0) + n(1) * a(1) + n(2) * a(2)) + (n(3) * a(3) + n(4) * a(4) + n(5) * a(5));
}

/// Householder's reflection that takes x, ‖x‖² = square > 0, to (α, 0, …); its largest entry should stand first.
/// Turns x[0] into the first entry of the reflection's vector; the others stay. Returns α and 2/‖vector‖².
template <class Scalar>
[[gnu::always_inline]] inline std::pair<Scalar, Scalar> reflector(Scalar* x, const Scalar& square)
{
  using std::sqrt;
  const Scalar norm = sqrt(square);
  const Scalar alpha = x[0] > Scalar(0) ? Scalar(-norm) : norm;
  x[0] -= alpha;
  return {alpha, Scalar(-1) / (alpha * x[0])};
}

/// Place of the largest entry, its sign left aside.
template <class Scalar>
[[gnu::always_inline]] inline int largest(const Scalar* x, int count)
{
  using std::abs;
  int at = 0, next = 1;  // two races, so that no comparison waits for the one before
  Scalar size = abs(x[0]), other = count > 1 ? abs(x[1]) : Scalar(-1);
  for (int r = 2; r < count; r += 2) {
    const Scalar a = abs(x[r]);
    at = a > size ? r : at;
    size = a > size ? a : size;
    const Scalar b = r + 1 < count ? abs(x[r + 1]) : Scalar(-1);
    next = b > other ? r + 1 : next;
    other = b > other ? b : other;
  }
  return other > size ? next : at;
}

/// Rows are worked on four at a time, so that no sum waits for another: rows behind `count` are zero up to the next four.
inline constexpr int abreast = 4;

/// Σ_r rows[r] f(r).
template <class Scalar, class Factor>
[[gnu::always_inline]] inline RootRow<Scalar> weighted_sum(const RootRow<Scalar>* rows, int count, Factor&& factor)
{
  RootRow<Scalar> a = rows[0] * factor(0), b = rows[1] * factor(1), c = rows[2] * factor(2), d = rows[3] * factor(3);
  for (int r = abreast; r < count; r += abreast) {
    a += rows[r] * factor(r);
    b += rows[r + 1] * factor(r + 1);
    c += rows[r + 2] * factor(r + 2);
    d += rows[r + 3] * factor(r + 3);
  }
  return (a + b) + (c + d);
}

/// rows −= w xᵀ. Returns the squares, summed by column.
template <class Scalar, class Factor>
[[gnu::always_inline]] inline RootRow<Scalar> subtract(RootRow<Scalar>* rows, int count, const RootRow<Scalar>& w, Factor&& x)
{
  RootRow<Scalar> a = RootRow<Scalar>::Zero(), b = a, c = a, d = a;
  const auto step = [&](int r, RootRow<Scalar>& sum) {
    const RootRow<Scalar> n = rows[r] - w * x(r);
    rows[r] = n;
    sum += n * n;
  };
  for (int r = 0; r < count; r += abreast) {
    step(r, a);
    step(r + 1, b);
    step(r + 2, c);
    step(r + 3, d);
  }
  return (a + b) + (c + d);
}

/// Size of a row to sort by: ‖n‖₁, a finite number also where n is not, and less than the largest.
template <class Scalar>
[[gnu::always_inline]] inline Scalar size_of(const RootRow<Scalar>& n)
{
  using std::abs;
  const Scalar sum = ((abs(n(0)) + abs(n(1))) + (abs(n(2)) + abs(n(3)))) + (abs(n(4)) + abs(n(5)));
  const Scalar most = Eigen::NumTraits<Scalar>::highest() / Scalar(2);
  return sum < most ? sum : most;
}

/// The largest of the first six lanes: its place and itself, by knock-out.
template <class Scalar>
[[gnu::always_inline]] inline std::pair<int, Scalar> largest_of_six(const RootRow<Scalar>& x)
{
  const int a = x(1) > x(0) ? 1 : 0;
  const int b = x(3) > x(2) ? 3 : 2;
  const int c = x(5) > x(4) ? 5 : 4;
  const Scalar xa = x(1) > x(0) ? x(1) : x(0);
  const Scalar xb = x(3) > x(2) ? x(3) : x(2);
  const Scalar xc = x(5) > x(4) ? x(5) : x(4);
  const int d = xb > xa ? b : a;
  const Scalar xd = xb > xa ? xb : xa;
  return {xc > xd ? c : d, xc > xd ? xc : xd};
}

/// Order of the rows by size, largest first; `top` before them all. Counts instead of swapping: no branch to guess.
template <std::size_t most, class Scalar>
[[gnu::always_inline]] inline void sort_rows(const RootRow<Scalar>* stack, int count, int top, RootRow<Scalar>* sorted)
{
  constexpr std::size_t padded = (most + 7) / 8 * 8;
  std::array<Scalar, padded> size;
  std::array<std::conditional_t<sizeof(Scalar) == 8, std::int64_t, std::int32_t>, padded> place;
  const auto rows = static_cast<std::size_t>(count);
  const std::size_t end = (rows + 7) / 8 * 8;
  for (std::size_t r = 0; r < rows; ++r) { size[r] = size_of(stack[r]); }
  for (std::size_t r = rows; r < end; ++r) { size[r] = Scalar(-1); }
  if (top >= 0) { size[static_cast<std::size_t>(top)] = Eigen::NumTraits<Scalar>::highest(); }
  for (std::size_t l = 0; l < end; ++l) { place[l] = 0; }
  for (std::size_t r = 0; r < rows; ++r) {
    const Scalar other = size[r];
    for (std::size_t l = 0; l < end; ++l) {
      place[l] += static_cast<int>(other > size[l]) | (static_cast<int>(other == size[l]) & static_cast<int>(r < l));
    }
  }
  for (std::size_t r = 0; r < rows; ++r) { sorted[place[r]] = stack[r]; }
}

/// Replaces `count` ≤ most rows by at most `rank` ≤ steps with the same NᵀN and Nᵀz: QR with pivoted columns, rows sorted by size.
/// Row k of the result is zero in the columns pivot[0] … pivot[k − 1]. Returns how many rows.
/// `first` = along_S: Q of the file's head. The first column is v, its largest entry above all, and result[0] is
/// [N₁ | z₁ | T]; the rows after it are [N' | z' | 0].
template <int steps, std::size_t most, int first = -1, class Scalar>
int compress(const RootRow<Scalar>* stack, int count, RootRow<Scalar>* result,
             std::array<int, static_cast<std::size_t>(steps)>& pivot, int rank = steps)
{
  count = std::min(count, static_cast<int>(most));
  rank = std::min(std::min(rank, steps), count);
  int top_row = -1;
  if constexpr (first >= 0) {
    std::array<Scalar, most> v;
    for (int r = 0; r < count; ++r) { v[static_cast<std::size_t>(r)] = stack[r](first); }
    top_row = largest(v.data(), count);
  }
  std::array<RootRow<Scalar>, most + abreast> sorted;
  sort_rows<most>(stack, count, top_row, sorted.data());
  for (int r = count; r < count + abreast; ++r) { sorted[static_cast<std::size_t>(r)].setZero(); }
  RootRow<Scalar> square =
      weighted_sum(sorted.data(), count, [&](int r) -> const RootRow<Scalar>& { return sorted[static_cast<std::size_t>(r)]; });
  auto [column, most_left] = largest_of_six(square);
  if constexpr (first >= 0) { column = first; }
  for (int k = 0; k < rank; ++k) {
    RootRow<Scalar>* rows = sorted.data() + k;
    const int active = count - k;
    const Scalar best = square(column);
    if (!(best > Scalar(0))) { return k; }  // what is left is zero
    pivot[static_cast<std::size_t>(k)] = column;
    RootRow<Scalar> unit;
    for (int l = 0; l < 8; ++l) { unit(l) = Scalar(l == column ? 1 : 0); }
    const auto x = [&, c = column](int r) -> const Scalar& { return rows[r](c); };
    Scalar top = x(0);
    const RootRow<Scalar> above = rows[0];
    const RootRow<Scalar> sum = weighted_sum(rows, active, x);
    const auto [alpha, factor] = reflector(&top, best);
    result[k] = sum * (Scalar(1) / alpha);  // = above − w top, without its cancellation; alpha in its column
    if (k + 1 == rank) { break; }
    // top − above(column) = −alpha. w is 1 in the column, so that x − 1·x leaves an exact zero there.
    const RootRow<Scalar> w = (sum - above * alpha) * factor * (Scalar(1) - unit) + unit;
    // The next column by what Pythagoras leaves of it, which is there before the rows are; by themselves if that is roundings.
    const RootRow<Scalar> left = (square - result[k] * result[k]) * (Scalar(1) - unit);
    const Scalar doubtful = Scalar(64) * Eigen::NumTraits<Scalar>::epsilon() * most_left;
    square = subtract(rows + 1, active - 1, w, [&](int r) -> const Scalar& { return x(r + 1); });
    std::tie(column, most_left) = largest_of_six(left);
    if (!(most_left > doubtful)) { std::tie(column, most_left) = largest_of_six(square); }
  }
  return rank;
}

/// Q of the file's head: takes the columns v (n per row) of `count` rows to T in the first n rows, and [N | z] along.
/// `scale`: what the entries of v would be without cancellation. False if T is singular up to roundings.
template <int n, class Scalar, int most>
[[gnu::always_inline]] inline bool eliminate(std::array<Eigen::Matrix<Scalar, n, 1>, most>& v,
                                             std::array<RootRow<Scalar>, most>& rows, int count,
                                             const Eigen::Matrix<Scalar, n, 1>& scale, Eigen::Matrix<Scalar, n, n>& C)
{
  using std::abs;
  count = std::min(count, most - abreast);
  if (count < n) { return false; }
  for (int r = count; r < count + abreast; ++r) { rows[static_cast<std::size_t>(r)].setZero(); }
  std::array<int, n> order;
  std::array<bool, n> done{};
  std::array<Scalar, most> x;
  bool regular = true;
  for (int k = 0; k < n; ++k) {
    const std::size_t top = static_cast<std::size_t>(k);
    const int active = count - k;
    int column = 0;
    Scalar best(-1);
    for (int c = 0; c < n; ++c) {
      Scalar square(0);
      for (int r = k; r < count; ++r) { square += v[static_cast<std::size_t>(r)](c) * v[static_cast<std::size_t>(r)](c); }
      const bool better = !done[static_cast<std::size_t>(c)] && square > best;
      column = better ? c : column;
      best = better ? square : best;
    }
    done[static_cast<std::size_t>(column)] = true;
    order[top] = column;
    for (int r = 0; r < active; ++r) { x[static_cast<std::size_t>(r)] = v[top + static_cast<std::size_t>(r)](column); }
    const std::size_t pivot = static_cast<std::size_t>(largest(x.data(), active));
    std::swap(x[0], x[pivot]);
    std::swap(rows[top], rows[top + pivot]);
    std::swap(v[top], v[top + pivot]);
    if (!(best > Scalar(0))) {
      regular = false;
      best = Scalar(1);
    }
    const auto [alpha, factor] = reflector(x.data(), best);
    // Below this v is made of roundings: the coordinate moves nothing, or no digit of what it moves is left.
    const Scalar negligible = Scalar(64) * Eigen::NumTraits<Scalar>::epsilon() * scale(column);
    regular &= ScalarTraits<Scalar>::is_positive(abs(alpha) - negligible);
    for (int r = active; r < active + abreast; ++r) { x[static_cast<std::size_t>(r)] = Scalar(0); }
    RootRow<Scalar>* const open = rows.data() + k;
    const auto entry = [&](int r) -> const Scalar& { return x[static_cast<std::size_t>(r)]; };
    const RootRow<Scalar> w = weighted_sum(open, active, entry) * factor;
    subtract(open, active, w, entry);
    for (int c = 0; c < n; ++c) {
      if (done[static_cast<std::size_t>(c)]) { continue; }
      Scalar dot(0);
      for (int r = 0; r < active; ++r) { dot += v[top + static_cast<std::size_t>(r)](c) * x[static_cast<std::size_t>(r)]; }
      dot *= factor;
      for (int r = 0; r < active; ++r) { v[top + static_cast<std::size_t>(r)](c) -= dot * x[static_cast<std::size_t>(r)]; }
    }
    v[top](column) = alpha;
    for (int r = 1; r < active; ++r) { v[top + static_cast<std::size_t>(r)](column) = Scalar(0); }
  }
  // C = T⁻¹, T upper triangular in the order of elimination: row order[k] of C by substitution from the last.
  for (int k = n - 1; k >= 0; --k) {
    const int row = order[static_cast<std::size_t>(k)];
    const Eigen::Matrix<Scalar, n, 1>& t = v[static_cast<std::size_t>(k)];
    const Scalar inverse = Scalar(1) / t(row);
    for (int c = 0; c < n; ++c) {
      Scalar sum = c == k ? Scalar(1) : Scalar(0);
      for (int l = k + 1; l < n; ++l) { sum -= t(order[static_cast<std::size_t>(l)]) * C(order[static_cast<std::size_t>(l)], c); }
      C(row, c) = sum * inverse;
    }
  }
  return regular;
}

/// The same for a free subsystem, S = diag(R, R) orthogonal: T = N₁ S and C = Sᵀ N₁⁻¹ from the six rows that `compress`
/// leaves, N₁ and [N₁ | z₁] first of `rows`. False if N₁ is singular up to roundings.
template <class Scalar, int most>
[[gnu::always_inline]] inline bool eliminate_free(std::array<RootRow<Scalar>, most>& rows, int count,
                                                  const Eigen::Matrix<Scalar, 6, 6>& S,
                                                  std::array<Eigen::Matrix<Scalar, 6, 1>, most>& T,
                                                  Eigen::Matrix<Scalar, 6, 6>& C)
{
  using std::abs;
  if (count < 6) { return false; }
  RootRow<Scalar> scale = RootRow<Scalar>::Zero();
  for (int r = 0; r < count; ++r) { scale += rows[static_cast<std::size_t>(r)].abs(); }
  std::array<RootRow<Scalar>, 6> N;
  std::array<int, 6> pivot{};
  if (compress<6, static_cast<std::size_t>(most)>(rows.data(), count, N.data(), pivot) < 6) { return false; }
  bool regular = true;
  std::array<RootRow<Scalar>, 6> N_inv, S_row;
  for (int i = 0; i < 6; ++i) {
    for (int d = 0; d < 8; ++d) { S_row[static_cast<std::size_t>(i)](d) = d < 6 ? S(i, d) : Scalar(0); }
  }
  for (int k = 5; k >= 0; --k) {
    const RootRow<Scalar>& n = N[static_cast<std::size_t>(k)];
    const int row = pivot[static_cast<std::size_t>(k)];
    const Scalar negligible = Scalar(64) * Eigen::NumTraits<Scalar>::epsilon() * scale(row);
    regular &= ScalarTraits<Scalar>::is_positive(abs(n(row)) - negligible);
    RootRow<Scalar> sum;
    for (int l = 0; l < 8; ++l) { sum(l) = Scalar(l == k ? 1 : 0); }
    for (int l = k + 1; l < 6; ++l) {
      const int column = pivot[static_cast<std::size_t>(l)];
      sum -= N_inv[static_cast<std::size_t>(column)] * n(column);
    }
    N_inv[static_cast<std::size_t>(row)] = sum * (Scalar(1) / n(row));
    rows[static_cast<std::size_t>(k)] = n;
    RootRow<Scalar> t = S_row[0] * n(0);
    for (int i = 1; i < 6; ++i) { t += S_row[static_cast<std::size_t>(i)] * n(i); }
    for (int d = 0; d < 6; ++d) { T[static_cast<std::size_t>(k)](d) = t(d); }
  }
  for (int d = 0; d < 6; ++d) {
    const std::size_t first = d < 3 ? 0 : 3;
    RootRow<Scalar> c = N_inv[first] * S(static_cast<int>(first), d);
    c += N_inv[first + 1] * S(static_cast<int>(first) + 1, d);
    c += N_inv[first + 2] * S(static_cast<int>(first) + 2, d);
    for (int k = 0; k < 6; ++k) { C(d, k) = c(k); }
  }
  return regular;
}

}  // namespace iim::detail
