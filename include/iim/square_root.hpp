// The square-root form of the O(n) pass: the articulated inertia as N with A = NᵀN, never A itself.
//
// By Gauss's principle the accelerations a_b of all bodies minimise Σ_b ‖N_b a_b − z_b‖² (less the work of applied
// forces), where N_bᵀN_b is the inertia of body b and z_b = N_b × (its acceleration if it were free). With the rows
// [N | z] of all that a subsystem's frames carry, a_k = y + bias_k + S_k q̈ and v = N S, one orthogonal Q gives
//
//     Q [ v  N  z − N bias ] = [ T  N₁  z₁ ]        D = M̄_R = TᵀT,   W = T⁻¹N₁,   q̈ = T⁻¹z₁ − W y      (17), (18)
//                              [ 0  N'  z' ]        A' = A − U W = N'ᵀN'                               (14), (16)
//
// so that the rows below are what the parent sees; where they are many, a further Q reduces them to as many as A' has
// rank. The rows [N' X(r) | z' − N' c] are stacked on the parent's own. Nothing is subtracted from anything of its own
// size: the error of A' is relative to each row, whatever the other rows weigh, if rows and columns are pivoted (Powell
// and Reid 1969; Cox and Higham 1998, "Stability of Householder QR factorization for weighted least squares problems").
// v of a row is formed where it has most digits, not from the sums N: for the frame's own body from constants in its own
// axes, and for a child's rows, N' S_child = 0, from what S differs by from S_child.
// Rotors and springs come after the bodies, in a reflection of their own: together, each row of a heavy link would get a
// small share of the rotor's, and with it what heavy links push on each other (z beyond the range of N) would reach the
// rotor's row.
// The gyroscopic moment of a rotor with a body of its own is z of that body's rows. A free frame, which has no
// one S, takes that of the joint which carries most (free_root.hpp).
//
// What is left of the error is what rows of N in working precision are worth, and not how they are reduced. Where masses grow
// tenfold per link outward, 12 links, the light inner links stand between the world and what hardly moves, and one ε in the
// data moves B̂ by 520 ε. The pass in extended precision, with one kind of quantity rounded to double once wherever it is
// stored, all else exact, in ε of double, worst of 100 states and median (B̂):
//
//     reflected rows     96    2.9        r_pi              46    0.8        v of the rows      11    1.7
//     compressed rows    52    2.1        R                 12    1.0        W                  11    1.2
//     S against S_i      51    1.1        S_k                4    0.5        body rows, D      1.3    0.5
//     moved rows         49    2.5        all of these     180    6.0        all in double     141   10.9
//
// Sines with a tail or products of rotations in two parts would gain nothing: without R, r and S_k it is 140 as well.
//
// Applied forces have no square root; they stay a wrench p beside N, p' = p − Wᵀ (Sᵀp − τ).
#pragma once

#include <iim/body_root.hpp>
#include <iim/root_rows.hpp>
#include <iim/row.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

