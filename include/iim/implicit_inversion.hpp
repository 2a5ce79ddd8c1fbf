// The implicit inversion method, Sect. 4: B̂ from what the O(n) pass left, without M and without its inverse.
//
// With C_a C_aᵀ = M̄_R⁻¹ of ancestor a (the root of the factor that (50) has in its middle) the two steps of
// Algorithm 1 run on columns that carry C_a from the start:
//
//     H_k(:, a) : accelerations of frame k per C-scaled coordinate of a, the rows G F*_p C_a of (31)
//     outward   y = X(r) H_inlet,   L_i(:, a) = −W y,   L_i(:, i) = C_i          L = Γ⁻¹ diag(C)      (48)
//               H_k(:, a) = y + S_k L_i(:, a),   H_k(:, i) = S_k C_i             H = F* diag(C)       (31)
//     B̂ = L (Lᵀ or Hᵀ) B̄ = Γ⁻¹ diag(M̄_R⁻¹) F*ᵀ B̄                                                     (50)
//
// Row i of L and H is non-zero only in the columns of i's ancestors, so these columns are numbered along the path from
// the world ("path positions"): no zero of a tree's branching is stored or multiplied.
#pragma once

#include <iim/affine_dynamics.hpp>
#include <iim/forward_dynamics.hpp>
#include <iim/inputs.hpp>
#include <iim/spatial.hpp>
#include <iim/workspace.hpp>

#include <vector>

namespace iim {

/// B̂ and q̈₀ by implicit inversion (Algorithm 1). Owns its memory, O(n_v · depth + n_v · m); refers to tree and inputs.
template <class Tree>
class ImplicitInversion {
public:
  using Scalar = typename Tree::Scalar;

  ImplicitInversion(const Tree& tree, const Inputs<Tree>& inputs)
      : tree_(&tree), inputs_(&inputs), L_(tree.n_v(), tree.max_path_v()),
        beta_(tree.max_path_v(), inputs.max_columns()), result_(tree.n_v(), inputs.max_columns())
  {
    assign_buffers();
    columns_at_.resize(static_cast<std::size_t>(tree.size()));
  }

  /// Steps 2 and 3 of Algorithm 1 for the inputs that are active now. No allocation, no exception.
  template <class Workspace>
  AffineDynamics<Scalar> operator()(const ForwardDynamics<Workspace>& fd)
  {
    const Index m = inputs_->columns();
    assert(inputs_->max_columns() <= beta_.cols() && "inputs were added after the method was made");
    if (!fd.ok()) { return result_.result(m, fd.status(), fd.subsystem()); }
    result_.qdd0() = fd.qdd0();
    outward(fd.workspace());
    multiply();
    const bool finite = detail::all_finite(result_.Bhat(m));
    return result_.result(m, finite ? Status::ok : Status::not_finite, -1);
  }

private:
  using Columns = Eigen::Matrix<Scalar, Eigen::Dynamic, 6>;  // H of one frame, transposed: a column per component

  /// Every frame's H lives until the last of its children is done; the last child may write over it.
  void assign_buffers()
  {
    const std::size_t frames = static_cast<std::size_t>(tree_->n_frames());
    std::vector<Index> last_use(frames, -1);
    for (const Node& node : tree_->nodes()) {
      if (node.inlet >= 0) { last_use[static_cast<std::size_t>(node.inlet)] = node.index; }
    }
    buffer_of_.assign(frames, -1);
    std::vector<int> free;
    int count = 0;
    const auto take = [&] {
      if (free.empty()) { return count++; }
      const int buffer = free.back();
      free.pop_back();
      return buffer;
    };
    for (const Node& node : tree_->nodes()) {
      const Index end = node.index + 1 < tree_->size() ? tree_->node(node.index + 1).frame : tree_->n_frames();
      // The inlet is read column by column before the first frame writes the same column: the buffer may be the same.
      if (node.inlet >= 0 && last_use[static_cast<std::size_t>(node.inlet)] == node.index) {
        free.push_back(buffer_of_[static_cast<std::size_t>(node.inlet)]);
      }
      for (Index f = node.frame; f < end; ++f) { buffer_of_[static_cast<std::size_t>(f)] = take(); }
      for (Index f = node.frame; f < end; ++f) {
        if (last_use[static_cast<std::size_t>(f)] < 0) { free.push_back(buffer_of_[static_cast<std::size_t>(f)]); }
      }
    }
    buffers_.assign(static_cast<std::size_t>(count), Columns(tree_->max_path_v(), 6));
  }

  Columns& H(Index frame) { return buffers_[static_cast<std::size_t>(buffer_of_[static_cast<std::size_t>(frame)])]; }

