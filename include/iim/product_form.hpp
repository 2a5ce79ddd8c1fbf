// The implicit inversion as a product of matrices, Algorithm 1: Γ⁻¹ and F* first, then B̂ for all inputs at once.
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

#include <iim/branches.hpp>
#include <iim/inputs.hpp>
#include <iim/limb_product.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>
#include <iim/workspace.hpp>

#include <algorithm>
#include <array>
#include <cassert>
#include <cstring>
#include <type_traits>
#include <utility>
#include <vector>

namespace iim::detail {

/// B̂ from the workspace. Construction allocates O(n_v · depth + depth · m); nothing after it does. Refers to the tree.
template <class Tree>
class ProductForm {
public:
  using Scalar = typename Tree::Scalar;

  ProductForm(const Tree& tree, const Inputs<Tree>& inputs)
      : tree_(&tree), limbs_(tree), frame_buffers_(tree), inputs_(inputs), depth_(padded<Scalar>(limbs_.depth())),
        rows_(padded<Scalar>(tree.n_v()) + lanes), L_rows_(depth_, padded<Scalar>(tree.n_v())),
        beta_(depth_, inputs.max_columns()),
        H_(static_cast<std::size_t>(frame_buffers_.count())),
        first_column_(static_cast<std::size_t>(tree.size()) + 1, 0), needed_(static_cast<std::size_t>(tree.size()), 0),
        columns_(static_cast<std::size_t>(inputs.max_columns()))
  {
    if constexpr (lanes > 1) {
      // Columns an odd number of registers apart share fewer lines of the cache (5 % at n = 24, 56, 120).
      rows_ += rows_ / lanes % 2 == 0 ? lanes : 0;
      L_.setZero(rows_, depth_);
    }
    L_rows_.setZero();
    beta_.setZero();
    for (VectorX<Scalar>& H : H_) { H.setZero(components * depth_); }
    path_end_.resize(static_cast<std::size_t>(tree.n_v()));
    for (const Node& node : tree.nodes()) {
      const Index own_end = node.index + 1 < tree.size() ? tree.node(node.index + 1).v : tree.n_v();
      std::fill(path_end_.begin() + node.v, path_end_.begin() + own_end, node.path_v + own_end - node.v);
      if (limbs_.limb_of(node.index) == static_cast<Index>(limb_subsystems_.size())) {
        limb_subsystems_.push_back({node.index, node.subtree_end});
      }
      roots_ += node.parent < 0;
    }
  }

  /// Steps 2 and 3 of Algorithm 1: all active columns, n_v × inputs.columns(). The workspace holds the O(n) pass.
  /// Returns true if B̂ is known to be finite.
  template <class Workspace, class Matrix>
  bool operator()(const Workspace& ws, Matrix& Bhat)
  {
    inputs_.number_columns();
    outward(ws);
    if constexpr (lanes > 1) { transpose_L(); }
    check_ = Scalar(0);
    multiply_all(Bhat);
    return is_register<Scalar> && detail::is_finite(check_);
  }

private:
  static constexpr int lanes = lane_count<Scalar>;  ///< columns or rows that one step of a loop treats
  static constexpr int side = std::clamp<int>(EIGEN_MAX_STATIC_ALIGN_BYTES / sizeof(Scalar), 1, lanes);  ///< of a register
  /// Columns of B̂ that share one load of L. Eight instead of four: 18 % less for a chain of 100, 6 % for the biped.
  static constexpr int tile = lanes > 1 && side == lanes ? 8 : tile_count<Scalar>;
  using Lanes = detail::Lanes<Scalar>;

  static constexpr int rate = 6;        ///< in square-root form H without S·rate, and rate; see SharedAxis
  static constexpr int components = 7;  ///< of H per path position

  /// Where one column of B̂ is worked on and where it goes.
  struct Column {
    Index bhat;   ///< column of B̂
    Index depth;  ///< path positions that the input reaches
  };

  Scalar* H(Index frame) { return H_[static_cast<std::size_t>(frame_buffers_[frame])].data(); }

