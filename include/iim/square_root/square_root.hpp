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
// v of a row is formed where it has most digits, not from the sums N: for the frame's own body from constants in its
// own axes, and for a child's rows, N' S_child = 0, from what S differs by from S_child. Rotors and springs come after
// the bodies, in rotations of their own: together, each row of a heavy link would get a small share of the rotor's, and
// with it what heavy links push on each other (z beyond the range of N) would reach the rotor's row. The gyroscopic
// moment of a rotor with a body of its own is z of that body's rows. A free frame, which has no one S, takes that of
// the joint which carries most (free_root.hpp).
//
// What is left of the error is what rows of N in working precision are worth, and not how they are reduced. Where
// masses grow tenfold per link outward, 12 links, the light inner links stand between the world and what hardly moves,
// and one ε in the data moves B̂ by 520 ε. The pass in extended precision, with one kind of quantity rounded to double
// once wherever it is stored, all else exact, in ε of double, worst of 100 states and median (B̂):
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

#include <iim/numerics/row.hpp>
#include <iim/numerics/triple.hpp>
#include <iim/pass/joint_lines.hpp>
#include <iim/spatial.hpp>
#include <iim/square_root/body_root.hpp>
#include <iim/square_root/root_rows.hpp>
#include <iim/subsystem.hpp>

#include <array>
#include <cmath>
#include <cstddef>

namespace iim::detail {

/// The rows of one body.
template <class Scalar>
struct OwnRows {
  using Rows = RootRows<Scalar, BodyRoot<Scalar>::most_rows>;
  Rows rows;

  OwnRows()
  {
    rows.open(Rows::most);
    rows.count = 0;
  }
  /// √m in the first three columns, which does not change.
  void set(const BodyRoot<Scalar>& body)
  {
    rows.count = body.rows;
    for (int k = 0; k < 3; ++k) { *rows.at(k, k) = body.root_mass; }
  }
  Scalar& at(int c, int k) { return *rows.at(c, k); }
  const Scalar& at(int c, int k) const { return *rows.at(c, k); }
  [[gnu::always_inline]] void put(int c, const Triple<Scalar>& of_mass, const Triple<Scalar>& of_moments)
  {
    of_mass.put(rows.at(c, 0));
    of_moments.put(rows.at(c, 3));
  }
};

/// [N | z] of what one frame carries: the rows of its own body, and those of its children, each beginning with a new
/// register. Rows are compressed where there would be more than `loose`: a reflection of forty rows costs little more
/// than one of twenty, and compressing as much as several (AVX-512: a chain of twenty takes 430 cycles a joint with 64,
/// 440 with 48, 446 with 32). More rows than rank have a residual in z; where it is a force between heavy bodies its
/// roundings move what is much lighter, and rows are compressed.
template <class Scalar>
struct RootInertia {
  static constexpr int loose = rows_abreast<Scalar> >= 8 ? 64 : 40;
  static constexpr int loose_on_free = 2 * loose + 8;  ///< where all are compressed to six
  /// With what lies within a child, its bodies on the inlet, and to whole registers.
  static constexpr int most = loose_on_free + 32;
  static constexpr int within = 4;        ///< rotors and springs of a subsystem of one column
  static constexpr int most_within = 64;  ///< and of any kind
  using Rows = RootRows<Scalar, most>;
  std::size_t place;  ///< of its rows (WorkspaceData::rows)
  OwnRows<Scalar> own;
  std::array<RootRow<Scalar>, 7> G;     ///< of a free frame (free_root.hpp)
  static constexpr int outweighed = 3;  ///< by a factor of nine in mass
  Scalar heaviest;                      ///< √m of the heaviest body in the rows
  bool is_reduced = false;              ///< whether reduced_from is looked at
  RootRow<Scalar> reduced_from;         ///< Σ |n| of rows that its children's were reduced from
  bool is_free = false;
  bool keeps_v = false;  ///< the rows have v = n S in their last lane
  Vector6<Scalar> S;     ///< if so
  Scalar scale;          ///< and Σ |v| as if nothing had cancelled in it
  Vector6<Scalar> h;     ///< bias wrench of the children alone
  Scalar h_along;        ///< and Sᵀ h
  Vector6<Scalar> rest;  ///< acceleration of the frame without S·rate
  Scalar rate;           ///< coefficient of S in it
};

/// S of the inlet as a child sees it: X(r) S_inlet = difference + share S_i. Where A'S_i = 0, a share of the inlet's
/// rate is undone by the child's own joint without anything else moving, so that only the difference acts on what
/// follows; of axes that nearly coincide it is all there is to see. A rotor or spring within makes A'S_i = Wᵀ slip:
/// undoing the share winds it up, and what the joint undoes is less. Joints of several columns have shares where S of a
/// free inlet is among their motions at any state (common_motion.hpp), others, and those of several frames, have none.
template <class Scalar>
struct SharedAxis {
  Sense sense = Sense::none;  ///< of S_i and S_inlet where they are the same at any state: then nothing differs
  Vector6<Scalar> difference;
  Scalar share;                                      ///< of a joint of one column
  Vector6<Scalar> undone = Vector6<Scalar>::Zero();  ///< shares · W S_i, each of the two without subtracting the other
                                                     ///< from 1
  Scalar slip;                                       ///< share · (1 − W S_i)
};

inline constexpr std::size_t free_rate = 6;  ///< row of the rate in RootInertia::G

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
  if (S::n_i != 1 || S::n_frames != 1 || is_free<S>() || within > RootInertia<typename S::Scalar>::within) {
    return Along::nothing;
  }
  return has_own_twist<S>() ? Along::own_twist : Along::column;
}

