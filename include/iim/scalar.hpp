// What the library asks of a Scalar beyond arithmetic and Eigen::NumTraits, and where to say it for a new one.
//
// abs, sqrt, sin, cos are found by argument-dependent lookup (subsystems may need more). It is made from a double, also
// from NaN, which is what results hold after a failure; for messages it converts to double or has value(). Decisions in
// the cycle are reduced to two questions, so that a Scalar with several lanes can answer for all of them.
#pragma once

#include <iim/numerics/sine_cosine.hpp>

#include <Eigen/Core>

#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>

namespace iim {

/// Answers about a Scalar; specialise it for a type whose comparison does not give a bool.
template <class Scalar>
struct ScalarTraits {
  /// x > 0; false for NaN.
  static bool is_positive(const Scalar& x) { return x > Scalar(0); }

  static bool is_finite(const Scalar& x)
  {
    using std::isfinite;
    if constexpr (requires { isfinite(x); }) {
      return static_cast<bool>(isfinite(x));
    } else {
      return x - x == Scalar(0);
    }
  }
};

/// The exponent's bits: an answer that -ffast-math cannot optimise away.
template <>
struct ScalarTraits<double> {
  static bool is_positive(double x)
  {
    const auto bits = std::bit_cast<std::uint64_t>(x);
    return bits - 1 < 0x7ff0000000000000u;
  }
  static bool is_finite(double x)
  {
    return (std::bit_cast<std::uint64_t>(x) & 0x7ff0000000000000u) != 0x7ff0000000000000u;
  }
};

template <>
struct ScalarTraits<float> {
  static bool is_positive(float x)
  {
    const auto bits = std::bit_cast<std::uint32_t>(x);
    return bits - 1 < 0x7f800000u;
  }
  static bool is_finite(float x) { return (std::bit_cast<std::uint32_t>(x) & 0x7f800000u) != 0x7f800000u; }
};

namespace detail {

/// NaN, also of a Scalar for which std::numeric_limits, not specialised, says 0.
template <class Scalar>
Scalar not_a_number()
{
  if constexpr (std::numeric_limits<Scalar>::has_quiet_NaN) {
    return std::numeric_limits<Scalar>::quiet_NaN();
  } else {
    return Scalar(std::numeric_limits<double>::quiet_NaN());
  }
}

template <class Scalar>
bool is_finite(const Scalar& x)
{
  return ScalarTraits<Scalar>::is_finite(x);
}

/// Whether `size` numbers in a row are finite. An exponent of all ones carries into the sign's place when one is added
/// to it; one loop of and, add, or, that compilers turn into vector instructions.
inline bool all_finite(const double* x, Eigen::Index size)
{
  std::uint64_t carried = 0;
  for (Eigen::Index k = 0; k < size; ++k) {
    carried |= (std::bit_cast<std::uint64_t>(x[k]) & 0x7ff0000000000000u) + 0x0010000000000000u;
  }
  return carried >> 63 == 0;
}
inline bool all_finite(const float* x, Eigen::Index size)
{
  std::uint32_t carried = 0;
  for (Eigen::Index k = 0; k < size; ++k) {
    carried |= (std::bit_cast<std::uint32_t>(x[k]) & 0x7f800000u) + 0x00800000u;
  }
  return carried >> 31 == 0;
}

template <class Derived>
bool all_finite(const Eigen::DenseBase<Derived>& m)
{
  if constexpr (requires { all_finite(m.derived().data(), m.size()); }) {
    if (m.derived().innerStride() == 1 && (m.cols() == 1 || m.derived().outerStride() == m.rows())) {
      return all_finite(m.derived().data(), m.size());
    }
    if (m.derived().innerStride() == 1 && !Derived::IsRowMajor) {
      const Eigen::Index stride = m.derived().outerStride();
      bool finite = true;
      for (Eigen::Index j = 0; j < m.cols(); ++j) { finite &= all_finite(m.derived().data() + j * stride, m.rows()); }
      return finite;
    }
  }
  bool finite = true;
  for (Eigen::Index j = 0; j < m.cols(); ++j) {
    for (Eigen::Index i = 0; i < m.rows(); ++i) {
      finite &= ScalarTraits<typename Derived::Scalar>::is_finite(m.derived().coeff(i, j));
    }
  }
  return finite;
}

/// The larger of two, a if b is NaN.
template <class Scalar>
Scalar larger(const Scalar& a, const Scalar& b)
{
  return ScalarTraits<Scalar>::is_positive(b - a) ? b : a;
}

/// Whether it is several states at once, one per lane (numerics/lanes.hpp).
///
/// Then a frame's own bodies come to its inertia before what hangs on it, which is in memory in any case (7 % of
/// several states). Of one state they come last, in registers, at the frame's own step: they would wait there for it in
/// memory, and with what has come apart from them, what they are to their own joint is a constant (OwnColumn). Pass of
/// a tree of 63: 7 % less.
template <class Scalar>
inline constexpr bool is_several = false;

/// Of several states at once: asks that they be computed one by one, which does what these do not.
template <class Scalar>
struct OneByOne {
  static void ask() {}
  static bool is_asked() { return false; }
  static void withdraw() {}
};

}  // namespace detail
}  // namespace iim
