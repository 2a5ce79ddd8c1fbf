// Fifty digits for the reference, and differences from it.
#pragma once

#include "dense.hpp"

#include <boost/multiprecision/cpp_bin_float.hpp>
#include <boost/multiprecision/eigen.hpp>

namespace iim::reference {

using Digits50 = boost::multiprecision::number<boost::multiprecision::cpp_bin_float<50>, boost::multiprecision::et_off>;

/// ‖a − b‖ / ‖b‖; ‖a‖ where b is zero.
inline double apart(const Dense<Digits50>& a, const Dense<Digits50>& b)
{
  const Digits50 norm = b.norm();
  const Digits50 difference = (a - b).norm();
  return static_cast<double>(norm > 0 ? Digits50(difference / norm) : difference);
}

}  // namespace iim::reference