/// N_b and z_b in world axes at the coupling point: √m (1, −s̃) with s the centre of mass, √θ_k (0, p_kᵀ). v for motion
/// along S, and Σ |v| as if nothing had cancelled.
template <bool velocity, Along along, class Scalar>
[[gnu::always_inline]] inline void place_roots(const BodyRoot<Scalar>& body, const Matrix3<Scalar>& R,
                                               const Vector3<Scalar>& r, const Vector3<Scalar>& omega,
                                               const Vector6<Scalar>& S, OwnRows<Scalar>& own, Scalar& scale)
{
  using std::abs;
  scale = Scalar(0);
  if (body.rows == 0) { return; }
  const Scalar& m = body.root_mass;
  const Triple<Scalar> of_com = combined(R, body.com) + Triple<Scalar>(r.data()), of_frame = triple(omega);
  const Vector3<Scalar> s(of_com(0), of_com(1), of_com(2));
  const Triple<Scalar> root_moment(body.root_moment.data());
  Triple<Scalar> turn(Scalar(0), Scalar(0), Scalar(0)), spin = turn,
                                                        v = turn;  // v of both parts, and ω in principal axes
  const Triple<Scalar> axes[3] = {Triple<Scalar>(body.to_axes.data()), Triple<Scalar>(body.to_axes.data() + 3),
                                  Triple<Scalar>(body.to_axes.data() + 6)};
#pragma GCC unroll 8
  for (int j = 0; j < 3; ++j) {
    const Triple<Scalar> p = axes[0] * R(j, 0) + axes[1] * R(j, 1) + axes[2] * R(j, 2);
    const Triple<Scalar> n = p * root_moment;
    n.put(&own.at(3 + j, 3));
    if constexpr (velocity) { spin += p * omega(j); }
    if constexpr (along == Along::column) {
      turn += n * S(3 + j);
#pragma GCC unroll 8
      for (int k = 0; k < 3; ++k) { scale += abs(n(k) * S(3 + j)); }
    }
    const int i = (j + 1) % 3, k = (j + 2) % 3;
    own.at(3 + j, i) = -m * s(k);
    own.at(3 + j, k) = m * s(i);
  }
  if constexpr (along == Along::own_twist) {
    v = combined(R, body.linear);
    scale = body.own_scale;
    turn = Triple<Scalar>(body.angular.data());
  } else if constexpr (along == Along::column) {
    Vector3<Scalar> of_mass;
#pragma GCC unroll 8
    for (int i = 0; i < 3; ++i) {
      const int j = (i + 1) % 3, k = (i + 2) % 3;
      const Scalar a = S(j + 3) * s(k), b = S(k + 3) * s(j);
      of_mass(i) = m * (S(i) + (a - b));
      scale += m * (abs(S(i)) + abs(a) + abs(b));
    }
    v = triple(of_mass);
  }
  if constexpr (along != Along::nothing) { own.put(along_S, v, turn); }
  const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
  if constexpr (velocity) {  // centripetal accelerations, and moments that the body's turning needs, over √θ_k
    own.put(rhs, cross(of_frame, cross(of_frame, of_com)) * Scalar(-m),
            Triple<Scalar>(body.gyration.data()) * (spin.turned() * spin.turned().turned()) * Scalar(-1));
  } else {
    own.put(rhs, zero, zero);
  }
}

