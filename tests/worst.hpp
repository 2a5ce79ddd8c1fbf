// The largest of many errors.
#pragma once

#include <limits>

namespace iim::test {

/// Infinite from the first error on that is not a number, which std::max would pass over.
template <class Real, class Error>
void keep_worst(Real& worst, const Error& error)
{
  if (!(error <= worst)) { worst = error == error ? Real(error) : std::numeric_limits<Real>::infinity(); }
}

}  // namespace iim::test
