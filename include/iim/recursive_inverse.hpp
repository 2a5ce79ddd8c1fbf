// Recursive M⁻¹ on the workspace of the O(n) pass (the paper's reference [15]), then times B.
//
// Column j of M⁻¹ is the acceleration that a unit force on velocity j alone causes. With p_k the wrench that arrives at
// frame k (the sign of an applied force) all columns run through the tree at once,
//
//     inward    τ = Σ_k S_kᵀ p_k on the columns of i's subtree, 1 on i's own;   M⁻¹_i = M̄_R⁻¹ τ
//               p_inlet = X(r)ᵀ (Σ_k p_k − Wᵀ τ)
//     outward   y = X(r) V̇_inlet,   M⁻¹_i −= W y,   V̇_k = y + S_k M⁻¹_i
//
// and since M⁻¹ is symmetric only the columns j ≥ i, depth first: row i is one range, up to the end of i's root tree.
#pragma once

#include <iim/affine_dynamics.hpp>
#include <iim/inputs.hpp>
#include <iim/inversion/branches.hpp>
#include <iim/mass_matrix/input_matrix.hpp>
#include <iim/numerics/array.hpp>
#include <iim/numerics/registers.hpp>
#include <iim/receipt.hpp>
#include <iim/scalar.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>
#include <iim/workspace.hpp>

#include <algorithm>
#include <array>
#include <concepts>
#include <cstddef>

namespace iim {

/// B̂ = M⁻¹ B by the recursive inverse, q̈₀ from the O(n) pass. Owns its memory, O(n_v² + n_v · m); refers to tree and
/// inputs.
template <class Tree>
class RecursiveInverse {
public:
  using Scalar = typename Tree::Scalar;

  RecursiveInverse(const Tree& tree, const Inputs<Tree>& inputs)
      : tree_(&tree), limbs_(tree), B_(tree, inputs), stride_(detail::padded<Scalar>(tree.n_v()) + lanes),
        p_(Six::Zero(stride_, 6)), of_frame_(tree),
        Vdot_(static_cast<std::size_t>(of_frame_.count()), Six::Zero(stride_, 6)),
        root_end_(static_cast<std::size_t>(tree.size())), Minv_(stride_, tree.n_v()), result_(tree, inputs)
  {
    Minv_.setZero();
    for (const Node& node : tree.nodes()) {
      root_end_[detail::at(node.index)] = node.parent < 0 ? node.v_end : root_end_[detail::at(node.parent)];
    }
  }

  RecursiveInverse(const Tree&&, const Inputs<Tree>&) = delete;
  RecursiveInverse(const Tree&, const Inputs<Tree>&&) = delete;

  /// For the inputs that are active now. No allocation, no exception.
  template <class Workspace>
    requires std::same_as<typename Workspace::Tree, Tree>
  AffineDynamics<Scalar> operator()(const ForwardDynamics<Workspace>& fd) &
  {
    const Index m = B_.inputs().columns();
    const Status status = result_.status_on(B_.inputs(), fd.status_on(*tree_));
    if (status != Status::ok) {
      Minv_.setConstant(detail::not_a_number<Scalar>());
      is_known_ = false;
      return result_.result(m, status, fd.subsystem());
    }
    if (!is_known_) { Minv_.setZero(); }  // between what hangs on the world apart it stays so
    is_known_ = true;
    result_.qdd0() = fd.qdd0();
    inward(fd.workspace());
    outward(fd.workspace());
    mirror();
    B_.compute(fd.workspace());
    multiply(m);
    const bool finite = detail::all_finite(result_.Bhat(m));
    return result_.result(m, finite ? Status::ok : Status::not_finite, -1);
  }

  /// M⁻¹ of the last call, n_v × n_v; NaN if its receipt was not ok.
  auto Minv() const { return Minv_.topRows(tree_->n_v()); }

private:
  static constexpr int lanes = detail::lane_count<Scalar>;
  static constexpr int tile = 4;  ///< columns of B̂ that share one load of M⁻¹
  using Strip = detail::Strip<Scalar>;
  using Six = Eigen::Matrix<Scalar, Eigen::Dynamic, 6>;  // a six-vector per column of M⁻¹, transposed