  /// Step 2: L and H along every path; at each subsystem, β = Hᵀ w or Lᵀ B̄ for the inputs that act on it.
  template <class Workspace>
  void outward(const Workspace& ws)
  {
    for (auto& columns : columns_at_) { columns.clear(); }
    inputs_->for_each_active([&](const Input<Scalar>& input, Index column) {
      columns_at_[static_cast<std::size_t>(input.subsystem)].push_back({&input, column});
    });
    tree_->outward([&]<class N, class S>(const N& node, const S&) {
      constexpr int n_i = S::n_i;
      const NodeState<S>& state = ws.template node<S>(node);
      for (Index a = 0; a < node.path_v; ++a) {
        const Columns& inlet = H(node.inlet);
        Vector6<Scalar> y = shift_twist<Scalar>(state.r, inlet.row(a).transpose());
        if constexpr (detail::is_free<S>()) { y.setZero(); }
        Eigen::Matrix<Scalar, n_i, 1> l;
        if constexpr (n_i > 0) {
          l.noalias() = -(state.W.lazyProduct(y));
          for (int d = 0; d < n_i; ++d) { L_(node.v + d, a) = l(d); }
        }
        for (int k = 0; k < S::n_frames; ++k) {
          Vector6<Scalar> h = y;
          if constexpr (n_i > 0 && S::pattern.linear) {
            h.template head<3>() += state.S_k[static_cast<std::size_t>(k)].template topRows<3>() * l;
          }
          if constexpr (n_i > 0 && S::pattern.angular) {
            h.template tail<3>() += state.S_k[static_cast<std::size_t>(k)].template bottomRows<3>() * l;
          }
          H(node.frame + k).row(a) = h.transpose();
        }
      }
      if constexpr (n_i > 0) {
        const auto& C = state.MbarR_inv_root;
        L_.template block<n_i, n_i>(node.v, node.path_v) = C;
        for (int k = 0; k < S::n_frames; ++k) {
          H(node.frame + k).template middleRows<n_i>(node.path_v).noalias() =
              (state.S_k[static_cast<std::size_t>(k)] * C).transpose();
        }
      }
      for (const Column& at : columns_at_[static_cast<std::size_t>(node.index)]) {
        project_input(ws, *at.input, at.column, node.path_v + n_i, n_i);
      }
    });
  }

  /// β = Lᵀ B̄ (motors) or Hᵀ w (points) in path positions 0 … depth.
  template <class Workspace>
  void project_input(const Workspace& ws, const Input<Scalar>& input, Index column, Index depth, Index n_i)
  {
    for (Index j = 0; j < input.size; ++j) {
      auto beta = beta_.col(column + j).head(depth);
      if (input.kind == InputKind::motor) {
        beta.setZero();
        for (Index d = 0; d < n_i; ++d) {
          beta += L_.row(input.v + d).head(depth).transpose() * ws.Bbar()(input.bbar + j * n_i + d);
        }
      } else {
        const Vector6<Scalar> w = detail::input_wrench(input, ws.frame(input.frame), j);
        beta.noalias() = H(input.frame).topRows(depth).lazyProduct(w);
      }
    }
  }

  /// Step 3: B̂ = L β, each path position reaching the rows of the subtree that shares it.
  void multiply()
  {
    auto Bhat = result_.Bhat(inputs_->columns());
    Bhat.setZero();
    inputs_->for_each_active([&](const Input<Scalar>& input, Index column) {
      for (Index i = input.subsystem; i >= 0; i = tree_->node(i).parent) {
        const Node& node = tree_->node(i);
        const Index own = (i + 1 < tree_->size() ? tree_->node(i + 1).v : tree_->n_v()) - node.v;
        const Index rows = node.v_end - node.v;
        for (Index j = column; j < column + input.size; ++j) {
          for (Index d = 0; d < own; ++d) {
            const Index a = node.path_v + d;
            Bhat.col(j).segment(node.v, rows) += L_.col(a).segment(node.v, rows) * beta_(a, j);
          }
        }
      }
    });
  }

  struct Column {
    const Input<Scalar>* input;
    Index column;
  };

  const Tree* tree_;
  const Inputs<Tree>* inputs_;
  MatrixX<Scalar> L_;     // n_v × depth: Γ⁻¹ diag(C), column a of row r belongs to the a-th velocity on r's path
  MatrixX<Scalar> beta_;  // depth × m
  std::vector<Columns> buffers_;
  std::vector<int> buffer_of_;
  std::vector<std::vector<Column>> columns_at_;
  detail::ResultMemory<Scalar> result_;
};

}  // namespace iim