  /// Step 2: L and H along every path; at each subsystem, β = Hᵀ w or Lᵀ B̄ for the inputs that act on it.
  template <class Workspace>
  void outward(const Workspace& ws)
  {
    number_inputs();
    Index column = 0;
    tree_->outward([&]<class N, class S>(const N& node, const S&) {
      const NodeState<S>& state = ws.template node<S>(node);
      // Columns that no input reaches are not computed; those of a subsystem's ancestors that one does come first.
      Index& needed = needed_[static_cast<std::size_t>(node.index)];
      needed = node.path_v;
      if (node.parent >= 0 && !reached(tree_->node(node.parent))) {
        needed = needed_[static_cast<std::size_t>(node.parent)];
      }
      propagate<S>(ws, node, state, needed, reached(node) ? S::n_i : 0);
      if (!reached(node)) { return; }
      const Index depth = node.path_v + S::n_i;
      inputs_.for_each_on(node.index, [&](const Input<Scalar>& input, Index bhat) {
        if (input.kind == InputKind::motor) {
          project_motor<S>(ws, input, column, depth);
        } else {
          project_point(ws, input, column, depth);
        }
        const Index limb_end = limbs_[limbs_.limb_of(node.index)].end;
        for (Index j = 0; j < input.size; ++j, ++column) {
          columns_[static_cast<std::size_t>(column)] = {bhat + j, depth};
          std::fill(beta_.data() + column * depth_ + depth, beta_.data() + column * depth_ + limb_end, Scalar(0));
        }
      });
    });
  }

  /// first_column_: of the sorted active columns, per subsystem.
  void number_inputs()
  {
    Index column = 0;
    for (Index i = 0; i < tree_->size(); ++i) {
      first_column_[static_cast<std::size_t>(i)] = column;
      inputs_.for_each_on(i, [&](const Input<Scalar>& input, Index) { column += input.size; });
    }
    first_column_.back() = column;
  }

  /// Whether an active input acts on the subtree of a subsystem.
  template <class N>
  bool reached(const N& node) const
  {
    return first_column_[static_cast<std::size_t>(node.index)] < first_column_[static_cast<std::size_t>(node.subtree_end)];
  }

  /// Columns 0 … needed of L and H, y = X(r) H_inlet, L_i = −W y, H_k = y + S_k L_i, and after them the subsystem's `own`
  /// ones: y = 0, L_i = C. The last lanes after these are zero, and therefore so in all that follows from them.
  template <class S, class Workspace, class N>
  [[gnu::always_inline]] void propagate(const Workspace& ws, const N& node, const NodeState<S>& state, Index needed,
                                        Index own)
  {
    constexpr int n_i = S::n_i;
    constexpr bool apart = Workspace::update == Update::square_root && along<S>() != Along::nothing;
    const Index depth = depth_;
    Scalar* const L_rows = L_rows_.data() + node.v * depth;
    const Scalar* const inlet = needed > 0 ? H(node.inlet) : nullptr;
    std::array<Scalar*, S::n_frames> frames;
    for (int k = 0; k < S::n_frames; ++k) { frames[at(k)] = H(node.frame + k); }
    for (Index a = 0; a < needed + own; a += lanes) {
      std::array<Lanes, n_i> l;
      l.fill(Lanes::Zero());
      for (Index e = std::max<Index>(0, a - node.path_v); e < std::min(own, a + lanes - node.path_v); ++e) {
        for (int d = 0; d < n_i; ++d) { place(state.MbarR_inv_root(d, e), node.path_v + e - a, l[at(d)]); }
      }
      std::array<Lanes, n_i> moves = l;  // what the frames move by: a free one does not follow the ancestors' columns
      [[maybe_unused]] Lanes undone = Lanes::Zero();  // of q̈, against the inlet's rate about the same axis
      std::array<Lanes, 6> y;
      y.fill(Lanes::Zero());
      if (a < needed) {
        for (int c = 0; c < 6; ++c) { y[at(c)] = load(inlet + components * a + c * lanes); }
        shift(state.r, y);
        if constexpr (Workspace::update == Update::square_root) {
          if (ws.root(node.inlet).keeps_v) {
            const SharedAxis<Scalar>& shared = ws.shared_axis(node.index);
            const Lanes along_inlet = load(inlet + components * a + rate * lanes);
            for (int c = 0; c < 6; ++c) { y[at(c)] += shared.difference(c) * along_inlet; }
            undone = shared.share * along_inlet;
          }
        }
        for (int d = 0; d < n_i; ++d) {
          for (int c = 5; c >= 0; --c) { l[at(d)] -= state.W(d, c) * y[at(c)]; }
        }
        if constexpr (is_free<S>()) { y.fill(Lanes::Zero()); }
      }
      if constexpr (!is_free<S>()) { moves = l; }
      if constexpr (apart) {
        store(frames[0] + components * a + rate * lanes, l[0]);
        l[0] -= undone;
      }
      for (int d = 0; d < n_i; ++d) { store(L_rows + d * depth + a, l[at(d)]); }
      for (int k = 0; k < S::n_frames; ++k) {
        for (int c = 0; c < 6; ++c) {
          Lanes h = y[at(c)];
          if (!apart && (c < 3 ? S::pattern.linear : S::pattern.angular)) {
            for (int d = 0; d < n_i; ++d) { h += state.S_k[at(k)](c, d) * moves[at(d)]; }
          }
          store(frames[at(k)] + components * a + c * lanes, h);
        }
      }
    }
  }

