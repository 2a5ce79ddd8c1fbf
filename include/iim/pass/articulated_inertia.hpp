// One subsystem's share of the articulated inertia: U = A S, D = Sᵀ A S, and A' = A − U W (14), (16), (17).
//
// All loops have constant bounds and stand for themselves: see spatial.hpp on why these are not Eigen expressions.
// Parts of S that the subsystem's MotionPattern declares zero are left out.
#pragma once

#include <iim/body.hpp>
#include <iim/node_state.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>

#include <array>
#include <cstddef>

namespace iim::detail {

/// U, W: a column of six numbers (of Wᵀ) for each velocity.
template <class Scalar, int n>
struct SixColumns {
  std::array<TriplePair<Scalar>, static_cast<std::size_t>(n)> column;

  [[gnu::always_inline]] TriplePair<Scalar>& operator[](int d) { return column[static_cast<std::size_t>(d)]; }
  [[gnu::always_inline]] const TriplePair<Scalar>& operator[](int d) const
  {
    return column[static_cast<std::size_t>(d)];
  }
  [[gnu::always_inline]] decltype(auto) operator()(int i, int d) const { return (*this)[d](i); }
};

/// Rows 0 … 2 or 3 … 5 of a column.
template <int first, class Scalar, int n>
struct ColumnPart {
  const Eigen::Matrix<Scalar, 6, n>& S;
  int d;
  [[gnu::always_inline]] const Scalar& operator()(int i) const { return S(first + i, d); }
};

/// U = A S.
template <MotionPattern pattern, class Scalar, int n>
[[gnu::always_inline]] inline void inertia_times(const SpatialInertia<Scalar>& A, const Eigen::Matrix<Scalar, 6, n>& S,
                                                 SixColumns<Scalar, n>& U)
{
#pragma GCC unroll 8
  for (int d = 0; d < n; ++d) {
    TriplePair<Scalar>& u = U[d];
    if constexpr (pattern.angular) {
      u = A.of_angular(ColumnPart<3, Scalar, n>{S, d});
      if constexpr (pattern.linear) { u += A.of_linear(ColumnPart<0, Scalar, n>{S, d}); }
    } else {
      u = A.of_linear(ColumnPart<0, Scalar, n>{S, d});
    }
  }
}

/// Column d of S times a six-vector.
template <MotionPattern pattern, class Scalar, int n>
[[gnu::always_inline]] inline Scalar column_dot(const Eigen::Matrix<Scalar, 6, n>& S, int d, const Scalar& x0,
                                                const Scalar& x1, const Scalar& x2, const Scalar& x3, const Scalar& x4,
                                                const Scalar& x5)
{
  if constexpr (pattern.linear && pattern.angular) {
    return Scalar((S(0, d) * x0 + S(1, d) * x1 + S(2, d) * x2) + (S(3, d) * x3 + S(4, d) * x4 + S(5, d) * x5));
  } else if constexpr (pattern.angular) {
    return Scalar(S(3, d) * x3 + S(4, d) * x4 + S(5, d) * x5);
  } else {
    return Scalar(S(0, d) * x0 + S(1, d) * x1 + S(2, d) * x2);
  }
}

template <MotionPattern pattern, class Scalar, int n>
[[gnu::always_inline]] inline Scalar column_dot(const Eigen::Matrix<Scalar, 6, n>& S, int d, const Vector6<Scalar>& x)
{
  return column_dot<pattern>(S, d, x(0), x(1), x(2), x(3), x(4), x(5));
}

template <MotionPattern pattern, class Scalar, int n>
[[gnu::always_inline]] inline Scalar column_dot(const Eigen::Matrix<Scalar, 6, n>& S, int d,
                                                const TriplePair<Scalar>& x)
{
  const Scalar* column = S.data() + 6 * d;
  using Part = Triple<Scalar>;
  if constexpr (pattern.linear && pattern.angular) {
    return dot(Part::settled(column), x.linear) + dot(Part::settled(column + 3), x.angular);
  } else if constexpr (pattern.angular) {
    return dot(Part::settled(column + 3), x.angular);
  } else {
    return dot(Part::settled(column), x.linear);
  }
}

/// D += Sᵀ U, or D = Sᵀ U: a sum with zero would stand between a chain's links.
template <MotionPattern pattern, class Scalar, int n>
[[gnu::always_inline]] inline void add_joint_inertia(const Eigen::Matrix<Scalar, 6, n>& S,
                                                     const SixColumns<Scalar, n>& U, bool first,
                                                     Eigen::Matrix<Scalar, n, n>& D)
{
#pragma GCC unroll 8
  for (int e = 0; e < n; ++e) {
#pragma GCC unroll 8
    for (int d = e; d < n; ++d) {
      const Scalar part = column_dot<pattern>(S, d, U[e]);
      D(d, e) = first ? part : Scalar(D(d, e) + part);
      if (d != e) { D(e, d) = D(d, e); }
    }
  }
}

/// Pᵀ A P with P = 1 − S W, U = A S: what is left of A when the coordinates of S are free.
///
/// A − U W itself changes to first order when roundings move W; the congruence does not, it is stationary in W. It is
/// formed from both sides, B = A P and then B − Wᵀ (Sᵀ B), a column of each half after the other, so that few numbers
/// wait in registers (with lanes 6 % of the inward loop).
template <MotionPattern pattern, class Scalar, int n>
[[gnu::always_inline]] inline SpatialInertia<Scalar> projected(const SpatialInertia<Scalar>& A,
                                                               const Eigen::Matrix<Scalar, 6, n>& S,
                                                               const SixColumns<Scalar, n>& U,
                                                               const SixColumns<Scalar, n>& W)
{
  if constexpr (!pattern.linear && !pattern.angular) { return A; }
  // Of B only what Sᵀ B or the result needs; H' from the half that Sᵀ B needs in any case.
  constexpr bool lower = !pattern.linear;
  const auto from_right = [&](const Scalar& a, int row, int column) __attribute__((always_inline)) {
    Scalar b = a - U(row, 0) * W(column, 0);
#pragma GCC unroll 8
    for (int d = 1; d < n; ++d) { b -= U(row, d) * W(column, d); }
    return b;
  };
  const auto from_left = [&](Scalar b, int row, const Eigen::Matrix<Scalar, n, 1>& SB) __attribute__((always_inline)) {
#pragma GCC unroll 8
    for (int d = 0; d < n; ++d) { b -= W(row, d) * SB(d); }
    return b;
  };
  SpatialInertia<Scalar> result;
#pragma GCC unroll 8
  for (int j = 0; j < 3; ++j) {
    Vector3<Scalar> M, G, H, J;  // columns j and j + 3 of B, [ M H ; G J ]
#pragma GCC unroll 8
    for (int i = 0; i < 3; ++i) {
      if (pattern.linear || i <= j) { M(i) = from_right(A.M(i, j), i, j); }
      if constexpr (pattern.angular) { G(i) = from_right(A.H(j, i), i + 3, j); }
      if constexpr (pattern.linear) { H(i) = from_right(A.H(i, j), i, j + 3); }
      if (pattern.angular || i <= j) { J(i) = from_right(A.J(i, j), i + 3, j + 3); }
    }
    Eigen::Matrix<Scalar, n, 1> v, w;
#pragma GCC unroll 8
    for (int d = 0; d < n; ++d) {
      v(d) = column_dot<pattern>(S, d, M(0), M(1), M(2), G(0), G(1), G(2));
      w(d) = column_dot<pattern>(S, d, H(0), H(1), H(2), J(0), J(1), J(2));
    }
#pragma GCC unroll 8
    for (int i = 0; i < 3; ++i) {
      if (i <= j) {
        result.M(i, j) = from_left(M(i), i, v);
        result.J(i, j) = from_left(J(i), i + 3, w);
      }
      if constexpr (lower) {
        result.H(j, i) = from_left(G(i), i + 3, v);
      } else {
        result.H(i, j) = from_left(H(i), i, w);
      }
    }
  }
  return result;
}

/// The same by columns. [ M G' ; H J ]: the columns of H are the rows of the lower half, which Sᵀ B needs and which a
/// joint that turns leaves zero along its axis.
template <MotionPattern pattern, class Scalar, int n>
  requires three_in_register<Scalar>
[[gnu::always_inline]] inline SpatialInertia<Scalar> projected(const SpatialInertia<Scalar>& A,
                                                               const Eigen::Matrix<Scalar, 6, n>& S,
                                                               const SixColumns<Scalar, n>& U,
                                                               const SixColumns<Scalar, n>& W)
{
  if constexpr (!pattern.linear && !pattern.angular) { return A; }
  SpatialInertia<Scalar> B = A;
  [[maybe_unused]] ColumnBlock<Scalar> G;  // rows of the upper right block
  if constexpr (pattern.linear) { G = A.H.transposed(); }
#pragma GCC unroll 8
  for (int d = 0; d < n; ++d) {
    B.M.subtract_dyad(W[d].linear, U[d].linear);
    B.H.subtract_dyad(W[d].linear, U[d].angular);
    B.J.subtract_dyad(W[d].angular, U[d].angular);
    if constexpr (pattern.linear) { G.subtract_dyad(W[d].angular, U[d].linear); }
  }
  SixColumns<Scalar, n> t;  // (Sᵀ B)ᵀ
#pragma GCC unroll 8
  for (int d = 0; d < n; ++d) {
    if constexpr (pattern.angular) {
      t[d] = {B.H.times(S(3, d), S(4, d), S(5, d)), B.J.times(S(3, d), S(4, d), S(5, d))};
      if constexpr (pattern.linear) {
        t[d] += {B.M.times(S(0, d), S(1, d), S(2, d)), G.times(S(0, d), S(1, d), S(2, d))};
      }
    } else {
      t[d] = {B.M.times(S(0, d), S(1, d), S(2, d)), G.times(S(0, d), S(1, d), S(2, d))};
    }
  }
#pragma GCC unroll 8
  for (int d = 0; d < n; ++d) {
    B.M.subtract_dyad(t[d].linear, W[d].linear);
    B.J.subtract_dyad(t[d].angular, W[d].angular);
    if constexpr (pattern.angular) {
      B.H.subtract_dyad(t[d].linear, W[d].angular);
    } else {
      G.subtract_dyad(t[d].angular, W[d].linear);
    }
  }
  if constexpr (!pattern.angular) { B.H = G.transposed(); }
  return B;
}

/// A −= U W, upper half: the update as (14) and (16) print it.
template <class Scalar, int n>
[[gnu::always_inline]] inline void subtract_product(const SixColumns<Scalar, n>& U, const SixColumns<Scalar, n>& W,
                                                    SpatialInertia<Scalar>& A)
{
#pragma GCC unroll 8
  for (int d = 0; d < n; ++d) {
#pragma GCC unroll 8
    for (int j = 0; j < 3; ++j) {
#pragma GCC unroll 8
      for (int i = 0; i <= j; ++i) {
        A.M(i, j) -= U(i, d) * W(j, d);
        A.J(i, j) -= U(i + 3, d) * W(j + 3, d);
      }
#pragma GCC unroll 8
      for (int i = 0; i < 3; ++i) { A.H(i, j) -= U(i, d) * W(j + 3, d); }
    }
  }
}

template <class Scalar, int n>
  requires three_in_register<Scalar>
[[gnu::always_inline]] inline void subtract_product(const SixColumns<Scalar, n>& U, const SixColumns<Scalar, n>& W,
                                                    SpatialInertia<Scalar>& A)
{
#pragma GCC unroll 8
  for (int d = 0; d < n; ++d) {
    A.M.subtract_dyad(U[d].linear, W[d].linear);
    A.H.subtract_dyad(U[d].linear, W[d].angular);
    A.J.subtract_dyad(U[d].angular, W[d].angular);
  }
}

/// A += weight z zᵀ.
template <class Scalar>
[[gnu::always_inline]] inline void add_square(const Scalar& weight, const TriplePair<Scalar>& z,
                                              SpatialInertia<Scalar>& A)
{
#pragma GCC unroll 8
  for (int j = 0; j < 3; ++j) {
    const Scalar v = weight * z(j);
    const Scalar w = weight * z(j + 3);
#pragma GCC unroll 8
    for (int i = 0; i <= j; ++i) {
      A.M(i, j) += z(i) * v;
      A.J(i, j) += z(i + 3) * w;
    }
#pragma GCC unroll 8
    for (int i = 0; i < 3; ++i) { A.H(i, j) += z(i) * w; }
  }
}

template <class Scalar>
  requires three_in_register<Scalar>
[[gnu::always_inline]] inline void add_square(const Scalar& weight, const TriplePair<Scalar>& z,
                                              SpatialInertia<Scalar>& A)
{
  const TriplePair<Scalar> weighted{z.linear * weight, z.angular * weight};
  A.M.add_dyad(weighted.linear, z.linear);
  A.H.add_dyad(weighted.linear, z.angular);
  A.J.add_dyad(weighted.angular, z.angular);
}

/// Newton–Euler (A1), (A2) of the bodies on one frame, in world axes about the coupling point: inertia A, and with
/// `velocity` the part of h that ω makes. r: frame's origin from the coupling point; zero unless `offset`. R was
/// written some time ago.
template <bool offset, bool velocity, class Scalar>
[[gnu::always_inline]] inline void place_bodies(const FrameMass<Scalar>& body, const Matrix3<Scalar>& R,
                                                const Triple<Scalar>& r, const Triple<Scalar>& omega,
                                                SpatialInertia<Scalar>& A, TriplePair<Scalar>& h)
{
  const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
  h = {zero, zero};
  if (!body.present) {
    A.set_zero();
    return;
  }
  Triple<Scalar> mc = combined(settled_columns(R), body.first_moment);
  auto Theta = SpatialInertia<Scalar>::Rotational::turned(R, body.inertia);
  if constexpr (offset) {
    // From the frame's origin to the coupling point: with s = mc + ½ m r, Θ + 2 (r·s) 1 − r sᵀ − s rᵀ
    const Triple<Scalar> step = r * body.mass;
    Theta.add_offset(r, mc + step * Scalar(0.5));
    mc += step;
  }
  A.set_rigid(body.mass, mc, Theta);
  if constexpr (velocity) { h = {cross(omega, cross(omega, mc)), cross(omega, Theta * omega)}; }
}

}  // namespace iim::detail
