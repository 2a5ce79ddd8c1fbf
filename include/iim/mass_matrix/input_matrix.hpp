// B (13) without its zeros, from Jacobians in path positions.
//
// A column of B is non-zero only in the velocities on the path from the world to where the input acts; entry a of it is
// the power of the unit input per unit of the a-th of these velocities. For a motor that is B̄_i; for a force at point x
// the velocity of x, for a moment the angular velocity of the frame, both rows of
//
//     outward   y = X(r) J_inlet,   J_k(:, a) = y(:, a) on ancestors,   J_k(:, i) = S_k
#pragma once

#include <iim/inputs.hpp>
#include <iim/inversion/branches.hpp>
#include <iim/numerics/array.hpp>
#include <iim/numerics/registers.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>
#include <iim/workspace.hpp>

#include <algorithm>
#include <array>
#include <cstddef>

namespace iim::detail {

/// Jacobians of frames at their coupling points, along the path: six rows of path positions per frame.
template <class Tree>
class PathJacobian {
public:
  using Scalar = typename Tree::Scalar;
  static constexpr int lanes = lane_count<Scalar>;

  explicit PathJacobian(const Tree& tree)
      : depth_(padded<Scalar>(tree.max_path_v())), of_frame_(tree),
        buffers_(static_cast<std::size_t>(of_frame_.count()), Buffer::Zero(depth_, 6))
  {
  }

  Index depth() const { return depth_; }

  /// Rows of a frame: component c at rows(frame) + c·depth(). Good until the last child of the frame is done.
  Scalar* rows(Index frame) { return buffers_[static_cast<std::size_t>(of_frame_[frame])].data(); }

  /// The frames of one subsystem, its inlet's being known. Calls visit(a, y) with the lanes a … of y on the way.
  template <class S, class N, class Visit>
  [[gnu::always_inline]] void propagate(const N& node, const NodeState<S>& state, Visit&& visit)
  {
    if (node.path_v > 0) {
      const Scalar* from = rows(node.inlet);
      for (Index a = 0; a < node.path_v; a += lanes) {
        std::array<Strip<Scalar>, 6> y;
        for (int c = 0; c < 6; ++c) { y[at(c)] = load(from + c * depth_ + a); }
        move_twist(state.r, y);
        visit(a, y);
        for (int k = 0; k < S::n_frames; ++k) {
          Scalar* to = rows(node.frame + k) + a;
          for (int c = 0; c < (to == from + a ? 3 : 6); ++c) { store(to + c * depth_, y[at(c)]); }
        }
      }
    }
    for (int k = 0; k < S::n_frames; ++k) {
      Scalar* to = rows(node.frame + k) + node.path_v;
      for (int d = 0; d < S::n_i; ++d) {
        for (int c = 0; c < 6; ++c) { to[c * depth_ + d] = state.S_k[at(k)](c, d); }
      }
    }
  }

private:
  using Buffer = Eigen::Matrix<Scalar, Eigen::Dynamic, 6>;

  Index depth_;
  FrameBuffers of_frame_;
  Array<Buffer> buffers_;
};

/// Columns of B for the active inputs, sorted along the tree. Refers to tree and inputs.
template <class Tree>
class InputMatrix {
public:
  using Scalar = typename Tree::Scalar;

  struct Column {
    Index bhat;        ///< column of B̂
    Index subsystem;   ///< that the input acts on
    Index begin, end;  ///< path positions that are not zero
  };

  InputMatrix(const Tree& tree, const Inputs<Tree>& inputs)
      : tree_(&tree), jacobian_(tree), sorted_(tree, inputs), entries_(jacobian_.depth(), inputs.max_columns()),
        columns_(static_cast<std::size_t>(inputs.max_columns())), needed_(static_cast<std::size_t>(tree.size()), 0)
  {
    entries_.setZero();
  }

  PathJacobian<Tree>& jacobian() { return jacobian_; }
  const InputBlocks<Scalar>& inputs() const { return sorted_.inputs(); }

  /// Before the walk outward on which `project` is called for every subsystem.
  void begin()
  {
    sorted_.number_columns();
    count_ = 0;
  }

