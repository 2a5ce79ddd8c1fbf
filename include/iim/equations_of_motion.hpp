// M q̈ + h = B u (1) as dense matrices: for gravity compensation, inverse dynamics, or a solver that wants M itself.
#pragma once

#include <iim/errors.hpp>
#include <iim/forward_dynamics.hpp>
#include <iim/inputs.hpp>
#include <iim/inversion/branches.hpp>
#include <iim/mass_matrix/sparse_equations.hpp>
#include <iim/receipt.hpp>
#include <iim/scalar.hpp>
#include <iim/spatial.hpp>

#include <algorithm>
#include <cassert>
#include <concepts>
#include <cstdint>

namespace iim {

/// M q̈ + h = B u at one state. Refers to memory of the EquationsOfMotion that made it; good until its next use. If
/// status is not ok, all entries are NaN.
template <class Scalar>
struct [[nodiscard]] MotionEquations {
  Eigen::Map<const MatrixX<Scalar>> M;  ///< n_v × n_v, symmetric [kg, kg m, kg m²]
  Eigen::Map<const VectorX<Scalar>> h;  ///< n_v: velocity terms, weights, springs, dampers and friction [N m, N]
  Eigen::Map<const MatrixX<Scalar>> B;  ///< n_v × m, columns in the order of the active inputs
  Status status;
  Index subsystem;  ///< that status is about; −1: none

  bool ok() const { return status == Status::ok; }
};

/// M (11), h (12) and B (13) by composite inertias and recursive Newton–Euler, O(n_v · depth), spread out to dense
/// matrices, O(n_v² + n_v · m). Refers to tree and inputs; construction allocates, nothing after it does. One per
/// thread.
///
/// Scene: that of the O(n) pass. Without velocity h is what holds the robot still: its weight and its springs; with
/// `implicit` M and h are those of the step, M + hC + h²K and its bias.
///
/// Of the O(n) pass it needs the kinematics only: equations(q, q̇, workspace) does without the rest.
template <class Tree, Scene scene = Scene{}>
class EquationsOfMotion {
public:
  using Scalar = typename Tree::Scalar;

  EquationsOfMotion(const Tree& tree, const Inputs<Tree>& inputs)
      : tree_(&tree), limbs_(tree), equations_(tree, inputs), inputs_id_(inputs.id()), M_(tree.n_v(), tree.n_v()),
        h_(tree.n_v()), B_(tree.n_v(), inputs.max_columns_on(tree))
  {
  }

  EquationsOfMotion(const Tree&&, const Inputs<Tree>&) = delete;
  EquationsOfMotion(const Tree&, const Inputs<Tree>&&) = delete;

  /// For the inputs that are active now. No allocation, no exception.
  template <class Workspace>
    requires std::same_as<typename Workspace::Tree, Tree>
  MotionEquations<Scalar> operator()(const ForwardDynamics<Workspace>& fd) &
  {
    return compute(fd.workspace(), fd.status_on(*tree_, scene), fd.subsystem());
  }

  /// The same without the O(n) pass; overwrites the workspace.
  template <class Q, class V, class Workspace>
    requires std::same_as<typename Workspace::Tree, Tree>
  MotionEquations<Scalar> operator()(const Eigen::MatrixBase<Q>& q, const Eigen::MatrixBase<V>& qd,
                                     Workspace& workspace) &
  {
    static_assert(!scene.implicit, "of an implicit step, give the receipt: it says how long the step is");
    const ForwardDynamics<Workspace> fd = detail::run_kinematics<scene>(q.derived(), qd.derived(), workspace);
    return compute(workspace, fd.status_on(*tree_), fd.subsystem());
  }

private:
  template <class Workspace>
  MotionEquations<Scalar> compute(const Workspace& ws, Status status, Index subsystem)
  {
    const auto& inputs = equations_.B().inputs();
    const bool same = inputs.id() == inputs_id_;
    assert(same && "inputs were added, or others assigned, after the EquationsOfMotion were made");
    if (!same) { status = Status::mismatch; }
    const Index m = std::min<Index>(inputs.columns(), B_.cols());
    if (status != Status::ok) { return failed(m, status, subsystem); }
    equations_.compute(ws);
    M_.setZero();
    equations_.put_upper(limbs_, M_);
    for (Index v = 0; v < tree_->n_v(); ++v) {
      for (Index w = 0; w < v; ++w) { M_(v, w) = M_(w, v); }
      h_(v) = equations_.h()(v);
    }
    B_.setZero();
    equations_.B().put(limbs_, B_);
    const bool finite = detail::all_finite(M_) && detail::all_finite(h_) && detail::all_finite(B_.leftCols(m));
    return finite ? result(m, Status::ok, -1) : failed(m, Status::not_finite, -1);
  }

  MotionEquations<Scalar> failed(Index m, Status status, Index subsystem)
  {
    const Scalar nan = detail::not_a_number<Scalar>();
    M_.setConstant(nan);
    h_.setConstant(nan);
    B_.setConstant(nan);
    return result(m, status, status == Status::mismatch ? -1 : subsystem);
  }
  MotionEquations<Scalar> result(Index m, Status status, Index subsystem) const
  {
    return {{M_.data(), M_.rows(), M_.cols()}, {h_.data(), h_.size()}, {B_.data(), B_.rows(), m}, status, subsystem};
  }

  const Tree* tree_;
  detail::Limbs limbs_;
  detail::SparseEquations<Tree, scene> equations_;
  std::uint64_t inputs_id_;
  MatrixX<Scalar> M_;
  VectorX<Scalar> h_;
  MatrixX<Scalar> B_;
};

template <class Tree>
EquationsOfMotion(const Tree&, const Inputs<Tree>&) -> EquationsOfMotion<Tree>;

}  // namespace iim