  /// Wrenches from the tips to the world.
  template <class Workspace>
  void inward(const Workspace& ws)
  {
    tree_->inward([&]<class N, class S>(const N& node, const S&) {
      const NodeState<S>& state = ws.template node<S>(node);
      if constexpr (S::n_i > 0) {
        for (int d = 0; d < S::n_i; ++d) {
          for (int e = 0; e < S::n_i; ++e) { Minv_(node.v + e, node.v + d) = state.MbarR_inv(e, d); }
          if (node.inlet >= 0) {
            Vector6<Scalar> w;
            for (int c = 0; c < 6; ++c) { w(c) = -state.W(d, c); }
            w = shift_wrench(state.r, w);
            for (int c = 0; c < 6; ++c) { p_(node.v + d, c) = w(c); }
          }
        }
        if constexpr (S::n_frames == 1) {
          inward_range<S>(node, state, 0, node.v + S::n_i, node.v_end);
        } else {
          for (Index i = node.index + 1; i < node.subtree_end; i = tree_->node(i).subtree_end) {
            const Node& child = tree_->node(i);
            inward_range<S>(node, state, static_cast<int>(child.inlet - node.frame), child.v, child.v_end);
          }
        }
      } else if (node.inlet >= 0) {
        for (Index j = node.v; j < node.v_end; j += lanes) {
          std::array<Strip, 6> p = load_six(p_.data() + j);
          store_shifted(state.r, p, j, node.v_end - j);
        }
      }
    });
  }

  /// Columns begin … end of the subtrees on frame k.
  template <class S, class N>
  [[gnu::always_inline]] void inward_range(const N& node, const NodeState<S>& state, int k, Index begin, Index end)
  {
    constexpr int n_i = S::n_i;
    const auto& S_k = state.S_k[detail::at(k)];
    for (Index j = begin; j < end; j += lanes) {
      std::array<Strip, 6> p = load_six(p_.data() + j);
      std::array<Strip, n_i> tau;
      for (int d = 0; d < n_i; ++d) {
        constexpr int first = S::pattern.linear ? 0 : 3, last = S::pattern.angular ? 6 : 3;
        tau[detail::at(d)].setZero();
        for (int c = first; c < last; ++c) { tau[detail::at(d)] += p[detail::at(c)] * S_k(c, d); }
      }
      for (int d = 0; d < n_i; ++d) {
        Strip row = tau[0] * state.MbarR_inv(d, 0);
        for (int e = 1; e < n_i; ++e) { row += tau[detail::at(e)] * state.MbarR_inv(d, e); }
        detail::store(Minv_.data() + (node.v + d) * stride_ + j, row, end - j);
      }
      if (node.inlet < 0) { continue; }
      for (int c = 0; c < 6; ++c) {
        if constexpr (detail::is_free<S>()) {
          p[detail::at(c)].setZero();  // 1 − Wᵀ Sᵀ = 0
        } else {
          for (int d = 0; d < n_i; ++d) { p[detail::at(c)] -= tau[detail::at(d)] * state.W(d, c); }
        }
      }
      store_shifted(state.r, p, j, end - j);
    }
  }

  [[gnu::always_inline]] std::array<Strip, 6> load_six(const Scalar* from) const
  {
    std::array<Strip, 6> p;
    for (int c = 0; c < 6; ++c) { p[detail::at(c)] = detail::load(from + c * stride_); }
    return p;
  }

  /// X(r)ᵀ p in columns j … of p_.
  [[gnu::always_inline]] void store_shifted(const Vector3<Scalar>& r, std::array<Strip, 6>& p, Index j, Index count)
  {
    detail::move_wrench(r, p);
    for (int c = 0; c < 6; ++c) { detail::store(p_.data() + c * stride_ + j, p[detail::at(c)], count); }
  }

  /// Accelerations from the world outward.
  template <class Workspace>
  void outward(const Workspace& ws)
  {
    tree_->outward([&]<class N, class S>(const N& node, const S&) {
      const NodeState<S>& state = ws.template node<S>(node);
      // At the root y = 0: the rows are done, and only children need V̇.
      const Index end = root_end_[detail::at(node.index)];
      for (Index j = node.v; j < end; j += lanes) {
        if (node.inlet < 0) {
          outward_lanes<S, false>(node, state, j, end - j);
        } else {
          outward_lanes<S, true>(node, state, j, end - j);
        }
      }
    });
  }