  /// Columns of the inputs on one subsystem, whose Jacobians are known.
  template <class S, class N, class Workspace>
  [[gnu::always_inline]] void project(const N& node, const Workspace& ws)
  {
    sorted_.for_each_on(node.index, [&](const Input<Scalar>& input, Index bhat) {
      const bool motor = input.kind == InputKind::motor;
      Scalar* entries = entries_.data() + count_ * entries_.rows();
      for (Index j = 0; j < input.size; ++j) {
        columns_[static_cast<std::size_t>(count_++)] = {bhat + j, node.index, motor ? Index(node.path_v) : 0,
                                                        node.path_v + S::n_i};
        for (int d = 0; motor && d < S::n_i; ++d) {
          entries[j * entries_.rows() + node.path_v + d] = ws.Bbar()(input.bbar + j * S::n_i + d);
        }
      }
      if (!motor) { project_point(ws.frame(input.frame), input, node.path_v + S::n_i, entries); }
    });
  }

  /// All columns, for a method that needs Jacobians for nothing else: only along paths to active points.
  template <class Workspace>
  void compute(const Workspace& ws)
  {
    begin();
    std::fill(needed_.begin(), needed_.end(), char(0));
    sorted_.for_each([&](const Input<Scalar>& input, Index) {
      if (input.kind == InputKind::motor) { return; }
      for (Index i = input.subsystem; i >= 0 && needed_[static_cast<std::size_t>(i)] == 0; i = tree_->node(i).parent) {
        needed_[static_cast<std::size_t>(i)] = 1;
      }
    });
    tree_->outward([&]<class N, class S>(const N& node, const S&) {
      if (needed_[static_cast<std::size_t>(node.index)] != 0) {
        jacobian_.template propagate<S>(node, ws.template node<S>(node), [](Index, const auto&) {});
      }
      project<S>(node, ws);
    });
  }

  Index size() const { return count_; }
  const Column& column(Index j) const { return columns_[static_cast<std::size_t>(j)]; }
  /// Entries of column j by path position.
  const Scalar* entries(Index j) const { return entries_.data() + j * entries_.rows(); }
  Index stride() const { return entries_.rows(); }
  /// Columns as in B̂, into a matrix of zeros.
  void put(const Limbs& limbs, MatrixX<Scalar>& B) const
  {
    for (Index j = 0; j < size(); ++j) {
      const Column& own = column(j);
      limbs.for_each_run(limbs.limb_of(own.subsystem), own.begin, own.end, [&](Index a, Index v, Index count) {
        std::copy(entries(j) + a, entries(j) + a + count, B.data() + own.bhat * B.rows() + v);
      });
    }
  }

private:
  /// Velocities of a point, and of its frame, per path position.
  void project_point(const FrameState<Scalar>& f, const Input<Scalar>& input, Index end, Scalar* entries)
  {
    constexpr int lanes = lane_count<Scalar>;
    Vector3<Scalar> x = f.r;
    add(x, times(f.R, input.point));
    Matrix3<Scalar> axes;
    const bool turned = input.axes == Axes::body;
    if (turned) { multiply(f.R, input.R, axes); }
    const Scalar* J = jacobian_.rows(input.frame);
    const Index depth = entries_.rows();
    for (Index a = 0; a < end; a += lanes) {
      std::array<Strip<Scalar>, 6> V;
      for (int c = 0; c < 6; ++c) { V[at(c)] = load(J + c * depth + a); }
      move_twist(x, V);
      for (int c = 0; c < static_cast<int>(input.size); ++c) {
        if (turned) {
          const int first = c < 3 ? 0 : 3;
          const Strip<Scalar> along = V[at(first)] * axes(0, c - first) + V[at(first + 1)] * axes(1, c - first) +
                                      V[at(first + 2)] * axes(2, c - first);
          store(entries + c * depth + a, along);
        } else {
          store(entries + c * depth + a, V[at(c)]);
        }
      }
    }
  }

  const Tree* tree_;
  PathJacobian<Tree> jacobian_;
  SortedInputs<Scalar> sorted_;
  MatrixX<Scalar> entries_;  // path positions × columns
  Array<Column> columns_;
  Index count_ = 0;
  Array<char> needed_;
};

}  // namespace iim::detail
