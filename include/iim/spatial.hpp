// Twists, wrenches and 6×6 inertias in axes parallel to the world.
//
// Component order is linear before angular everywhere: twist (v, ω), acceleration (v̇, ω̇), wrench (f, n).
// All vectors of one subsystem are taken at one point, its reference point (the coupling point), in axes
// parallel to the world. Between two subsystems only the point moves, so that R_ip = 1 in (8) and
//
//     X(r) = [ 1  r̃ᵀ ; 0  1 ]        twist at x + r from the twist at x       (8), r = r_pi
#pragma once

#include <iim/numerics/triple.hpp>
#include <iim/scalar.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <array>
#include <cstddef>

namespace iim {

using Index = Eigen::Index;

template <class Scalar>
using Vector3 = Eigen::Matrix<Scalar, 3, 1>;
template <class Scalar>
using Matrix3 = Eigen::Matrix<Scalar, 3, 3>;
template <class Scalar>
using Vector6 = Eigen::Matrix<Scalar, 6, 1>;
template <class Scalar>
using Matrix6 = Eigen::Matrix<Scalar, 6, 6>;
template <class Scalar>
using VectorX = Eigen::Matrix<Scalar, Eigen::Dynamic, 1>;
template <class Scalar>
using MatrixX = Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic>;

static_assert(!Matrix3<double>::IsRowMajor,
              "iim reads matrices column by column: do not define EIGEN_DEFAULT_TO_ROW_MAJOR");

/// Cross-product matrix: skew(a) b = a × b.
template <class Scalar>
Matrix3<Scalar> skew(const Vector3<Scalar>& a)
{
  Matrix3<Scalar> m;
  m << Scalar(0), -a.z(), a.y(), a.z(), Scalar(0), -a.x(), -a.y(), a.x(), Scalar(0);
  return m;
}

// Products of three-vectors written out. In the hot path they replace Eigen's expressions, whose two-wide stores and
// loads of 3 × 3 blocks do not meet (stalls), and whose layers compilers do not inline: together a factor of three.
// Loops of the O(n) pass carry `#pragma GCC unroll`: g++ otherwise unrolls them only after it has decided which arrays
// can live in registers, and keeps theirs in memory (measured on the biped: 1.48 instead of 1.97 µs).
namespace detail {

template <class Scalar>
[[gnu::always_inline]] inline Vector3<Scalar> cross(const Vector3<Scalar>& a, const Vector3<Scalar>& b)
{
  return Vector3<Scalar>(a(1) * b(2) - a(2) * b(1), a(2) * b(0) - a(0) * b(2), a(0) * b(1) - a(1) * b(0));
}

template <class Scalar>
[[gnu::always_inline]] inline Vector3<Scalar> times(const Matrix3<Scalar>& R, const Vector3<Scalar>& a)
{
  return Vector3<Scalar>(R(0, 0) * a(0) + R(0, 1) * a(1) + R(0, 2) * a(2),
                         R(1, 0) * a(0) + R(1, 1) * a(1) + R(1, 2) * a(2),
                         R(2, 0) * a(0) + R(2, 1) * a(1) + R(2, 2) * a(2));
}

template <class Scalar>
[[gnu::always_inline]] inline Triple<Scalar> triple(const Vector3<Scalar>& a)
{
  return Triple<Scalar>(a(0), a(1), a(2));
}

template <class Scalar>
[[gnu::always_inline]] inline Triple<Scalar> column(const Matrix3<Scalar>& R, int j)
{
  return Triple<Scalar>(R.data() + 3 * j);
}

/// R a.
template <class Scalar, class Factors>
[[gnu::always_inline]] inline Triple<Scalar> combined(const Matrix3<Scalar>& R, const Factors& a)
{
  return column(R, 0) * a(0) + column(R, 1) * a(1) + column(R, 2) * a(2);
}

/// The columns of R, which was written some time ago (Triple::settled).
template <class Scalar>
[[gnu::always_inline]] inline std::array<Triple<Scalar>, 3> settled_columns(const Matrix3<Scalar>& R)
{
  const Scalar* x = R.data();
  return {Triple<Scalar>::settled(x), Triple<Scalar>::settled(x + 3), Triple<Scalar>::settled_after(x + 6)};
}
template <class Scalar, class Factors>
[[gnu::always_inline]] inline Triple<Scalar> combined(const std::array<Triple<Scalar>, 3>& R, const Factors& a)
{
  return R[0] * a(0) + R[1] * a(1) + R[2] * a(2);
}

/// C = A B, column by column. C may be A.
template <class Scalar>
[[gnu::always_inline]] inline void multiply(const Matrix3<Scalar>& A, const Matrix3<Scalar>& B, Matrix3<Scalar>& C)
{
  const Triple<Scalar> a = column(A, 0), b = column(A, 1), c = column(A, 2);
#pragma GCC unroll 8
  for (int j = 0; j < 3; ++j) { (a * B(0, j) + b * B(1, j) + c * B(2, j)).put(C.data() + 3 * j); }
}

/// R X Rᵀ.
template <class Scalar>
Matrix3<Scalar> turned(const Matrix3<Scalar>& R, const Matrix3<Scalar>& X)
{
  Matrix3<Scalar> RX, result;
  multiply(R, X, RX);
#pragma GCC unroll 8
  for (int j = 0; j < 3; ++j) {
    (column(RX, 0) * R(j, 0) + column(RX, 1) * R(j, 1) + column(RX, 2) * R(j, 2)).put(result.data() + 3 * j);
  }
  return result;
}

/// I += mass (rᵀr 1 − r rᵀ): the inertia of a point at r.
template <class Scalar>
void add_point(const Scalar& mass, const Vector3<Scalar>& r, Matrix3<Scalar>& I)
{
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      if (i == j) { continue; }
      I(i, i) += mass * (r(j) * r(j));
      I(i, j) -= mass * (r(i) * r(j));
    }
  }
}

