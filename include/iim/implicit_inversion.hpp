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

#include <algorithm>
#include <array>
#include <type_traits>
#include <vector>

namespace iim {

/// B̂ and q̈₀ by implicit inversion (Algorithm 1). Owns its memory, O(n_v · depth + n_v · m); refers to tree and inputs.
template <class Tree>
class ImplicitInversion {
public:
  using Scalar = typename Tree::Scalar;

  ImplicitInversion(const Tree& tree, const Inputs<Tree>& inputs)
      : tree_(&tree), inputs_(&inputs), depth_(padded(tree.max_path_v())), rows_(padded(tree.n_v()) + lanes),
        L_(rows_, depth_), L_rows_(depth_, tree.n_v()), beta_(depth_, inputs.max_columns()),
        acting_(static_cast<std::size_t>(tree.size())), columns_(static_cast<std::size_t>(inputs.max_columns())),
        result_(tree.n_v(), inputs.max_columns())
  {
    L_.setZero();
    beta_.setZero();
    for (Index id = 0; id < inputs.blocks(); ++id) {
      acting_[static_cast<std::size_t>(inputs.block(id).subsystem)].push_back(id);
    }
    assign_buffers();
    find_limbs();
  }

  /// Steps 2 and 3 of Algorithm 1 for the inputs that are active now. No allocation, no exception.
  template <class Workspace>
  AffineDynamics<Scalar> operator()(const ForwardDynamics<Workspace>& fd)
  {
    const Index m = inputs_->columns();
    assert(inputs_->max_columns() == beta_.cols() && "inputs were added after the method was made");
    if (!fd.ok()) { return result_.result(m, fd.status(), fd.subsystem()); }
    result_.qdd0() = fd.qdd0();
    number_columns();
    outward(fd.workspace());
    multiply(m);
    const bool finite = detail::all_finite(result_.Bhat(m));
    return result_.result(m, finite ? Status::ok : Status::not_finite, -1);
  }

private:
  /// Columns or rows that one step of a loop treats: what a vector register or two hold, or one for other Scalars.
  static constexpr int lanes = std::is_same_v<Scalar, double> || std::is_same_v<Scalar, float> ? 8 : 1;
  using Lanes = Eigen::Array<Scalar, lanes, 1>;
  using LanesMap = Eigen::Map<Lanes>;
  using ConstLanesMap = Eigen::Map<const Lanes>;
  using Buffer = Eigen::Matrix<Scalar, Eigen::Dynamic, 6>;  // H of one frame, transposed: a column per component

  static Index padded(Index size) { return (size + lanes - 1) / lanes * lanes; }

