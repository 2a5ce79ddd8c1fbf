// q̈ = q̈₀ + B̂ u (2): what every input-Jacobian method returns.
#pragma once

#include <iim/errors.hpp>
#include <iim/spatial.hpp>

#include <concepts>
#include <limits>

namespace iim {

/// q̈ = qdd0 + Bhat·u at one state. Refers to memory of the method that made it; good until its next use.
/// If status is not ok, qdd0 and Bhat hold NaN.
template <class Scalar>
struct AffineDynamics {
  Eigen::Map<const VectorX<Scalar>> qdd0;  ///< n_v [rad/s², m/s²]
  Eigen::Map<const MatrixX<Scalar>> Bhat;  ///< n_v × m, columns in the order of the active inputs
  Status status;
  Index subsystem;  ///< that status is about; −1: none

  bool ok() const { return status == Status::ok; }
};

/// What all methods have in common: made from a tree and its inputs, applied to a receipt of the O(n) pass.
template <class Method, class Receipt>
concept InputJacobianMethod = requires(Method method, const Receipt& receipt) {
  { method(receipt) } -> std::same_as<AffineDynamics<typename Receipt::Scalar>>;
};

namespace detail {

/// Memory of a result, sized once.
template <class Scalar>
class ResultMemory {
public:
  ResultMemory(Index n_v, Index max_columns) : qdd0_(n_v), Bhat_(n_v * max_columns) {}

  /// B̂ as n_v × columns, to be filled.
  Eigen::Map<MatrixX<Scalar>> Bhat(Index columns) { return {Bhat_.data(), qdd0_.size(), columns}; }
  VectorX<Scalar>& qdd0() { return qdd0_; }

  AffineDynamics<Scalar> result(Index columns, Status status, Index subsystem)
  {
    if (status != Status::ok) {
      qdd0_.setConstant(std::numeric_limits<Scalar>::quiet_NaN());
      Bhat_.setConstant(std::numeric_limits<Scalar>::quiet_NaN());
    }
    return {{qdd0_.data(), qdd0_.size()}, {Bhat_.data(), qdd0_.size(), columns}, status, subsystem};
  }

private:
  VectorX<Scalar> qdd0_;
  VectorX<Scalar> Bhat_;
};

}  // namespace detail
}  // namespace iim