  /// X(r), one product after the other: six multiply-adds instead of nine operations (3 % of this file's time).
  [[gnu::always_inline]] static void shift(const Vector3<Scalar>& r, std::array<Lanes, 6>& y)
  {
    y[0] += y[4] * r(2);
    y[1] += y[5] * r(0);
    y[2] += y[3] * r(1);
    y[0] -= y[5] * r(1);
    y[1] -= y[3] * r(2);
    y[2] -= y[4] * r(0);
  }

  /// x into a lane that is zero.
  [[gnu::always_inline]] static void place(const Scalar& x, Index lane, Lanes& to)
  {
    if constexpr (lanes == 1) {
      to = load(&x);
    } else {
      static constexpr std::array<Scalar, 2 * lanes> unit = [] {
        std::array<Scalar, 2 * lanes> numbers{};
        numbers[lanes] = 1;
        return numbers;
      }();
      to += load(unit.data() + lanes - lane) * x;
    }
  }

  /// β = Lᵀ B̄ in path positions 0 … depth; zero from there to the end of the limb.
  template <class S, class Workspace>
  void project_motor(const Workspace& ws, const Input<Scalar>& input, Index column, Index depth)
  {
    for (Index j = 0; j < input.size; ++j) {
      Scalar* beta = beta_.data() + (column + j) * depth_;
      const Scalar* Bbar = ws.Bbar().data() + input.bbar + j * S::n_i;
      for (Index a = 0; a < depth; a += lanes) {
        Lanes sum = Lanes::Zero();
        for (int d = 0; d < S::n_i; ++d) { sum += load(L_rows_.data() + (input.v + d) * depth_ + a) * Bbar[d]; }
        store(beta + a, sum);
      }
    }
  }

  /// β = Hᵀ w: velocities of the point, and of its body, per path position; the same zeros.
  template <class Workspace>
  void project_point(const Workspace& ws, const Input<Scalar>& input, Index column, Index depth)
  {
    const FrameState<Scalar>& f = ws.frame(input.frame);
    Vector3<Scalar> x = f.r;
    add(x, times(f.R, input.point));
    Matrix3<Scalar> axes;
    const bool turned = input.axes == Axes::body;
    if (turned) { detail::multiply(f.R, input.R, axes); }
    const Scalar* h = H(input.frame);
    Scalar* beta = beta_.data() + column * depth_;
    for (Index a = 0; a < depth; a += lanes) {
      std::array<Lanes, 6> V;
      for (int c = 0; c < 6; ++c) { V[at(c)] = load(h + components * a + c * lanes); }
      if constexpr (Workspace::update == Update::square_root) {
        const RootInertia<Scalar>& N = ws.root(input.frame);
        const Lanes q_dot = load(h + components * a + rate * lanes);
        for (int c = 0; c < 6 && N.keeps_v; ++c) { V[at(c)] += N.S(c) * q_dot; }
      }
      shift(x, V);
      for (int c = 0; c < static_cast<int>(input.size); ++c) {
        if (turned) {
          const int first = c < 3 ? 0 : 3;
          const Lanes v = V[at(first)] * axes(0, c - first) + V[at(first + 1)] * axes(1, c - first) +
                          V[at(first + 2)] * axes(2, c - first);
          store(beta + c * depth_ + a, v);
        } else {
          store(beta + c * depth_ + a, V[at(c)]);
        }
      }
    }
  }

