// The exception of set-up, the statuses of the cycle, and how values are written into messages.
#pragma once

#include <iim/scalar.hpp>

#include <Eigen/Core>

#include <initializer_list>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>

namespace iim {

/// Thrown while a tree, its inputs or a file are being put together; the message names the item and the value.
/// Nothing throws in the cycle.
class ModelError : public std::invalid_argument {
public:
  using std::invalid_argument::invalid_argument;
};

/// How a computation in the cycle ended.
enum class Status {
  ok,
  invalid_state,          ///< q, q̇ or u not finite, an implicit step's length negative or not finite, a quaternion
                          ///< far from unit length, a linkage that cannot close or is at a dead centre; `subsystem`
                          ///< says whose, if one's
  not_positive_definite,  ///< M̄_R of the named subsystem is not positive definite in the Scalar's precision
  not_finite,             ///< overflow: the state was finite, a result is not
  /// What does not belong together, asserted where assertions are on: an argument's size; a receipt of another robot or
  /// Scene than the method's, or from before the workspace's last use; inputs added after the method was made.
  mismatch
};

/// The status in words.
inline const char* to_string(Status status)
{
  switch (status) {
    case Status::ok: return "ok";
    case Status::invalid_state: return "invalid state";
    case Status::not_positive_definite: return "not positive definite";
    case Status::not_finite: return "not finite";
    case Status::mismatch: return "mismatch of arguments";
  }
  return "unknown";
}

namespace detail {

/// Throws a ModelError with the parts of its text one behind the other. (With sums of strings a controller had 2 % more
/// code to compile.)
[[noreturn, gnu::cold]] inline void refuse(std::initializer_list<std::string_view> parts)
{
  std::string text;
  for (const std::string_view part : parts) { text += part; }
  throw ModelError(text);
}

template <class Scalar>
  requires(!std::is_base_of_v<Eigen::DenseBase<Scalar>, Scalar>)
[[gnu::cold]] std::string to_text(const Scalar& x)
{
  std::ostringstream text;
  if constexpr (requires { text << x; }) {
    text << x;
  } else {
    text << "(a value that cannot be printed)";
  }
  return text.str();
}

/// Entry (i, j) at m[i·row + j·column].
template <class Scalar>
[[gnu::cold]] std::string to_text(const Scalar* m, Eigen::Index rows, Eigen::Index columns, Eigen::Index row,
                                  Eigen::Index column)
{
  std::string text = "(";
  for (Eigen::Index i = 0; i < rows; ++i) {
    if (i > 0) { text += columns > 1 ? "; " : ", "; }
    for (Eigen::Index j = 0; j < columns; ++j) {
      if (j > 0) { text += ", "; }
      text += to_text(m[i * row + j * column]);
    }
  }
  return text + ")";
}

template <class Derived>
std::string to_text(const Eigen::DenseBase<Derived>& m)
{
  const auto& plain = m.derived().eval();
  return to_text(plain.data(), plain.rows(), plain.cols(), plain.rowStride(), plain.colStride());
}

template <class Scalar>
double to_double(const Scalar& x)
{
  if constexpr (requires { static_cast<double>(x); }) {
    return static_cast<double>(x);
  } else {
    return to_double(x.value());  // automatic differentiation
  }
}

}  // namespace detail
}  // namespace iim