  /// An unbranched run of subsystems: its path positions, and the rows of its subtree.
  struct Limb {
    Index parent;           ///< limb that it hangs on; −1: none
    Index begin, end;       ///< path positions of its own velocities
    Index v_begin, v_end;   ///< rows of its subtree
  };

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
      // The inlet is read lane by lane before the first frame writes the same lanes: the buffer may be the same.
      if (node.inlet >= 0 && last_use[static_cast<std::size_t>(node.inlet)] == node.index) {
        free.push_back(buffer_of_[static_cast<std::size_t>(node.inlet)]);
      }
      for (Index f = node.frame; f < end; ++f) { buffer_of_[static_cast<std::size_t>(f)] = take(); }
      for (Index f = node.frame; f < end; ++f) {
        if (last_use[static_cast<std::size_t>(f)] < 0) { free.push_back(buffer_of_[static_cast<std::size_t>(f)]); }
      }
    }
    buffers_.assign(static_cast<std::size_t>(count), Buffer::Zero(depth_, 6));
  }

  void find_limbs()
  {
    const auto children = [&](Index i) {
      Index count = 0;
      for (const Node& node : tree_->nodes()) { count += node.parent == i; }
      return count;
    };
    path_end_.resize(static_cast<std::size_t>(tree_->n_v()));
    for (const Node& node : tree_->nodes()) {
      const Index own = (node.index + 1 < tree_->size() ? tree_->node(node.index + 1).v : tree_->n_v()) - node.v;
      if (node.parent >= 0 && children(node.parent) == 1) {
        limb_of_.push_back(limb_of_[static_cast<std::size_t>(node.parent)]);
        limbs_[static_cast<std::size_t>(limb_of_.back())].end += own;
      } else {
        const Index parent = node.parent < 0 ? -1 : limb_of_[static_cast<std::size_t>(node.parent)];
        limb_of_.push_back(static_cast<Index>(limbs_.size()));
        limbs_.push_back({parent, node.path_v, node.path_v + own, node.v, node.v_end});
      }
      for (Index d = 0; d < own; ++d) { path_end_[static_cast<std::size_t>(node.v + d)] = node.path_v + own; }
    }
  }

  Scalar* H(Index frame) { return buffers_[static_cast<std::size_t>(buffer_of_[static_cast<std::size_t>(frame)])].data(); }

  void number_columns()
  {
    Index column = 0;
    for (Index id = 0; id < inputs_->blocks(); ++id) {
      const Input<Scalar>& input = inputs_->block(id);
      if (!input.active) { continue; }
      for (Index j = 0; j < input.size; ++j) {
        columns_[static_cast<std::size_t>(column + j)] = {limb_of_[static_cast<std::size_t>(input.subsystem)], 0};
      }
      column_of_[static_cast<std::size_t>(id)] = column;
      column += input.size;
    }
  }

  /// Step 2: L and H along every path; at each subsystem, β = Hᵀ w or Lᵀ B̄ for the inputs that act on it.
  template <class Workspace>
  void outward(const Workspace& ws)
  {
    tree_->outward([&]<class N, class S>(const N& node, const S&) {
      const NodeState<S>& state = ws.template node<S>(node);
      if constexpr (!detail::is_free<S>()) {
        for (Index a = 0; a < node.path_v; a += lanes) { propagate<S>(node, state, a); }
      }
      if constexpr (S::n_i > 0) { begin_columns<S>(node, state); }
      for (const Index id : acting_[static_cast<std::size_t>(node.index)]) {
        const Input<Scalar>& input = inputs_->block(id);
        if (input.active) { project_input(ws, input, column_of_[static_cast<std::size_t>(id)], node.path_v + S::n_i, S::n_i); }
      }
    });
  }

  /// Columns a … a + lanes of L and H: y = X(r) H_inlet, L_i = −W y, H_k = y + S_k L_i.
  template <class S, class N>
  void propagate(const N& node, const NodeState<S>& state, Index a)
  {
    constexpr int n_i = S::n_i;
    const Scalar* inlet = H(node.inlet) + a;
    std::array<Lanes, 6> y;
    for (int c = 0; c < 6; ++c) { y[at(c)] = ConstLanesMap(inlet + c * depth_); }
    y[0] += y[4] * state.r(2) - y[5] * state.r(1);
    y[1] += y[5] * state.r(0) - y[3] * state.r(2);
    y[2] += y[3] * state.r(1) - y[4] * state.r(0);

    std::array<Lanes, n_i> l;
    for (int d = 0; d < n_i; ++d) {
      l[at(d)] = -state.W(d, 0) * y[0];
      for (int c = 1; c < 6; ++c) { l[at(d)] -= state.W(d, c) * y[at(c)]; }
      LanesMap(L_rows_.data() + (node.v + d) * depth_ + a) = l[at(d)];
      const Index count = std::min<Index>(lanes, node.path_v - a);
      for (Index p = 0; p < count; ++p) { L_(node.v + d, a + p) = l[at(d)](p); }
    }
    for (int k = 0; k < S::n_frames; ++k) {
      Scalar* frame = H(node.frame + k) + a;
      for (int c = 0; c < 6; ++c) {
        Lanes h = y[at(c)];
        if (c < 3 ? S::pattern.linear : S::pattern.angular) {
          for (int d = 0; d < n_i; ++d) { h += state.S_k[at(k)](c, d) * l[at(d)]; }
        }
        LanesMap(frame + c * depth_) = h;
      }
    }
  }

  /// Columns of the subsystem's own velocities: L(:, i) = C, H_k(:, i) = S_k C.
  template <class S, class N>
  void begin_columns(const N& node, const NodeState<S>& state)
  {
    constexpr int n_i = S::n_i;
    const auto& C = state.MbarR_inv_root;
    for (int d = 0; d < n_i; ++d) {
      for (int e = 0; e < n_i; ++e) {
        L_(node.v + e, node.path_v + d) = C(e, d);
        L_rows_(node.path_v + d, node.v + e) = C(e, d);
      }
    }
    for (int k = 0; k < S::n_frames; ++k) {
      Scalar* frame = H(node.frame + k) + node.path_v;
      for (int d = 0; d < n_i; ++d) {
        for (int c = 0; c < 6; ++c) {
          Scalar h = Scalar(0);
          if (c < 3 ? S::pattern.linear : S::pattern.angular) {
            for (int e = 0; e <= d; ++e) { h += state.S_k[at(k)](c, e) * C(e, d); }
          }
          frame[c * depth_ + d] = h;
        }
      }
    }
  }

  /// β = Lᵀ B̄ (motors) or Hᵀ w (points) in path positions 0 … depth; zero from there to the end of the limb.
  template <class Workspace>
  void project_input(const Workspace& ws, const Input<Scalar>& input, Index column, Index depth, Index n_i)
  {
    for (Index j = 0; j < input.size; ++j) {
      Scalar* beta = beta_.data() + (column + j) * depth_;
      if (input.kind == InputKind::motor) {
        for (Index a = 0; a < depth; a += lanes) {
          Lanes sum = Lanes::Zero();
          for (Index d = 0; d < n_i; ++d) {
            sum += ConstLanesMap(L_rows_.data() + (input.v + d) * depth_ + a) * ws.Bbar()(input.bbar + j * n_i + d);
          }
          LanesMap(beta + a) = sum;
        }
      } else {
        const Vector6<Scalar> w = detail::input_wrench(input, ws.frame(input.frame), j);
        const Scalar* h = H(input.frame);
        for (Index a = 0; a < depth; a += lanes) {
          Lanes sum = ConstLanesMap(h + a) * w(0);
          for (int c = 1; c < 6; ++c) { sum += ConstLanesMap(h + c * depth_ + a) * w(c); }
          LanesMap(beta + a) = sum;
        }
      }
      columns_[static_cast<std::size_t>(column + j)].depth = depth;
    }
  }

  /// Step 3: B̂ = L β, limb by limb: the path positions of a limb reach the rows of its subtree.
  void multiply(Index m)
  {
    auto Bhat = result_.Bhat(m);
    Bhat.setZero();
    for (Index j = 0; j < m; ++j) {
      Index depth = columns_[static_cast<std::size_t>(j)].depth;
      const Scalar* beta = beta_.data() + j * depth_;
      for (Index i = columns_[static_cast<std::size_t>(j)].limb; i >= 0; i = limbs_[static_cast<std::size_t>(i)].parent) {
        const Limb& limb = limbs_[static_cast<std::size_t>(i)];
        depth = std::min(depth, limb.end);
        for (Index v = limb.v_begin; v < limb.v_end; v += lanes) {
          // Rows of the limb itself are zero beyond their own position.
          const Index rows = std::min<Index>(lanes, limb.v_end - v);
          const Index end = std::min(depth, path_end_[static_cast<std::size_t>(v + rows - 1)]);
          Lanes sum = Lanes::Zero();
          const Scalar* l = L_.data() + limb.begin * rows_ + v;
          for (Index a = limb.begin; a < end; ++a, l += rows_) { sum += ConstLanesMap(l) * beta[a]; }
          Scalar* b = Bhat.data() + j * Bhat.rows() + v;
          if (rows == lanes) {
            LanesMap(b) += sum;
          } else {
            for (Index p = 0; p < rows; ++p) { b[p] += sum(p); }
          }
        }
      }
    }
  }

  static constexpr std::size_t at(int k) { return static_cast<std::size_t>(k); }

  struct Column {
    Index limb;   ///< that the input acts on
    Index depth;  ///< path positions that it reaches
  };

  const Tree* tree_;
  const Inputs<Tree>* inputs_;
  Index depth_;             // padded length of the longest path
  Index rows_;              // n_v, padded so that lanes may begin at any row
  MatrixX<Scalar> L_;       // rows × depth: Γ⁻¹ diag(C); entry (r, a) belongs to the a-th velocity on r's path
  MatrixX<Scalar> L_rows_;  // its transpose
  MatrixX<Scalar> beta_;    // depth × m
  std::vector<Buffer> buffers_;
  std::vector<int> buffer_of_;
  std::vector<Limb> limbs_;
  std::vector<Index> limb_of_;   // of a subsystem
  std::vector<Index> path_end_;  // of a row: path positions up to and including its subsystem
  std::vector<std::vector<Index>> acting_;  // inputs on each subsystem
  std::vector<Column> columns_;
  std::vector<Index> column_of_ = std::vector<Index>(static_cast<std::size_t>(inputs_->blocks()));
  detail::ResultMemory<Scalar> result_;
};

}  // namespace iim
