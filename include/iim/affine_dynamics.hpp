// q̈ = q̈₀ + B̂ u (2): what every input-Jacobian method returns.
#pragma once

#include <iim/errors.hpp>
#include <iim/receipt.hpp>
#include <iim/scalar.hpp>
#include <iim/spatial.hpp>

#include <algorithm>
#include <cassert>
#include <concepts>
#include <cstdint>
#include <type_traits>

namespace iim {

namespace detail {

/// From a column of B̂ to the next: built-in numbers begin at a register's boundary. Stores across two lines of the
/// cache take longer: of what comes after the O(n) pass 18 % for a tree of 63 links, 7 % for a chain, 6 % for the
/// biped. Whole pages apart 15 % for a chain of 512, 36 % for one of 1020.
template <class Scalar>
Index column_stride(Index n_v)
{
  if constexpr (std::is_floating_point_v<Scalar>) {
    constexpr Index side = std::max<Index>(1, EIGEN_MAX_STATIC_ALIGN_BYTES / Index(sizeof(Scalar)));
    constexpr Index page = 4096 / sizeof(Scalar);  // whole pages apart, columns displace each other in the cache
    const Index stride = (n_v + side - 1) / side * side;
    return stride % page == 0 && stride > 0 ? stride + side : stride;
  }
  return n_v;
}

}  // namespace detail

/// q̈ = qdd0 + Bhat·u at one state. Refers to memory of the method that made it; good until its next use.
/// If status is not ok, qdd0 and Bhat hold NaN.
template <class Scalar>
struct [[nodiscard]] AffineDynamics {
  Eigen::Map<const VectorX<Scalar>> qdd0;  ///< n_v [rad/s², m/s²]
  /// n_v × m, columns in the order of the active inputs; in memory Bhat.outerStride() ≥ n_v numbers apart.
  Eigen::Map<const MatrixX<Scalar>, 0, Eigen::OuterStride<>> Bhat;
  Status status;
  Index subsystem;  ///< that status is about; −1: none

  bool ok() const { return status == Status::ok; }
};

/// The same with the receipt of the pass, for what else is computed from it (`Tasks`).
template <class Workspace>
struct [[nodiscard]] StateDynamics : AffineDynamics<typename Workspace::Scalar> {
  ForwardDynamics<Workspace> fd;
};

/// What methods have in common: made from a tree and its inputs, applied to a receipt of the O(n) pass (all but
/// UnitForcePublished, which goes through the state again).
template <class Method, class Receipt>
concept InputJacobianMethod = requires(Method method, const Receipt& receipt) {
  { method(receipt) } -> std::same_as<AffineDynamics<typename Receipt::Scalar>>;
};

namespace detail {

/// Memory of a result, sized once.
template <class Scalar>
class ResultMemory {
public:
  /// Throws ModelError if the inputs are those of another tree.
  template <class Tree, class Inputs>
  ResultMemory(const Tree& tree, const Inputs& inputs)
      : inputs_id_(inputs.id()), stride_(column_stride<Scalar>(tree.n_v())), max_columns_(inputs.max_columns_on(tree)),
        qdd0_(tree.n_v()), Bhat_(stride_ * max_columns_)
  {
    Bhat_.setZero();  // what stands between columns stays so, for methods that work on whole registers
  }

  /// B̂ as n_v × columns, to be filled.
  Eigen::Map<MatrixX<Scalar>, 0, Eigen::OuterStride<>> Bhat(Index columns)
  {
    return {Bhat_.data(), qdd0_.size(), columns, Eigen::OuterStride<>(stride_)};
  }
  VectorX<Scalar>& qdd0() { return qdd0_; }

  /// `status`, or Status::mismatch if these are other inputs than the method was made for.
  template <class Inputs>
  Status status_on(const Inputs& inputs, Status status) const
  {
    const bool same = inputs.id() == inputs_id_;
    assert(same && "inputs were added, or others assigned, after the method was made");
    return same ? status : Status::mismatch;
  }

  AffineDynamics<Scalar> result(Index columns, Status status, Index subsystem)
  {
    if (status != Status::ok) {
      columns = std::min(columns, max_columns_);  // what a mismatch leaves
      qdd0_.setConstant(not_a_number<Scalar>());
      Bhat(columns).setConstant(not_a_number<Scalar>());
    }
    return {{qdd0_.data(), qdd0_.size()},
            {Bhat_.data(), qdd0_.size(), columns, Eigen::OuterStride<>(stride_)},
            status,
            status == Status::mismatch ? -1 : subsystem};  // the receipt's would be of something else
  }

private:
  std::uint64_t inputs_id_;
  Index stride_;
  Index max_columns_;
  VectorX<Scalar> qdd0_;
  VectorX<Scalar> Bhat_;
};

}  // namespace detail
}  // namespace iim
