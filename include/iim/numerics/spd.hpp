// Small symmetric positive definite matrices: a root of their inverse, as of M̄_R (17), and whether it exists.
#pragma once

#include <iim/scalar.hpp>

#include <Eigen/Core>

#include <algorithm>
#include <cmath>

namespace iim::detail {

/// Of scale, below which a pivot may have too few digits: M⁻¹ is wrong by up to 40 ε · scale / pivot (loaded arms in
/// float; 160 once in a thousand states), and by how much is then looked at (second_look.hpp). Of several states at
/// once, what has them computed one by one: but for pivots that are `mended` (weak_pivot.hpp) already from 1/1024 on.
template <class Scalar>
Scalar pivot_tolerance(bool mended = false)
{
  return is_several<Scalar> && !mended ? Scalar(1.0 / 1024) : Scalar(8192) * Eigen::NumTraits<Scalar>::epsilon();
}

/// C, upper triangular, of D⁻¹ = C Cᵀ (D: n × n, lower triangle read).
///
/// `scale` (n): what D's diagonal would be without the cancellations that led to it (roundings.hpp). Returns whether no
/// pivot is below pivot_tolerance of it (or below zero, where scale itself is a rounding); if not, C may be NaN.
/// always: no pivot is less than its roundings, so that there is some C.
template <class Scalar, int n, bool always = false>
[[gnu::always_inline]] inline bool root_of_inverse(const Eigen::Matrix<Scalar, n, n>& D,
                                                   const Eigen::Matrix<Scalar, n, 1>& scale,
                                                   Eigen::Matrix<Scalar, n, n>& C)
{
  using std::max;
  using std::min;
  using std::sqrt;
  const Scalar tolerance = pivot_tolerance<Scalar>();
  // D = L diag(pivots) Lᵀ, L⁻¹ built beside it; C = L⁻ᵀ diag(1/√pivots). A pivot waits for a division alone, not for
  // the root too as in L Lᵀ (2 % of the biped's pass).
  bool positive = true;
  Eigen::Matrix<Scalar, n, n> left = D;
  // What is left of an error E, [−l 1] E [−l 1]ᵀ: small pivots make the roundings of later ones larger. (Of 2000 free
  // bases without mass, each with a limb, 39 had a pivot of roundings that passed for one.)
  Eigen::Matrix<Scalar, n, 1> rounding = scale;
#pragma GCC unroll 8
  for (int i = 0; i < n; ++i) {
#pragma GCC unroll 8
    for (int j = 0; j < n; ++j) { C(j, i) = Scalar(i == j ? 1 : 0); }
  }
#pragma GCC unroll 8
  for (int j = 0; j < n; ++j) {
    Scalar pivot = left(j, j);
    if constexpr (always) { pivot = max(pivot, Scalar(Eigen::NumTraits<Scalar>::epsilon() * scale(j))); }
    const Scalar inverse = Scalar(1) / pivot;
    positive &= ScalarTraits<Scalar>::is_positive(min(pivot, Scalar(pivot - tolerance * rounding(j))));
#pragma GCC unroll 8
    for (int i = j + 1; i < n; ++i) {
      const Scalar l = left(i, j) * inverse;
      rounding(i) += l * l * rounding(j);
#pragma GCC unroll 8
      for (int k = j + 1; k <= i; ++k) { left(i, k) -= l * left(k, j); }
#pragma GCC unroll 8
      for (int k = 0; k < j; ++k) { C(k, i) -= l * C(k, j); }
      C(j, i) = -l;
    }
    left(j, j) = sqrt(inverse);
  }
#pragma GCC unroll 8
  for (int j = 0; j < n; ++j) {
#pragma GCC unroll 8
    for (int i = 0; i < j; ++i) { C(i, j) *= left(j, j); }
    C(j, j) = left(j, j);
  }
  return positive;
}

/// C Cᵀ of an upper triangular C.
template <class Scalar, int n>
[[gnu::always_inline]] inline void square_of_root(const Eigen::Matrix<Scalar, n, n>& C,
                                                  Eigen::Matrix<Scalar, n, n>& D_inv)
{
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
}

/// Inverts D as D⁻¹ = C Cᵀ; otherwise as root_of_inverse.
template <class Scalar, int n>
[[gnu::always_inline]] inline bool invert_spd(const Eigen::Matrix<Scalar, n, n>& D,
                                              const Eigen::Matrix<Scalar, n, 1>& scale, Eigen::Matrix<Scalar, n, n>& C,
                                              Eigen::Matrix<Scalar, n, n>& D_inv, [[maybe_unused]] bool mended = false)
{
  using std::min;
  using std::sqrt;
  if constexpr (n == 1) {
    const Scalar tolerance = pivot_tolerance<Scalar>(mended);
    const bool positive = ScalarTraits<Scalar>::is_positive(min(D(0, 0), Scalar(D(0, 0) - tolerance * scale(0))));
    D_inv(0, 0) = Scalar(1) / D(0, 0);
    C(0, 0) = sqrt(D_inv(0, 0));
    return positive;
  } else {
    const bool positive = root_of_inverse(D, scale, C);
    square_of_root(C, D_inv);
    return positive;
  }
}

}  // namespace iim::detail
