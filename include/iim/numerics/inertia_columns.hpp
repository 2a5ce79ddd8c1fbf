// SpatialInertia of one state in float or double: columns of 3 × 3 blocks, each in a register.
//
// A step of the inward loop is then some ninety vector operations in place of five hundred on single numbers. M and J
// are kept whole; what rounds differently above and below their diagonals does not grow: `shifted` takes the mean.
#pragma once

#include <iim/numerics/triple.hpp>
#include <iim/spatial.hpp>

#include <array>
#include <cstddef>

namespace iim {

namespace detail {

/// 3 × 3, by columns.
template <class Scalar>
struct ColumnBlock {
  std::array<Triple<Scalar>, 3> column;

  [[gnu::always_inline]] Scalar operator()(int i, int j) const { return column[static_cast<std::size_t>(j)](i); }
  Scalar& operator()(int i, int j) { return reinterpret_cast<Scalar*>(&column[static_cast<std::size_t>(j)])[i]; }

  /// This × x.
  [[gnu::always_inline]] Triple<Scalar> times(const Scalar& x, const Scalar& y, const Scalar& z) const
  {
    return column[0] * x + column[1] * y + column[2] * z;
  }
  [[gnu::always_inline]] Triple<Scalar> operator*(const Triple<Scalar>& x) const
  {
    return column[0] * x.template all<0>() + column[1] * x.template all<1>() + column[2] * x.template all<2>();
  }
  [[gnu::always_inline]] ColumnBlock transposed() const
  {
    ColumnBlock t;
    transpose(column[0], column[1], column[2], t.column.data());
    return t;
  }
  /// Symmetric, from the upper triangle.
  [[gnu::always_inline]] ColumnBlock mirrored() const
  {
    return {{mirror_first(column[0], column[1], column[2]), mirror_second(column[1], column[2]), column[2]}};
  }
  [[gnu::always_inline]] ColumnBlock& operator+=(const ColumnBlock& other)
  {
    column[0] += other.column[0], column[1] += other.column[1], column[2] += other.column[2];
    return *this;
  }
  /// += a bᵀ.
  [[gnu::always_inline]] void add_dyad(const Triple<Scalar>& a, const Triple<Scalar>& b)
  {
    column[0] = column[0] + a * b.template all<0>();
    column[1] = column[1] + a * b.template all<1>();
    column[2] = column[2] + a * b.template all<2>();
  }
  /// −= a bᵀ.
  [[gnu::always_inline]] void subtract_dyad(const Triple<Scalar>& a, const Triple<Scalar>& b)
  {
    column[0] = column[0] - a * b.template all<0>();
    column[1] = column[1] - a * b.template all<1>();
    column[2] = column[2] - a * b.template all<2>();
  }
  /// this·r̃.
  [[gnu::always_inline]] ColumnBlock times_skew(const Vector3<Scalar>& r) const
  {
    return {{column[1] * r(2) - column[2] * r(1), column[2] * r(0) - column[0] * r(2),
             column[0] * r(1) - column[1] * r(0)}};
  }

  /// R I Rᵀ for symmetric I. R was written some time ago.
  [[gnu::always_inline]] static ColumnBlock turned(const Matrix3<Scalar>& R, const Matrix3<Scalar>& I)
  {
    const ColumnBlock axes{settled_columns(R)};
    const ColumnBlock RI{{axes.times(I(0, 0), I(1, 0), I(2, 0)), axes.times(I(0, 1), I(1, 1), I(2, 1)),
                          axes.times(I(0, 2), I(1, 2), I(2, 2))}};
    return {{RI.times(R(0, 0), R(0, 1), R(0, 2)), RI.times(R(1, 0), R(1, 1), R(1, 2)),
             RI.times(R(2, 0), R(2, 1), R(2, 2))}};
  }
  /// += 2 (r·s) 1 − r sᵀ − s rᵀ.
  [[gnu::always_inline]] void add_offset(const Triple<Scalar>& r, const Triple<Scalar>& s)
  {
    const Scalar zero(0), trace = Scalar(2) * dot(r, s);
    subtract_dyad(r, s);
    subtract_dyad(s, r);
    column[0] += Triple<Scalar>(trace, zero, zero);
    column[1] += Triple<Scalar>(zero, trace, zero);
    column[2] += Triple<Scalar>(zero, zero, trace);
  }