  template <class S, bool guided, class N>
  [[gnu::always_inline]] void outward_lanes(const N& node, const NodeState<S>& state, Index j, Index count)
  {
    constexpr int n_i = S::n_i;
    std::array<Strip, 6> y;
    if constexpr (guided) {
      y = load_six(Vdot_[detail::at(of_frame_[node.inlet])].data() + j);
      detail::move_twist(state.r, y);
    }
    std::array<Strip, n_i> qdd, relative;
    for (int d = 0; d < n_i; ++d) {
      Scalar* row = Minv_.data() + (node.v + d) * stride_ + j;
      // Columns beyond the subtree have no force on it: what the row holds there is of the state before.
      if (j + lanes <= node.v_end) {
        qdd[detail::at(d)] = detail::load(row);
      } else {
        qdd[detail::at(d)].setZero();
        const Index own = node.v_end - j;
        for (int l = 0; l < own; ++l) { qdd[detail::at(d)](l) = row[l]; }
      }
      relative[detail::at(d)] = qdd[detail::at(d)];
      if constexpr (guided) {
        for (int c = 0; c < 6; ++c) { qdd[detail::at(d)] -= y[detail::at(c)] * state.W(d, c); }
        detail::store(row, qdd[detail::at(d)], count);
      }
    }
    for (int k = 0; k < S::n_frames; ++k) {
      Scalar* frame = Vdot_[detail::at(of_frame_[node.frame + k])].data() + j;
      for (int c = 0; c < 6; ++c) {
        // On a free subsystem S W = 1: y + S (M̄_R⁻¹ τ − W y) is S M̄_R⁻¹ τ.
        constexpr bool with_guidance = guided && !detail::is_free<S>();
        Strip Vdot;
        if constexpr (with_guidance) {
          Vdot = y[detail::at(c)];
        } else {
          Vdot.setZero();
        }
        if (c < 3 ? S::pattern.linear : S::pattern.angular) {
          for (int d = 0; d < n_i; ++d) {
            Vdot += (with_guidance ? qdd[detail::at(d)] : relative[detail::at(d)]) * state.S_k[detail::at(k)](c, d);
          }
        }
        detail::store(frame + c * stride_, Vdot);
      }
    }
  }

  /// The upper half of M⁻¹ is the lower half.
  void mirror()
  {
    for (const Node& node : tree_->nodes()) {
      if (node.parent >= 0) { continue; }
      constexpr Index block = 8;
      for (Index begin = node.v; begin < node.v_end; begin += block) {
        const Index end = std::min(begin + block, node.v_end);
        for (Index i = begin; i < node.v_end; ++i) {
          for (Index j = begin; j < std::min(i, end); ++j) { Minv_(j, i) = Minv_(i, j); }
        }
      }
    }
  }

  /// M⁻¹ B: rows of one root tree, columns of the inputs on it.
  void multiply(Index m)
  {
    auto Bhat = result_.Bhat(m);
    Index next = 0;
    for (const Node& root : tree_->nodes()) {
      if (root.parent >= 0) { continue; }
      while (next < m && B_.column(next).subsystem < root.subtree_end) {
        Index last = next + 1;
        while (last < m && last < next + tile && B_.column(last).subsystem == B_.column(next).subsystem &&
               B_.column(last).begin == B_.column(next).begin) {
          ++last;
        }
        if (last - next == tile) {
          multiply_tile<tile>(root, next, Bhat);
        } else if (last - next == 3) {
          multiply_tile<3>(root, next, Bhat);
        } else {
          for (Index j = next; j < last; ++j) { multiply_tile<1>(root, j, Bhat); }
        }
        next = last;
      }
    }
  }

  template <int count, class Matrix>
  void multiply_tile(const Node& root, Index j, Matrix& Bhat)
  {
    const auto& column = B_.column(j);
    const Scalar* entries = B_.entries(j);
    for (int k = 0; k < count; ++k) {
      auto target = Bhat.col(B_.column(j + k).bhat);
      target.head(root.v).setZero();
      target.tail(Bhat.rows() - root.v_end).setZero();
    }
    const Index limb = limbs_.limb_of(column.subsystem);
    for (Index v = root.v; v < root.v_end; v += lanes) {
      std::array<Strip, count> sum;
      for (int k = 0; k < count; ++k) { sum[detail::at(k)].setZero(); }
      limbs_.for_each_run(limb, column.begin, column.end, [&](Index a, Index first, Index run) {
        const Scalar* Minv = Minv_.data() + first * stride_ + v;
        for (Index i = 0; i < run; ++i, Minv += stride_) {
          const Strip M = detail::load(Minv);
          for (int k = 0; k < count; ++k) { sum[detail::at(k)] += M * entries[k * B_.stride() + a + i]; }
        }
      });
      for (int k = 0; k < count; ++k) {
        detail::store(&Bhat(v, B_.column(j + k).bhat), sum[detail::at(k)], root.v_end - v);
      }
    }
  }

  const Tree* tree_;
  detail::Limbs limbs_;
  detail::InputMatrix<Tree> B_;
  Index stride_;  // n_v, padded so that lanes may begin at any column
  Six p_;
  detail::FrameBuffers of_frame_;
  detail::Array<Six> Vdot_;
  detail::Array<Index> root_end_;  // of a subsystem: first velocity after its root tree
  MatrixX<Scalar> Minv_;           // column i: row i of M⁻¹, which is symmetric
  detail::ResultMemory<Scalar> result_;
  bool is_known_ = true;
};

}  // namespace iim