  /// Step 3: B̂ = L β, limb by limb: the path positions of a limb take the inputs on its subtree to the rows of it.
  template <class Matrix>
  void multiply_all(Matrix& Bhat)
  {
    if (roots_ != 1) { Bhat.setZero(); }
    for (Index k = 0; k < limbs_.size(); ++k) {
      const auto [subsystem, subtree_end] = limb_subsystems_[static_cast<std::size_t>(k)];
      const Index end = first_column_[static_cast<std::size_t>(subtree_end)];
      Index j = first_column_[static_cast<std::size_t>(subsystem)];
      for (; j + tile <= end; j += tile) { multiply_tile<tile>(limbs_[k], j, Bhat); }
      if constexpr (tile > 4 || is_register<Scalar>) {
        for (; j + 4 <= end; j += 4) { multiply_tile<4>(limbs_[k], j, Bhat); }
        for (; j + 2 <= end; j += 2) { multiply_tile<2>(limbs_[k], j, Bhat); }
      }
      for (; j < end; ++j) { multiply_tile<1>(limbs_[k], j, Bhat); }
    }
  }

  /// L from its rows, a square of registers at a time: against storing every entry where it arises, one input on a chain of
  /// 10 to 50 takes 20 to 30 % less after the O(n) pass, all inputs 3 %.
  void transpose_L()
  {
    const Index n = static_cast<Index>(path_end_.size());
    for (Index v = 0; v < n; v += lanes) {
      Index end = 0;
      for (Index r = v; r < std::min(n, v + lanes); ++r) { end = std::max(end, path_end_[static_cast<std::size_t>(r)]); }
      for (Index a = 0; a < end; a += side) {
        for (int part = 0; part < lanes; part += side) {
          transpose(L_rows_.data() + (v + part) * depth_ + a, depth_, L_.data() + a * rows_ + v + part, rows_);
        }
      }
    }
  }

  /// A block of `side` × `side` numbers, rows to columns: bit by bit of the indices, rows r and r + step exchange lanes.
  [[gnu::always_inline]] static void transpose(const Scalar* from, Index from_stride, Scalar* to, Index to_stride)
  {
    using Vector [[gnu::vector_size(side * sizeof(Scalar))]] = Scalar;
    Vector rows[side];
    for (int r = 0; r < side; ++r) { std::memcpy(&rows[r], from + r * from_stride, sizeof(Vector)); }
    const auto exchange = [&]<int step, int... k>(std::integral_constant<int, step>, std::integer_sequence<int, k...>) {
      for (int r = 0; r < side; ++r) {
        if ((r & step) != 0) { continue; }
        const Vector upper = rows[r], lower = rows[r + step];
        rows[r] = __builtin_shufflevector(upper, lower, ((k & step) == 0 ? k : k - step + side)...);
        rows[r + step] = __builtin_shufflevector(upper, lower, ((k & step) == 0 ? k + step : k + side)...);
      }
    };
    constexpr std::make_integer_sequence<int, side> lane;
    if constexpr (side > 1) { exchange(std::integral_constant<int, 1>{}, lane); }
    if constexpr (side > 2) { exchange(std::integral_constant<int, 2>{}, lane); }
    if constexpr (side > 4) { exchange(std::integral_constant<int, 4>{}, lane); }
    for (int r = 0; r < side; ++r) { std::memcpy(to + r * to_stride, &rows[r], sizeof(Vector)); }
  }