/// The rows of the frame's own body.
template <bool velocity, Along along, class Scalar>
[[gnu::always_inline]] inline void place_roots(const BodyRoot<Scalar>& body, const Matrix3<Scalar>& R,
                                               const Vector3<Scalar>& r, const Vector3<Scalar>& omega,
                                               RootInertia<Scalar>& N)
{
  N.heaviest = body.root_mass;
  N.is_reduced = false;
  place_roots<velocity, along>(body, R, r, omega, N.S, N.own, N.scale);
}

/// Takes from a wrench on a frame what the rows of the frame's own body carry, as a part of z: N_bᵀ z = wrench, one
/// number for each row. Beside N it would act by its roundings on what is lighter than the body; a load of 10⁹ kg on
/// links of 1 kg cost q̈ eight digits. What is left is a moment about axes where the body has no row.
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

/// How rows change where they are stacked on the inlet: N X(r), z − N known, v + N T.
template <class Scalar>
struct RowMove {
  Vector3<Scalar> r;
  Vector6<Scalar> known, T;
};

/// Puts rows to others. n(r): those from row r on that one register takes, column by column. To `scale` Σ |n| |T|.
template <bool with_v, class Scalar, int most, class Rows>
[[gnu::always_inline]] inline void move_rows(Rows&& n, Eigen::Index count, const RowMove<Scalar>& move,
                                             RootRows<Scalar, most>& onto, Scalar& scale)
{
  using std::abs;
  using Part = RowsPart<Scalar>;
  constexpr int lanes = rows_abreast<Scalar>;
  const Vector3<Scalar>& r = move.r;
  const Vector6<Scalar>&known = move.known, &T = move.T;
  Vector6<Scalar> size;
#pragma GCC unroll 8
  for (int k = 0; k < 6; ++k) { size(k) = abs(T(k)); }
  Part sum = no_rows<Scalar>(), other = sum;
  const Eigen::Index begin = onto.end();
#pragma GCC unroll 1
  for (Eigen::Index row = 0; row < count; row += lanes) {
    const auto a = n(row);
    const Eigen::Index to = begin + row;
    Part z = a[rhs] - a[0] * known(0), of_turning = a[3] * known(3);
    Part v = a[0] * T(0), v_of_turning = a[3] * T(3);
    if constexpr (with_v) { v += a[along_S]; }
#pragma GCC unroll 8
    for (std::size_t k = 1; k < 3; ++k) {
      z -= a[k] * known(static_cast<int>(k)), of_turning += a[k + 3] * known(static_cast<int>(k + 3));
      v += a[k] * T(static_cast<int>(k)), v_of_turning += a[k + 3] * T(static_cast<int>(k + 3));
    }
#pragma GCC unroll 8
    for (std::size_t k = 0; k < 3; ++k) {
      sum += without_signs<Scalar>(a[k]) * size(static_cast<int>(k));
      other += without_signs<Scalar>(a[k + 3]) * size(static_cast<int>(k + 3));
      put_rows<Scalar>(a[k], onto.at(static_cast<int>(k), to));
    }
    put_rows<Scalar>((a[3] - a[1] * r(2)) + a[2] * r(1), onto.at(3, to));
    put_rows<Scalar>((a[4] - a[2] * r(0)) + a[0] * r(2), onto.at(4, to));
    put_rows<Scalar>((a[5] - a[0] * r(1)) + a[1] * r(0), onto.at(5, to));
    put_rows<Scalar>(z - of_turning, onto.at(rhs, to));
    put_rows<Scalar>(v + v_of_turning, onto.at(along_S, to));
  }
  onto.count = begin + count;
  scale += sum_of_rows<Scalar>(sum + other);
}

template <class Scalar>
[[gnu::always_inline]] inline Scalar dot_of_sizes(const TriplePair<Scalar>& a, const TriplePair<Scalar>& b)
{
  using std::abs;
  const Triple<Scalar> linear = a.linear * b.linear, angular = a.angular * b.angular;
  return ((abs(linear(0)) + abs(linear(1))) + abs(linear(2))) + ((abs(angular(0)) + abs(angular(1))) + abs(angular(2)));
}

