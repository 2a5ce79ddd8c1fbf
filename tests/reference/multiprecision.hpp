// Fifty digits for the reference, and conversions from and to double.
#pragma once

#include <iim/spatial.hpp>

#include <boost/multiprecision/cpp_bin_float.hpp>
#include <boost/multiprecision/eigen.hpp>

namespace iim::reference {

using Digits50 = boost::multiprecision::number<boost::multiprecision::cpp_bin_float<50>, boost::multiprecision::et_off>;

/// ‖a − b‖ / ‖b‖ with b in 50 digits; the absolute ‖a‖ where b is zero.
template <class A>
double relative_error(const A& a, const MatrixX<Digits50>& b)
{
  const MatrixX<Digits50> difference = a.template cast<Digits50>() - b;
  const Digits50 norm = b.norm();
  return static_cast<double>(norm > 0 ? Digits50(difference.norm() / norm) : Digits50(difference.norm()));
}

}  // namespace iim::reference