  /// `count` columns of the product for one limb. Rows of the limb itself are zero beyond their own path position.
  template <int count, class Matrix>
  [[gnu::noinline]] void multiply_tile(const Limb& limb, Index column, Matrix& Bhat)
  {
    Index depth = 0;
    std::array<Scalar*, count> target;
    for (int j = 0; j < count; ++j) {
      const Column& c = columns_[static_cast<std::size_t>(column + j)];
      depth = std::max(depth, c.depth);
      target[at(j)] = Bhat.data() + c.bhat * Bhat.rows();
    }
    depth = std::min(depth, limb.end);
    if constexpr (is_register<Scalar>) {
      const LimbTile<Scalar, count> all{limb, depth, L_rows_.data(), depth_, beta_.data() + column * depth_, depth_,
                                        path_end_.data(), target};
      multiply(all, check_);
      return;
    }
    const Index stride = depth_;
    const Index step = lanes == 1 ? 1 : rows_;
    for (Index v = limb.v; v < limb.v_end; v += lanes) {
      const Index rows = std::min<Index>(lanes, limb.v_end - v);
      const Index end = std::min(depth, path_end_[static_cast<std::size_t>(v + rows - 1)]);
      const Scalar* l = lanes == 1 ? L_rows_.data() + v * stride + limb.begin : L_.data() + limb.begin * step + v;
      const Scalar* beta = beta_.data() + column * stride + limb.begin;
      std::array<Lanes, count> sum;
      for (int j = 0; j < count; ++j) { sum[at(j)].setZero(); }
      for (Index a = limb.begin; a < end; ++a, l += step, ++beta) {
        const Lanes L = load(l);
        for (int j = 0; j < count; ++j) { sum[at(j)] += L * beta[j * stride]; }
      }
      for (int j = 0; j < count; ++j) { write<lanes>(target[at(j)] + v, sum[at(j)], 0, rows, limb.parent < 0); }
    }
  }

  /// The first `rows` lanes, in runs of halving length: a limb rarely has a multiple of the lanes.
  template <int run>
  static void write(Scalar* target, const Lanes& sum, int done, Index rows, bool assign)
  {
    if (rows - done >= run) {
      using Run = Eigen::Array<Scalar, run, 1>;
      Eigen::Map<Run> to(target + done);
      const Run part = sum.template segment<run>(done);
      if (assign) {
        to = part;
      } else {
        to += part;
      }
      done += run;
    }
    if constexpr (run > 1) { write<run / 2>(target, sum, done, rows, assign); }
  }

  static constexpr std::size_t at(int k) { return static_cast<std::size_t>(k); }

  struct Range {
    Index begin, end;
  };

  const Tree* tree_;
  Limbs limbs_;
  FrameBuffers frame_buffers_;
  SortedInputs<Tree> inputs_;
  Index depth_;             // padded length of the longest path
  Index rows_;              // n_v, padded so that lanes may begin at any row
  MatrixX<Scalar> L_rows_;  // depth × n_v: Lᵀ = (Γ⁻¹ diag(C))ᵀ; entry (a, v) belongs to the a-th velocity on v's path
  MatrixX<Scalar> L_;       // rows × depth: its transpose, where lanes > 1
  MatrixX<Scalar> beta_;    // depth × m
  std::vector<VectorX<Scalar>> H_;  // of a frame: per `lanes` path positions six components, so that one address serves
  std::vector<Index> path_end_;         // of a row: path positions up to and including its subsystem
  std::vector<Range> limb_subsystems_;  // of a limb: subsystems of its subtree
  std::vector<Index> first_column_;     // of a subsystem: active columns, sorted, on those before it
  std::vector<Index> needed_;           // of a subsystem: path positions of ancestors that an input reaches
  std::vector<Column> columns_;         // sorted along the tree
  Index roots_ = 0;
  Scalar check_;  // the sum of all that was written to B̂, if Scalar is a register
};

}  // namespace iim::detail
