// The global inverse, Sect. 2.2: M (11), h (12) and B (13) as matrices, a Cholesky factorisation, and
//
//     q̈₀ = −M⁻¹ h,   B̂ = M⁻¹ B                                                                              (2)
#pragma once

#include <iim/affine_dynamics.hpp>
#include <iim/forward_dynamics.hpp>
#include <iim/inputs.hpp>
#include <iim/inversion/branches.hpp>
#include <iim/mass_matrix/branch_cholesky.hpp>
#include <iim/mass_matrix/sparse_equations.hpp>
#include <iim/spatial.hpp>
#include <iim/workspace.hpp>

#include <algorithm>
#include <concepts>

namespace iim {

/// What the Cholesky factorisation knows of M.
enum class Factorization {
  dense,         ///< nothing: n³/6 multiply-adds on any tree
  branch_sparse  ///< that M is zero for velocities on different branches
};

/// B̂ and q̈₀ by composite inertias, recursive Newton–Euler and Cholesky. Owns its memory, O(n_v · depth + n_v · m),
/// dense O(n_v²); refers to tree and inputs. Scene: that of the O(n) pass.
///
/// Of the O(n) pass it needs the kinematics only: method(q, q̇, workspace) does without the rest.
template <class Tree, Factorization factorization = Factorization::branch_sparse, Scene scene = Scene{}>
class GlobalInverse {
public:
  using Scalar = typename Tree::Scalar;

  GlobalInverse(const Tree& tree, const Inputs<Tree>& inputs)
      : tree_(&tree), limbs_(tree), equations_(tree, inputs),
        cholesky_(factorization == Factorization::dense ? detail::Limbs::unbranched(tree.n_v()) : limbs_),
        X_(tree.n_v() * widest), result_(tree, inputs)
  {
    if constexpr (factorization == Factorization::dense) {
      dense_.resize(detail::padded<Scalar>(tree.n_v()), tree.n_v());
      dense_.setZero();
    }
    X_.setZero();
  }

  GlobalInverse(const Tree&&, const Inputs<Tree>&) = delete;
  GlobalInverse(const Tree&, const Inputs<Tree>&&) = delete;

  /// For the inputs that are active now. No allocation, no exception.
  template <class Workspace>
    requires std::same_as<typename Workspace::Tree, Tree>
  AffineDynamics<Scalar> operator()(const ForwardDynamics<Workspace>& fd) &
  {
    return compute(fd.workspace(), fd.status_on(*tree_, scene), fd.subsystem());
  }

  /// The same without the O(n) pass; overwrites the workspace.
  template <class Q, class V, class Workspace>
    requires std::same_as<typename Workspace::Tree, Tree>
  AffineDynamics<Scalar> operator()(const Eigen::MatrixBase<Q>& q, const Eigen::MatrixBase<V>& qd,
                                    Workspace& workspace) &
  {
    static_assert(!scene.implicit, "of an implicit step, give the receipt: it says how long the step is");
    const ForwardDynamics<Workspace> fd = detail::run_kinematics<scene>(q.derived(), qd.derived(), workspace);
    return compute(workspace, fd.status_on(*tree_), fd.subsystem());
  }

private:
  static constexpr int widest = detail::lane_count<Scalar>;

  template <class Workspace>
  AffineDynamics<Scalar> compute(const Workspace& ws, Status status, Index subsystem)
  {
    const detail::InputMatrix<Tree>& B = equations_.B();
    const Index m = B.inputs().columns();
    status = result_.status_on(B.inputs(), status);
    if (status != Status::ok) { return result_.result(m, status, subsystem); }
    equations_.compute(ws);
    if constexpr (factorization == Factorization::dense) {
      dense_.setZero();
      equations_.put_upper(limbs_, dense_);
    }
    const Index failed = cholesky_.factorise(matrix());
    if (failed >= 0) {
      const bool finite = detail::is_finite(matrix()(position(failed), failed));
      return result_.result(m, finite ? Status::not_positive_definite : Status::not_finite, owner(failed));
    }
    auto Bhat = result_.Bhat(m);
    Index done = 0;
    for (; done + widest <= m; done += widest) { solve_columns<widest>(done, done + widest, false, Bhat); }
    solve_rest<widest>(done, m, Bhat);
    const bool finite = detail::all_finite(Bhat) && detail::all_finite(result_.qdd0());
    return result_.result(m, finite ? Status::ok : Status::not_finite, -1);
  }

  /// The columns that do not fill a register, and −h with them.
  template <int width, class Matrix>
  void solve_rest(Index done, Index m, Matrix& Bhat)
  {
    if constexpr (width > 1) {
      if (m + 1 - done <= width / 2) { return solve_rest<width / 2>(done, m, Bhat); }
    }
    solve_columns<width>(done, m, true, Bhat);
  }

  /// Columns begin … end of B, sorted; with `bias` −h behind them.
  template <int width, class Matrix>
  void solve_columns(Index begin, Index end, bool bias, Matrix& Bhat)
  {
    const detail::InputMatrix<Tree>& B = equations_.B();
    const Index n = tree_->n_v();
    Scalar* X = X_.data();
    X_.head(n * width).setZero();
    cholesky_.begin_solve();
    for (Index j = begin; j < end; ++j) {
      const auto& column = B.column(j);
      const Scalar* entries = B.entries(j);
      Index last = -1;
      limbs_.for_each_run(limbs_.limb_of(column.subsystem), column.begin, column.end,
                          [&](Index a, Index v, Index count) {
                            for (Index k = 0; k < count; ++k) { X[(v + k) * width + (j - begin)] = entries[a + k]; }
                            last = std::max(last, v + count - 1);
                          });
      if (last >= 0) { cholesky_.reach(last); }
    }
    if (bias) {
      for (Index v = 0; v < n; ++v) { X[v * width + (end - begin)] = -equations_.h()(v); }
      for (Index limb = 0; limb < cholesky_.limbs().size(); ++limb) {
        const detail::Limb& own = cholesky_.limbs()[limb];
        if (own.end > own.begin) { cholesky_.reach(own.v + (own.end - own.begin) - 1); }
      }
    }
    cholesky_.template solve<width>(X);
    for (Index j = begin; j < end; ++j) {
      Scalar* target = Bhat.col(B.column(j).bhat).data();
      for (Index v = 0; v < n; ++v) { target[v] = X[v * width + (j - begin)]; }
    }
    if (bias) {
      for (Index v = 0; v < n; ++v) { result_.qdd0()(v) = X[v * width + (end - begin)]; }
    }
  }

  /// M as the factorisation wants it.
  MatrixX<Scalar>& matrix()
  {
    if constexpr (factorization == Factorization::dense) {
      return dense_;
    } else {
      return equations_.M();
    }
  }

  Index position(Index v) const { return factorization == Factorization::dense ? v : limbs_.path_position(v); }

  /// Subsystem that a velocity belongs to.
  Index owner(Index v) const
  {
    Index i = tree_->size() - 1;
    while (tree_->node(i).v > v || tree_->node(i).v_end <= v) { --i; }
    return i;
  }

  const Tree* tree_;
  detail::Limbs limbs_;
  detail::SparseEquations<Tree, scene> equations_;
  detail::BranchCholesky<Scalar> cholesky_;
  MatrixX<Scalar> dense_;
  VectorX<Scalar> X_;  // n_v × width, right-hand sides side by side
  detail::ResultMemory<Scalar> result_;
};

}  // namespace iim