  [[gnu::always_inline]] Triple<Scalar> diagonal() const { return diagonal_of(column[0], column[1], column[2]); }

  Matrix3<Scalar> dense() const
  {
    Matrix3<Scalar> m;
    for (int j = 0; j < 3; ++j) {
      for (int i = 0; i < 3; ++i) { m(i, j) = (*this)(i, j); }
    }
    return m;
  }
  operator Symmetric3<Scalar>() const
  {
    const auto& b = *this;
    return {{b(0, 0), b(0, 1), b(0, 2), b(1, 1), b(1, 2), b(2, 2)}};
  }
};

}  // namespace detail

template <class Scalar>
  requires detail::three_in_register<Scalar>
struct SpatialInertia<Scalar> {
  using Triple = detail::Triple<Scalar>;
  using Rotational = detail::ColumnBlock<Scalar>;
  detail::ColumnBlock<Scalar> M, H, J;

  void set_zero()
  {
    const Triple zero = Triple::all(Scalar(0));
    M.column = {zero, zero, zero};
    H = M;
    J = M;
  }

  [[gnu::always_inline]] void set_rigid(Scalar m, const Triple& mc, const Rotational& Theta)
  {
    const Scalar zero(0);
    M.column = {Triple(m, zero, zero), Triple(zero, m, zero), Triple(zero, zero, m)};
    skew_transposed(mc, H.column.data());
    J = Theta;
  }

  [[gnu::always_inline]] SpatialInertia& operator+=(const SpatialInertia& other)
  {
    M += other.M;
    H += other.H;
    J += other.J;
    return *this;
  }

  /// X(r)ᵀ A X(r): this inertia about a point from which its own is r away.
  [[gnu::always_inline]] SpatialInertia shifted(const Vector3<Scalar>& r) const
  {
    // H' = H − M r̃,  J' = ½ (K + Kᵀ),  K = J + r̃ (H + H')
    const auto Mr = M.times_skew(r);
    SpatialInertia result;
    detail::ColumnBlock<Scalar> H2;
#pragma GCC unroll 8
    for (std::size_t j = 0; j < 3; ++j) { H2.column[j] = H.column[j] - Mr.column[j] * Scalar(0.5); }
    const auto G = H2.transposed().times_skew(r);  // Kᵀ = J/2 − Gᵀ
    detail::ColumnBlock<Scalar> K;
#pragma GCC unroll 8
    for (std::size_t j = 0; j < 3; ++j) { K.column[j] = J.column[j] * Scalar(0.5) - G.column[j]; }
    const auto Kt = K.transposed();
    result.M = M.mirrored();
#pragma GCC unroll 8
    for (std::size_t j = 0; j < 3; ++j) {
      result.H.column[j] = H.column[j] - Mr.column[j];
      result.J.column[j] = K.column[j] + Kt.column[j];
    }
    return result;
  }

  [[gnu::always_inline]] void add_shifted(const SpatialInertia& A, const Vector3<Scalar>& r) { *this += A.shifted(r); }

  /// A (a; 0), A (0; a).
  template <class Factors>
  [[gnu::always_inline]] detail::TriplePair<Scalar> of_linear(const Factors& a) const
  {
    return {M.times(a(0), a(1), a(2)), H.transposed().times(a(0), a(1), a(2))};
  }
  template <class Factors>
  [[gnu::always_inline]] detail::TriplePair<Scalar> of_angular(const Factors& a) const
  {
    return {H.times(a(0), a(1), a(2)), J.times(a(0), a(1), a(2))};
  }

  Matrix6<Scalar> dense() const { return detail::in_blocks(M.dense(), H, J.dense()); }
};

namespace detail {

/// to = from, column by column: g++ copies the whole in pieces of another size than it was stored in, which then wait
/// for that.
template <class Scalar>
[[gnu::always_inline]] inline void copy(const SpatialInertia<Scalar>& from, SpatialInertia<Scalar>& to)
{
  if constexpr (three_in_register<Scalar>) {
#pragma GCC unroll 8
    for (std::size_t j = 0; j < 3; ++j) {
      to.M.column[j] = from.M.column[j];
      to.H.column[j] = from.H.column[j];
      to.J.column[j] = from.J.column[j];
    }
  } else {
    to = from;
  }
}

}  // namespace detail

}  // namespace iim