namespace iim::detail {

/// [N | z] of what one frame carries: its own body's rows as they are, and those of its children. Rows are compressed where
/// there would be more than `loose`: a reflection of twenty rows costs little more than one of ten, and compressing as much
/// as several. (The pass of the biped takes 4.8 µs with 10, 3.6 with 20, 3.12 with 26 and 3.04 with 32, where registers hold
/// eight numbers, on another processor 3.26 with 26 and 3.17 with 34; where they hold two, 26 is the best.) More rows than
/// rank have a residual in z; where it is a force between heavy bodies its roundings move what is much lighter, and rows are
/// compressed.
template <class Scalar>
struct RootInertia {
  static constexpr int loose = register_lanes<Scalar> == 8 ? 34 : 26;
  static constexpr int most = loose + 6;
  static constexpr int within = 4;  ///< and for rotors and springs
  static constexpr int most_within = 64;  ///< of these, on a subsystem of any kind
  std::array<RootRow<Scalar>, most + within + abreast> row;
  int rows = 0;
  static constexpr int outweighed = 3;  ///< by a factor of nine in mass
  Scalar heaviest;       ///< √m of the heaviest body in the rows
  Eigen::Index apart_along = -1;  ///< of a free frame: the child whose column S is
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
/// of axes that nearly coincide it is all there is to see. A rotor or spring within makes A'S_i = Wᵀ slip: undoing the share
/// winds it up, and what the joint undoes is less. share = 0 for joints of several columns or frames.
template <class Scalar>
struct SharedAxis {
  Vector6<Scalar> difference;
  Scalar share;
  Scalar undone;  ///< share · W S_i, each of the two without subtracting the other from 1
  Scalar slip;    ///< share · (1 − W S_i)
};

/// Whether a subsystem may have anything but its bodies' rows.
template <class S>
constexpr bool has_within()
{
  return rotor_count<S>() + spring_count<S>() > 0;
}

/// Of a free frame, which moves by six columns: the joint `child` that carries most of what hangs on it, and its column S
/// (free_root.hpp, free_inward.hpp).
template <class Scalar>
struct FreeAxis {
  Eigen::Index frame;
  Eigen::Index child;
  // Matrix form: about the frame's point, in the axes of its A.
  Eigen::Index receiver = -1;  ///< FrameState that takes what the child hands on; −1: the frame's own, where nothing comes later
  Vector6<Scalar> S = Vector6<Scalar>::Unit(5);
  Vector6<Scalar> held = Vector6<Scalar>::Zero();  ///< of what the child hands on, A' S; then A S of all
  Scalar force = Scalar(0);                        ///< of what the child hands on, Sᵀ p'; then Sᵀ p of all but bias accelerations
  Scalar within = Scalar(0);                       ///< Sᵀ A' S of what the child hands on
  TriplePair<Scalar> size{};                       ///< of all else that the frame carries, and Sᵀ loss (roundings.hpp)
  Scalar loss = Scalar(0);
};
inline constexpr std::size_t free_rate = 6;  ///< row of the rate in G, which a free frame keeps in its first seven rows

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

/// N_b and z_b in world axes at the coupling point: √m (1, −s̃) with s the centre of mass, √θ_k (0, p_kᵀ). Writes six
/// rows, of which body.rows count, v for motion along S, and Σ |v| as if nothing had cancelled.
template <bool velocity, Along along, class Scalar>
[[gnu::always_inline]] inline void place_roots(const BodyRoot<Scalar>& body, const Matrix3<Scalar>& R,
                                               const Vector3<Scalar>& r, const Vector3<Scalar>& omega,
                                               const Vector6<Scalar>& S, RootRow<Scalar>* row, Scalar& scale)
{
  using std::abs;
  scale = Scalar(0);
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
    scale = body.own_scale;
  } else if constexpr (along == Along::column) {
#pragma GCC unroll 8
    for (int i = 0; i < 3; ++i) {
      const int j = (i + 1) % 3, k = (i + 2) % 3;
      const Scalar a = S(j + 3) * s(k), b = S(k + 3) * s(j);
      v(i) = m * (S(i) + (a - b));
      scale += m * (abs(S(i)) + abs(a) + abs(b));
    }
  }
  row[0] << m, zero, zero, zero, m * s(2), -m * s(1), -m * centripetal(0), v(0);
  row[1] << zero, m, zero, -m * s(2), zero, m * s(0), -m * centripetal(1), v(1);
  row[2] << zero, zero, m, m * s(1), -m * s(0), zero, -m * centripetal(2), v(2);
  Matrix3<Scalar> p;
  multiply(R, body.axes, p);
  Vector3<Scalar> gyro(zero, zero, zero);  // moments that the body's turning needs, over √θ_k
  if constexpr (velocity) {
    Vector3<Scalar> spin;  // ω in principal axes
#pragma GCC unroll 8
    for (int k = 0; k < 3; ++k) { spin(k) = p(0, k) * omega(0) + p(1, k) * omega(1) + p(2, k) * omega(2); }
#pragma GCC unroll 8
    for (int k = 0; k < 3; ++k) { gyro(k) = -body.gyration(k) * spin((k + 1) % 3) * spin((k + 2) % 3); }
  }
#pragma GCC unroll 8
  for (int k = 0; k < 3; ++k) {  // rows of no moment, the last, do not count
    const Scalar& t = body.root_moment(k);
    Scalar turn(0);
    if constexpr (along == Along::own_twist) {
      turn = body.angular(k);
    } else if constexpr (along == Along::column) {
      turn = t * (p(0, k) * S(3) + p(1, k) * S(4) + p(2, k) * S(5));
      scale += t * (abs(p(0, k) * S(3)) + abs(p(1, k) * S(4)) + abs(p(2, k) * S(5)));
    }
    row[k + 3] << zero, zero, zero, t * p(0, k), t * p(1, k), t * p(2, k), gyro(k), turn;
  }
}

/// The rows of the frame's own body, first of all.
template <bool velocity, Along along, class Scalar>
[[gnu::always_inline]] inline void place_roots(const BodyRoot<Scalar>& body, const Matrix3<Scalar>& R,
                                               const Vector3<Scalar>& r, const Vector3<Scalar>& omega,
                                               RootInertia<Scalar>& N)
{
  N.rows = body.rows;
  N.heaviest = body.root_mass;
  place_roots<velocity, along>(body, R, r, omega, N.S, N.row.data(), N.scale);
}

/// Takes from a wrench on a frame what the rows of the frame's own body carry, as a part of z: N_bᵀ z = wrench, one number for
/// each row. Beside N it would act by its roundings on what is lighter than the body; a load of 10⁹ kg on links of 1 kg cost q̈
/// eight digits. What is left is a moment about axes where the body has no row.
template <class Scalar>
RootRow<Scalar> put_on_rows(const BodyRoot<Scalar>& body, const Matrix3<Scalar>& R, const Vector3<Scalar>& r,
                            Vector6<Scalar>& wrench)
{
  RootRow<Scalar> z = RootRow<Scalar>::Zero();
  if (!(body.root_mass > Scalar(0))) { return z; }
  Vector3<Scalar> s = times(R, body.com);
  add(s, r);
  const Vector3<Scalar> force = linear(wrench);
  const Triple<Scalar> moment = triple(angular(wrench)) - cross(triple(s), triple(force));  // about the centre of mass
  Triple<Scalar> left(Scalar(0), Scalar(0), Scalar(0));
  Matrix3<Scalar> p;
  multiply(R, body.axes, p);
  for (int k = 0; k < 3; ++k) {
    z(k) = force(k) / body.root_mass;
    const Scalar along = dot(column(p, k), moment);
    if (k + 3 < body.rows) {
      z(k + 3) = along / body.root_moment(k);
    } else {
      left += column(p, k) * along;
    }
  }
  wrench.setZero();
  left.put(wrench.data() + 3);
  return z;
}

/// How a row changes where it is stacked on the inlet: n + Σ_k n(k) move[k] is N X(r), z − N known, v + n T.
template <class Scalar>
using RowMove = std::array<RootRow<Scalar>, 6>;

template <class Scalar>
[[gnu::always_inline]] inline RowMove<Scalar> row_move(const Vector3<Scalar>& r, const Vector6<Scalar>& known,
                                                       const Vector6<Scalar>& T)
{
  const Scalar zero(0);
  RowMove<Scalar> move;
  move[0] << zero, zero, zero, zero, r(2), -r(1), -known(0), T(0);
  move[1] << zero, zero, zero, -r(2), zero, r(0), -known(1), T(1);
  move[2] << zero, zero, zero, r(1), -r(0), zero, -known(2), T(2);
#pragma GCC unroll 8
  for (int k = 3; k < 6; ++k) {
    move[static_cast<std::size_t>(k)] << zero, zero, zero, zero, zero, zero, -known(k), T(k);
  }
  return move;
}

template <class Scalar>
[[gnu::always_inline]] inline RootRow<Scalar> moved(const RootRow<Scalar>& n, const RowMove<Scalar>& move)
{
  RootRow<Scalar> a = n, b = move[3] * n(3);
  a += move[0] * n(0), b += move[4] * n(4);
  a += move[1] * n(1), b += move[5] * n(5);
  a += move[2] * n(2);
  return a + b;
}

/// z − N a for an acceleration a that is already known.
template <class Scalar>
[[gnu::always_inline]] inline Scalar without_known(const RootRow<Scalar>& n, const Vector6<Scalar>& a)
{
  return n(rhs) - ((n(0) * a(0) + n(1) * a(1) + n(2) * a(2)) + (n(3) * a(3) + n(4) * a(4) + n(5) * a(5)));
}

/// Q of the file's head: takes the columns v (n per row) of `count` rows to T in the first n rows, and [N | z] along.
/// `scale`: what the entries of v would be without cancellation. False if T is singular up to roundings.
template <int n, class Scalar, int most>
[[gnu::always_inline]] inline bool eliminate(std::array<Eigen::Matrix<Scalar, n, 1>, most>& v,
                                             std::array<RootRow<Scalar>, most>& rows, int count,
                                             const Eigen::Matrix<Scalar, n, 1>& scale, Eigen::Matrix<Scalar, n, n>& C,
                                             RowTape<Scalar>* tape = nullptr)
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
    const Scalar first = x[0];
    const auto [alpha, factor] = reflector(x.data(), best);
    if (tape != nullptr) [[unlikely]] {
      const auto whole = [&](int r) -> const Scalar& { return r == 0 ? first : x[static_cast<std::size_t>(r)]; };
      tape->reflect(k, active, static_cast<int>(pivot), whole, alpha, factor);
    }
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

}  // namespace iim::detail
