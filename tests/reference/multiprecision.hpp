// Fifty digits for the reference, and differences from it.
#pragma once

#include "dense.hpp"

#include <boost/multiprecision/cpp_bin_float.hpp>
#include <boost/multiprecision/eigen.hpp>

#include <limits>

namespace iim::reference {

using Digits50 = boost::multiprecision::number<boost::multiprecision::cpp_bin_float<50>, boost::multiprecision::et_off>;

}  // namespace iim::reference

/// What Eigen asks of a Scalar since 3.4, and Boost does not yet say in 1.74 (infinity, NaN).
template <>
struct Eigen::NumTraits<iim::reference::Digits50> : Eigen::GenericNumTraits<iim::reference::Digits50> {
  using Limits = std::numeric_limits<iim::reference::Digits50>;
  enum { RequireInitialization = 1 };
  static iim::reference::Digits50 dummy_precision() { return 1000 * Limits::epsilon(); }
  static iim::reference::Digits50 infinity() { return Limits::infinity(); }
  static iim::reference::Digits50 quiet_NaN() { return Limits::quiet_NaN(); }
};

namespace iim::reference {

/// ‖a − b‖ / ‖b‖; ‖a‖ where b is zero.
inline double apart(const Dense<Digits50>& a, const Dense<Digits50>& b)
{
  const Digits50 norm = b.norm();
  const Digits50 difference = (a - b).norm();
  return static_cast<double>(norm > 0 ? Digits50(difference / norm) : difference);
}

}  // namespace iim::reference
