// The unit force method, Sect. 3: B̂ column by column, as the acceleration that each unit input alone adds.
//
//     q̈_[i] = q̈_[0] + B̂ e_i                                                                              (21)
//
// As published, every column is a complete O(n) forward dynamics; on the workspace, only what the input changes.
#pragma once

#include <iim/affine_dynamics.hpp>
#include <iim/forward_dynamics.hpp>
#include <iim/inputs.hpp>
#include <iim/inversion/branches.hpp>
#include <iim/inversion/sweep.hpp>
#include <iim/workspace.hpp>

#include <concepts>
#include <type_traits>

namespace iim {

/// B̂ and q̈₀ by m+1 complete O(n) forward dynamics, (20) and (21). Overwrites a workspace of its own, so a receipt alone
/// is not enough: it is applied to (q, q̇). Update and Scene as in the O(n) pass that it is compared with.
///
/// The difference in (21) loses what q̈_[0] is larger than the column by: the error of B̂ is ε‖q̈_[0]‖, not ε‖B̂‖.
template <class Tree, Update update = Update::projected, Scene scene = Scene{}>
class UnitForcePublished {
public:
  using Scalar = typename Tree::Scalar;

  UnitForcePublished(const Tree& tree, const Inputs<Tree>& inputs)
      : inputs_(&inputs), workspace_(tree), unit_(inputs.max_columns_on(tree)), result_(tree, inputs)
  {
    unit_.setZero();
  }
  UnitForcePublished(const Tree&&, const Inputs<Tree>&) = delete;
  UnitForcePublished(const Tree&, const Inputs<Tree>&&) = delete;

  /// All m+1 passes. No allocation, no exception.
  template <class Q, class V>
  AffineDynamics<Scalar> operator()(const Eigen::MatrixBase<Q>& q, const Eigen::MatrixBase<V>& qd) &
  {
    static_assert(!scene.implicit, "of an implicit step, give the receipt too: it says how long the step is");
    return columns(forward_dynamics<scene>(q, qd, workspace_), q, qd);
  }

  /// The m passes that are left when q̈_[0] is known; fd is the receipt of the same state.
  template <class W, class Q, class V>
    requires std::same_as<typename W::Tree, Tree>
  AffineDynamics<Scalar> operator()(const ForwardDynamics<W>& fd, const Eigen::MatrixBase<Q>& q,
                                    const Eigen::MatrixBase<V>& qd) &
  {
    return columns(fd, q, qd);
  }

private:
  template <class W, class Q, class V>
  AffineDynamics<Scalar> columns(const ForwardDynamics<W>& fd, const Q& q, const V& qd)
  {
    const Index m = inputs_->columns();
    const Status status = result_.status_on(*inputs_, fd.status_on(inputs_->tree(), scene));
    if (status != Status::ok) { return result_.result(m, status, fd.subsystem()); }
    result_.qdd0() = fd.qdd0();
    auto Bhat = result_.Bhat(m);
    for (Index i = 0; i < m; ++i) {
      unit_(i) = Scalar(1);
      const auto with =
          detail::run_pass<scene>(q.derived(), qd.derived(), Scalar(fd.step()), *inputs_, unit_.head(m), workspace_);
      unit_(i) = Scalar(0);
      if (!with.ok()) { return result_.result(m, with.status, with.subsystem); }
      Bhat.col(i) = with.qdd - result_.qdd0();
    }
    return result_.result(m, Status::ok, -1);
  }

  const Inputs<Tree>* inputs_;
  Workspace<Tree, update> workspace_;
  VectorX<Scalar> unit_;
  detail::ResultMemory<Scalar> result_;
};

/// B̂ and q̈₀ by unit forces on the workspace of the O(n) pass: per input a bias pass along its path to the world and an
/// acceleration pass over the tree. O(n) per input; `width` inputs at a time, a power of two, 1: one unit force after the
/// other, 0: as many as pay. Owns its memory, O(n_v · width + n_v · m); refers to tree and inputs.
template <class Tree, int width = 0>
class UnitForce {
  static_assert(width >= 0 && (width & (width - 1)) == 0, "UnitForce: width is 0 or a power of two");

public:
  using Scalar = typename Tree::Scalar;

  UnitForce(const Tree& tree, const Inputs<Tree>& inputs)
      : inputs_(&inputs), sweep_(tree, inputs), result_(tree, inputs)
  {
  }
  UnitForce(const Tree&&, const Inputs<Tree>&) = delete;
  UnitForce(const Tree&, const Inputs<Tree>&&) = delete;

  /// For the inputs that are active now. No allocation, no exception.
  template <class W>
    requires std::same_as<typename W::Tree, Tree>
  AffineDynamics<Scalar> operator()(const ForwardDynamics<W>& fd) &
  {
    const Index m = inputs_->columns();
    const Status status = result_.status_on(*inputs_, fd.status_on(inputs_->tree()));
    if (status != Status::ok) { return result_.result(m, status, fd.subsystem()); }
    result_.qdd0() = fd.qdd0();
    auto Bhat = result_.Bhat(m);
    const bool finite = sweep_(fd.workspace(), Bhat) || detail::all_finite(Bhat);
    return result_.result(m, finite ? Status::ok : Status::not_finite, -1);
  }

private:
  const Inputs<Tree>* inputs_;
  std::conditional_t<width == 0, detail::Sweeps<Tree>, detail::Sweep<Tree, width>> sweep_;
  detail::ResultMemory<Scalar> result_;
};

/// Any method at one state: method(fd), or method(fd, q, q̇) for one that goes through the state again.
template <class Method, class W, class Q, class V>
auto affine_dynamics(Method& method, const ForwardDynamics<W>& fd, const Eigen::MatrixBase<Q>& q,
                     const Eigen::MatrixBase<V>& qd)
{
  if constexpr (InputJacobianMethod<Method, ForwardDynamics<W>>) {
    return method(fd);
  } else {
    return method(fd, q, qd);
  }
}

}  // namespace iim
