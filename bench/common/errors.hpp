// Error of a computed q̈₀ and B̂ against a reference with more digits than any scalar under test.
#pragma once

#include <Eigen/Core>

#include <cmath>
#include <limits>

namespace bench {

/// A matrix to twice the digits of double: the unevaluated sum of two doubles.
struct Precise {
  Eigen::MatrixXd high;
  Eigen::MatrixXd low;

  Precise() = default;

  template <class Derived>
  explicit Precise(const Eigen::MatrixBase<Derived>& x) : high(x.template cast<double>())
  {
    low = (x - high.cast<typename Derived::Scalar>()).template cast<double>();
  }

  Precise right_columns(Eigen::Index count) const
  {
    Precise part;
    part.high = high.rightCols(count);
    part.low = low.rightCols(count);
    return part;
  }
};

/// q̈₀ and B̂ of one state.
struct Reference {
  Precise qdd0;
  Precise Bhat;
};

/// ‖x − reference‖ / ‖reference‖ in the Frobenius norm; infinite if x is not finite.
template <class Derived>
double relative_error(const Eigen::MatrixBase<Derived>& x, const Precise& reference)
{
  long double difference2 = 0;
  long double size2 = 0;
  for (Eigen::Index j = 0; j < x.cols(); ++j) {
    for (Eigen::Index i = 0; i < x.rows(); ++i) {
      const long double high = reference.high(i, j);
      const long double d = (static_cast<long double>(x.derived().coeff(i, j)) - high) - reference.low(i, j);
      difference2 += d * d;
      size2 += high * high;
    }
  }
  const auto error2 = static_cast<double>(difference2 / size2);
  return error2 >= 0 ? std::sqrt(error2) : std::numeric_limits<double>::infinity();
}

}  // namespace bench