/// [ M H ; Hᵀ J ].
template <class Scalar, class Block>
Matrix6<Scalar> in_blocks(const Matrix3<Scalar>& M, const Block& H, const Matrix3<Scalar>& J)
{
  Matrix6<Scalar> A;
  for (int j = 0; j < 3; ++j) {
    for (int i = 0; i < 3; ++i) {
      A(i, j) = M(i, j);
      A(i, j + 3) = A(j + 3, i) = H(i, j);
      A(i + 3, j + 3) = J(i, j);
    }
  }
  return A;
}

/// a += b.
template <class Scalar>
[[gnu::always_inline]] inline void add(Vector3<Scalar>& a, const Vector3<Scalar>& b)
{
#pragma GCC unroll 8
  for (int i = 0; i < 3; ++i) { a(i) += b(i); }
}
template <class Scalar>
[[gnu::always_inline]] inline void add(Vector6<Scalar>& a, const Vector6<Scalar>& b)
{
#pragma GCC unroll 8
  for (int i = 0; i < 6; ++i) { a(i) += b(i); }
}

template <class Scalar>
[[gnu::always_inline]] inline Vector3<Scalar> linear(const Vector6<Scalar>& V)
{
  return Vector3<Scalar>(V(0), V(1), V(2));
}
template <class Scalar>
[[gnu::always_inline]] inline Vector3<Scalar> angular(const Vector6<Scalar>& V)
{
  return Vector3<Scalar>(V(3), V(4), V(5));
}
template <class Scalar>
[[gnu::always_inline]] inline void set(Vector6<Scalar>& V, const Vector3<Scalar>& lin, const Vector3<Scalar>& ang)
{
#pragma GCC unroll 8
  for (int i = 0; i < 3; ++i) {
    V(i) = lin(i);
    V(i + 3) = ang(i);
  }
}

}  // namespace detail

/// Twist (or any motion vector) at x + r from the one at x: (v + ω × r, ω).
template <class Scalar>
[[gnu::always_inline]] inline Vector6<Scalar> shift_twist(const Vector3<Scalar>& r, const Vector6<Scalar>& V)
{
  Vector6<Scalar> shifted;
  shifted(0) = V(0) + (V(4) * r(2) - V(5) * r(1));
  shifted(1) = V(1) + (V(5) * r(0) - V(3) * r(2));
  shifted(2) = V(2) + (V(3) * r(1) - V(4) * r(0));
#pragma GCC unroll 8
  for (int i = 3; i < 6; ++i) { shifted(i) = V(i); }
  return shifted;
}

/// Wrench about x of a wrench that is given about x + r: (f, n + r × f), the transpose of shift_twist.
template <class Scalar>
[[gnu::always_inline]] inline Vector6<Scalar> shift_wrench(const Vector3<Scalar>& r, const Vector6<Scalar>& w)
{
  Vector6<Scalar> shifted;
#pragma GCC unroll 8
  for (int i = 0; i < 3; ++i) { shifted(i) = w(i); }
  shifted(3) = w(3) + (r(1) * w(2) - r(2) * w(1));
  shifted(4) = w(4) + (r(2) * w(0) - r(0) * w(2));
  shifted(5) = w(5) + (r(0) * w(1) - r(1) * w(0));
  return shifted;
}

/// Symmetric 3 × 3 matrix, six numbers.
template <class Scalar>
struct Symmetric3 {
  std::array<Scalar, 6> at;  ///< xx, xy, xz, yy, yz, zz

