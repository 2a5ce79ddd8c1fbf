// Small symmetric positive definite matrices: the inverse of M̄_R (17), and whether it exists.
#pragma once

#include <iim/scalar.hpp>

#include <Eigen/Core>

#include <cmath>
#include <limits>

namespace iim::detail {

/// Inverts D (n × n, lower triangle read) as D⁻¹ = C Cᵀ with C upper triangular.
///
/// `scale` (n): what D's diagonal would be without the cancellations that led to it (roundings.hpp). M⁻¹ is wrong by up to
/// 40 ε · scale / pivot (loaded arms in float; 160 once in a thousand states), so that a pivot below 192 ε of it counts as
/// zero. Returns whether all pivots are positive; if not, C and D_inv are not to be used.
template <class Scalar, int n>
bool invert_spd(const Eigen::Matrix<Scalar, n, n>& D, const Eigen::Matrix<Scalar, n, 1>& scale,
                Eigen::Matrix<Scalar, n, n>& C, Eigen::Matrix<Scalar, n, n>& D_inv)
{
  using std::sqrt;
  const Scalar tolerance = Scalar(192) * Eigen::NumTraits<Scalar>::epsilon();
  if constexpr (n == 1) {
    const bool positive = ScalarTraits<Scalar>::is_positive(D(0, 0) - tolerance * scale(0));
    D_inv(0, 0) = Scalar(1) / D(0, 0);
    C(0, 0) = sqrt(D_inv(0, 0));
    return positive;
  } else {
    // D = L Lᵀ, L⁻¹ built beside it row by row; C = L⁻ᵀ.
    bool positive = true;
    Eigen::Matrix<Scalar, n, n> L;
    C.setZero();
#pragma GCC unroll 8
    for (int i = 0; i < n; ++i) {
#pragma GCC unroll 8
      for (int j = 0; j < i; ++j) {
        Scalar sum = D(i, j);
#pragma GCC unroll 8
        for (int k = 0; k < j; ++k) { sum -= L(i, k) * L(j, k); }
        L(i, j) = sum * C(j, j);
      }
      Scalar pivot = D(i, i);
#pragma GCC unroll 8
      for (int k = 0; k < i; ++k) { pivot -= L(i, k) * L(i, k); }
      positive &= ScalarTraits<Scalar>::is_positive(pivot - tolerance * scale(i));
      C(i, i) = Scalar(1) / sqrt(pivot);
#pragma GCC unroll 8
      for (int j = 0; j < i; ++j) {
        Scalar sum = Scalar(0);
#pragma GCC unroll 8
        for (int k = j; k < i; ++k) { sum += L(i, k) * C(j, k); }
        C(j, i) = -sum * C(i, i);
      }
    }
#pragma GCC unroll 8
    for (int j = 0; j < n; ++j) {
#pragma GCC unroll 8
      for (int i = 0; i <= j; ++i) {
        Scalar sum = C(i, j) * C(j, j);
#pragma GCC unroll 8
        for (int k = j + 1; k < n; ++k) { sum += C(i, k) * C(j, k); }
        D_inv(i, j) = D_inv(j, i) = sum;
      }
    }
    return positive;
  }
}

}  // namespace iim::detail