/// One row.
template <class Scalar>
[[gnu::always_inline]] inline SingleRow<Scalar> moved(const SingleRow<Scalar>& row, const RowMove<Scalar>& move,
                                                      Scalar& scale)
{
  const TriplePair<Scalar> T(move.T.data());
  scale += dot_of_sizes(row.n, T);
  return {{row.n.linear, row.n.angular + cross(Triple<Scalar>(move.r.data()), row.n.linear)},
          row.z - dot(row.n, TriplePair<Scalar>(move.known.data())),
          row.v + dot(row.n, T)};
}

/// Whether T² > 16 ε size²: T is a pivot of v = n S, size the same of the rows |n| that n was reduced from. Where n S
/// is nearly zero, as of a child that moves alike, T is turned by ε·size/T, and its row gets as much of rows that may
/// be as large as size: D⁻¹ is wrong by up to ε (size/T)², mostly a tenth of it. (In float, a light ball with a heavy
/// one on it was 10 % wrong at 10⁻⁶ of its mass.)
template <class Scalar>
bool stands_out(const Scalar& T, const Scalar& size)
{
  return !ScalarTraits<Scalar>::is_positive(Scalar(16) * Eigen::NumTraits<Scalar>::epsilon() * (size * size) - T * T);
}

/// Q of the file's head: takes the columns v, from the eighth on, to T, and [N | z] along; the rows that it takes, [N₁
/// | z₁ | T], are top. `scale`: what the entries of v would be without cancellation; reduced_from: of the rows that the
/// children's were reduced from. False if T is singular up to roundings, or does not stand out from those of the
/// latter.
template <int n, class Scalar, int most, std::size_t padded>
bool eliminate(RootRows<Scalar, most, 7 + n>& rows, const Eigen::Matrix<Scalar, n, 1>& scale,
               const Eigen::Matrix<Scalar, n, 1>& reduced_from,
               std::array<std::array<Scalar, padded>, static_cast<std::size_t>(n)>& top, Eigen::Matrix<Scalar, n, n>& C,
               RowTape<Scalar>* tape = nullptr)
{
  using std::abs;
  for (auto& row : top) { row.fill(Scalar(0)); }
  std::array<Scalar, padded> square = squares(rows);
  std::array<int, n> order;
  std::array<bool, n> done{};
  for (int k = 0; k < n; ++k) {
    int column = 0;
    Scalar best(-1);
    for (int c = 0; c < n; ++c) {
      const bool better = !done[static_cast<std::size_t>(c)] && square[static_cast<std::size_t>(7 + c)] > best;
      column = better ? c : column;
      best = better ? square[static_cast<std::size_t>(7 + c)] : best;
    }
    done[static_cast<std::size_t>(column)] = true;
    order[static_cast<std::size_t>(k)] = column;
    Reflection<Scalar, 7 + n> reflection;
    if (!find_reflection<true>(rows, 7 + column, reflection, tape, rows.count + k)) { return false; }
    top[static_cast<std::size_t>(k)] = reflection.top;
    // Below this v is made of roundings: the coordinate moves nothing, or no digit of what it moves is left.
    const Scalar negligible = Scalar(64) * Eigen::NumTraits<Scalar>::epsilon() * scale(column);
    const Scalar& T = reflection.top[static_cast<std::size_t>(7 + column)];
    if (!ScalarTraits<Scalar>::is_positive(abs(T) - negligible) || !stands_out(T, reduced_from(column))) {
      return false;
    }
    reflect(rows, reflection, [](const auto&, Eigen::Index) {});
    if (k + 1 < n) { square = squares(rows); }
  }
  // C = T⁻¹, T upper triangular in the order of elimination: row order[k] of C by substitution from the last.
  const auto t = [&](int k, int d) { return top[static_cast<std::size_t>(k)][static_cast<std::size_t>(7 + d)]; };
  for (int k = n - 1; k >= 0; --k) {
    const int row = order[static_cast<std::size_t>(k)];
    const Scalar inverse = Scalar(1) / t(k, row);
    for (int c = 0; c < n; ++c) {
      Scalar sum = c == k ? Scalar(1) : Scalar(0);
      for (int l = k + 1; l < n; ++l) {
        sum -= t(k, order[static_cast<std::size_t>(l)]) * C(order[static_cast<std::size_t>(l)], c);
      }
      C(row, c) = sum * inverse;
    }
  }
  return true;
}

}  // namespace iim::detail