  static constexpr std::size_t place(int i, int j)
  {
    return static_cast<std::size_t>(i <= j ? i * (5 - i) / 2 + j : j * (5 - j) / 2 + i);
  }
  const Scalar& operator()(int i, int j) const { return at[place(i, j)]; }
  Scalar& operator()(int i, int j) { return at[place(i, j)]; }

  Matrix3<Scalar> dense() const
  {
    Matrix3<Scalar> m;
    for (int i = 0; i < 3; ++i) {
      for (int j = i; j < 3; ++j) { m(i, j) = m(j, i) = (*this)(i, j); }
    }
    return m;
  }

  /// R I Rᵀ for symmetric I: an inertia given in a frame, in the axes that R turns to.
  [[gnu::always_inline]] static Symmetric3 turned(const Matrix3<Scalar>& R, const Matrix3<Scalar>& I)
  {
    Symmetric3 turned;
#pragma GCC unroll 8
    for (int j = 0; j < 3; ++j) {
      Vector3<Scalar> I_Rt;  // column j of I Rᵀ
#pragma GCC unroll 8
      for (int i = 0; i < 3; ++i) { I_Rt(i) = I(i, 0) * R(j, 0) + I(i, 1) * R(j, 1) + I(i, 2) * R(j, 2); }
#pragma GCC unroll 8
      for (int i = 0; i <= j; ++i) { turned(i, j) = R(i, 0) * I_Rt(0) + R(i, 1) * I_Rt(1) + R(i, 2) * I_Rt(2); }
    }
    return turned;
  }

  [[gnu::always_inline]] detail::Triple<Scalar> diagonal() const { return {at[0], at[3], at[5]}; }

  /// += 2 (r·s) 1 − r sᵀ − s rᵀ.
  [[gnu::always_inline]] void add_offset(const detail::Triple<Scalar>& r, const detail::Triple<Scalar>& s)
  {
    const Scalar trace = Scalar(2) * dot(r, s);
#pragma GCC unroll 8
    for (int j = 0; j < 3; ++j) {
#pragma GCC unroll 8
      for (int i = 0; i <= j; ++i) { (*this)(i, j) -= r(i) * s(j) + s(i) * r(j); }
      (*this)(j, j) += trace;
    }
  }

  /// This × (x, y, z).
  [[gnu::always_inline]] detail::Triple<Scalar> times(const Scalar& x, const Scalar& y, const Scalar& z) const
  {
    const Scalar* const a = at.data();
    return {a[0] * x + a[1] * y + a[2] * z, a[1] * x + a[3] * y + a[4] * z, a[2] * x + a[4] * y + a[5] * z};
  }
  [[gnu::always_inline]] detail::Triple<Scalar> operator*(const detail::Triple<Scalar>& a) const
  {
    return times(a(0), a(1), a(2));
  }
  [[gnu::always_inline]] Vector3<Scalar> operator*(const Vector3<Scalar>& a) const
  {
    return {at[0] * a(0) + at[1] * a(1) + at[2] * a(2), at[1] * a(0) + at[3] * a(1) + at[4] * a(2),
            at[2] * a(0) + at[4] * a(1) + at[5] * a(2)};
  }
};

namespace detail {

/// Unit quaternion (x, y, z, w) as a rotation; what its length is off is divided out. False beyond 1e-3.
template <class Scalar>
bool rotation_of(const Scalar& x, const Scalar& y, const Scalar& z, const Scalar& w, Matrix3<Scalar>& E)
{
  const Scalar length2 = x * x + y * y + z * z + w * w;
  const Scalar s = Scalar(2) / length2;
  E << Scalar(1) - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w),  //
      s * (x * y + z * w), Scalar(1) - s * (x * x + z * z), s * (y * z - x * w),   //
      s * (x * z - y * w), s * (y * z + x * w), Scalar(1) - s * (x * x + y * y);
  return ScalarTraits<Scalar>::is_positive(length2 - Scalar(0.998)) &&
         ScalarTraits<Scalar>::is_positive(Scalar(1.002) - length2);
}

/// A rotation again, up to roundings, from one that a path's roundings have stretched.
template <class Scalar>
[[gnu::noinline]] void straighten(Matrix3<Scalar>& R)
{
  const Triple<Scalar> a = column(R, 0), b = column(R, 1), c = column(R, 2);
  const auto stretch = [](const Triple<Scalar>& x) { return Scalar(0.5) * (dot(x, x) - Scalar(1)); };
  (a - a * stretch(a)).put(R.data());
  (b - (b * stretch(b) + a * dot(a, b))).put(R.data() + 3);
  (c - (c * stretch(c) + a * dot(a, c) + b * dot(b, c))).put(R.data() + 6);
}

}  // namespace detail

/// Symmetric 6×6 map from accelerations to wrenches, [ M H ; Hᵀ J ], about one point; 21 numbers.
template <class Scalar>
struct SpatialInertia {
  using Rotational = Symmetric3<Scalar>;
  Symmetric3<Scalar> M;  ///< force per linear acceleration
  Matrix3<Scalar> H;     ///< force per angular acceleration
  Symmetric3<Scalar> J;  ///< moment per angular acceleration

  void set_zero()
  {
    M.at.fill(Scalar(0));
    J.at.fill(Scalar(0));
    Scalar* const h = H.data();
#pragma GCC unroll 8
    for (int k = 0; k < 9; ++k) { h[k] = Scalar(0); }
  }

  /// One rigid body: mass m, first moment mc = m·(centre − point), rotational inertia Θ about the point.
  [[gnu::always_inline]] void set_rigid(const Scalar& m, const detail::Triple<Scalar>& mc, const Rotational& Theta)
  {
    const Scalar zero(0);
    M.at = {m, zero, zero, m, zero, m};
    H(0, 0) = zero, H(0, 1) = mc(2), H(0, 2) = -mc(1);
    H(1, 0) = -mc(2), H(1, 1) = zero, H(1, 2) = mc(0);
    H(2, 0) = mc(1), H(2, 1) = -mc(0), H(2, 2) = zero;
    J = Theta;
  }

  [[gnu::always_inline]] SpatialInertia& operator+=(const SpatialInertia& other)
  {
    for (std::size_t k = 0; k < 6; ++k) {
      M.at[k] += other.M.at[k];
      J.at[k] += other.J.at[k];
    }
    Scalar* const h = H.data();
    const Scalar* const b = other.H.data();
#pragma GCC unroll 8
    for (int k = 0; k < 9; ++k) { h[k] += b[k]; }
    return *this;
  }

  /// Adds X(r)ᵀ A X(r): the inertia A, given about the point r away, about this point.
  [[gnu::always_inline]] void add_shifted(const SpatialInertia& A, const Vector3<Scalar>& r)
  {
    // H' = H − M r̃,   J' = J + r̃ H' − Hᵀ r̃
    Matrix3<Scalar> S;
#pragma GCC unroll 8
    for (int i = 0; i < 3; ++i) {
      S(i, 0) = A.H(i, 0) - (A.M(i, 1) * r(2) - A.M(i, 2) * r(1));
      S(i, 1) = A.H(i, 1) - (A.M(i, 2) * r(0) - A.M(i, 0) * r(2));
      S(i, 2) = A.H(i, 2) - (A.M(i, 0) * r(1) - A.M(i, 1) * r(0));
    }
#pragma GCC unroll 8
    for (int j = 0; j < 3; ++j) {
#pragma GCC unroll 8
      for (int i = 0; i <= j; ++i) {
        const int i1 = (i + 1) % 3, i2 = (i + 2) % 3, j1 = (j + 1) % 3, j2 = (j + 2) % 3;
        // (r̃ H')_ij and (r̃ H)_ji
        J(i, j) += A.J(i, j) + ((r(i1) * S(i2, j) - r(i2) * S(i1, j)) + (r(j1) * A.H(j2, i) - r(j2) * A.H(j1, i)));
      }
    }
    for (std::size_t k = 0; k < 6; ++k) { M.at[k] += A.M.at[k]; }
#pragma GCC unroll 8
    for (int k = 0; k < 9; ++k) { H(k % 3, k / 3) += S(k % 3, k / 3); }
  }

  /// X(r)ᵀ A X(r) alone.
  SpatialInertia shifted(const Vector3<Scalar>& r) const
  {
    SpatialInertia result;
    result.set_zero();
    result.add_shifted(*this, r);
    return result;
  }

  /// A (a; 0), A (0; a).
  template <class Factors>
  [[gnu::always_inline]] detail::TriplePair<Scalar> of_linear(const Factors& a) const
  {
    const Scalar* const h = H.data();
    const Scalar x = a(0), y = a(1), z = a(2);
    return {M.times(x, y, z),
            {h[0] * x + h[1] * y + h[2] * z, h[3] * x + h[4] * y + h[5] * z, h[6] * x + h[7] * y + h[8] * z}};
  }
  template <class Factors>
  [[gnu::always_inline]] detail::TriplePair<Scalar> of_angular(const Factors& a) const
  {
    const Scalar* const h = H.data();
    const Scalar x = a(0), y = a(1), z = a(2);
    return {{h[0] * x + h[3] * y + h[6] * z, h[1] * x + h[4] * y + h[7] * z, h[2] * x + h[5] * y + h[8] * z},
            J.times(x, y, z)};
  }

  Matrix6<Scalar> dense() const { return detail::in_blocks(M.dense(), H, J.dense()); }
};

}  // namespace iim

#include <iim/numerics/inertia_columns.hpp>
