// What of the product form (product_form.hpp) depends on which inputs are active: the columns of β and where they
// stand, the columns of L and H that are computed.
#pragma once

#include <iim/affine_dynamics.hpp>
#include <iim/inputs.hpp>
#include <iim/inversion/branches.hpp>
#include <iim/numerics/array.hpp>
#include <iim/pass/heavy_frames.hpp>
#include <iim/spatial.hpp>

#include <algorithm>
#include <cstddef>

namespace iim::detail {

/// And the rows of L and β themselves, which are zero where they end.
template <class Scalar>
class ProductPlan {
protected:
  /// least_rows: of L, zeros after its last.
  [[gnu::cold]] ProductPlan(const TreeData<Scalar>& tree, const InputBlocks<Scalar>& inputs, Index least_rows)
      : tree_(&tree), inputs_(tree, inputs), heavy_(tree), depth_(padded<Scalar>(tree.max_path_v())),
        first_beta_(std::max(tree.n_v(), least_rows)), rows_(depth_, first_beta_ + inputs.max_columns()),
        steps_(at(tree.size())), row_end_(at(tree.n_v()), 0), first_row_(at(tree.size()) + 1, 0),
        first_other_(first_row_)
  {
    rows_.setZero();
    const FrameBuffers buffers(tree);
    H_size_ = buffers.count() * components * depth_;
    for (Index f = 0; f < tree.n_frames(); ++f) { H_of_frame_.push_back(buffers[f] * components * depth_); }
    const auto columns = at(inputs.max_columns());
    columns_.reserve(columns);
    scaled_.reserve(columns);
    projections_.reserve(at(inputs.blocks()));
    inputs_.number_columns();
  }

  static constexpr int lanes = lane_count<Scalar>;  ///< columns or rows that one step of a loop treats
  static constexpr int components = 7;              ///< of H per path position

  /// What depends on which inputs are active. Of a subsystem:
  struct Step {
    Index needed = 0;    ///< path positions of ancestors that an input reaches
    Index own = 0;       ///< and how many of its own
    Index own_from = 0;  ///< where the lanes begin that these stand in
    /// Whether H of its frames is read: by children, or for forces (3 % of a tree of 63 after the pass).
    bool hands_on = false;
    /// Places of its rows of L, of H of inlet and first frame (4 % of instructions).
    Index L = 0, inlet = 0, frame = 0;
    std::size_t projections = 0, projections_end = 0;  ///< inputs on it whose β is not a row of L
  };
  struct Projection {
    Index block;
    Index column;  ///< of β
  };
  /// A column that is a row of L, and its B̄.
  struct Scaled {
    Index column;
    Index bbar;  ///< place in Workspace::Bbar
  };

  /// Once, and when other inputs are active than before. At each state, with what the product does likewise, it took 27
  /// % of what comes after the O(n) pass for a tree of 63 links, 23 % for the biped.
  template <class Product>
  void plan(Product& product)
  {
    columns_.clear();
    scaled_.clear();
    projections_.clear();
    const bool rows_first = rows_stand_apart();
    list_columns(rows_first, false, first_row_);
    list_columns(!rows_first, true, first_other_);
    // Columns that no input reaches are not computed; those of a subsystem's ancestors that one does come first.
    for (const Node& node : tree_->nodes()) {
      const bool reached = is_reached(node);
      Step& step = steps_[at(node.index)];
      step.own = reached ? tree_->velocities(node.index) : 0;
      step.L = node.v * depth_;
      step.inlet = node.inlet < 0 ? 0 : H_of_frame_[at(node.inlet)];
      step.frame = H_of_frame_[at(node.frame)];
      step.own_from = reached ? node.path_v / lanes * lanes : depth_;
      step.hands_on = node.subtree_end > node.index + 1;
      for (std::size_t k = step.projections; k < step.projections_end; ++k) {
        step.hands_on |= inputs_.inputs().block(projections_[k].block).kind != InputKind::motor;
        step.hands_on |= heavy_.is_between(node.index);
      }
      const bool guided = node.parent < 0 || is_reached(tree_->node(node.parent));
      step.needed = guided ? Index(node.path_v) : steps_[at(node.parent)].needed;
      for (Index v = node.v; v < node.v + tree_->velocities(node.index); ++v) {
        Index& end = row_end_[at(v)];
        const Index was = end;
        end = padded<Scalar>(step.needed + step.own);
        if (end < was) { std::fill(row(v) + end, row(v) + was, Scalar(0)); }
      }
    }
    rows_.rightCols(rows_.cols() - first_beta_).setZero();
    product.plan(columns_, first_row_, first_other_);
  }

  /// A motor on a single velocity: its column of β is a row of L as it is (but for one that acts on its bodies,
  /// unit_rows.hpp).
  bool is_row(const Input<Scalar>& input) const
  {
    return input.kind == InputKind::motor && tree_->velocities(input.subsystem) == 1 &&
           !heavy_.is_between(input.subsystem);
  }

  /// Whether columns that are rows of L make no more bundles if they come first, where some are bundles of rows as they
  /// are: what comes after the O(n) pass takes 9 % less for the biped with 14 and 26 inputs, 12 % for quadrupeds of 12
  /// motors.
  bool rows_stand_apart() const
  {
    Index rows = 0, others = 0;
    inputs_.for_each([&](const Input<Scalar>& input, Index) { (is_row(input) ? rows : others) += input.size; });
    return padded<Scalar>(rows) + padded<Scalar>(others) <= padded<Scalar>(rows + others);
  }

  /// Columns that are rows of L, or others, or both, sorted along the tree. first_column: of a subsystem, where those
  /// on it begin.
  [[gnu::noinline]] void list_columns(bool rows, bool others, Array<Index>& first_column)
  {
    const Index stride = column_stride<Scalar>(tree_->n_v());
    for (const Node& node : tree_->nodes()) {
      Step& step = steps_[at(node.index)];
      first_column[at(node.index)] = static_cast<Index>(columns_.size());
      step.projections = projections_.size();
      inputs_.for_each_on(node.index, [&](const Input<Scalar>& input, Index bhat) {
        const bool as_it_is = is_row(input);
        if (!(as_it_is ? rows : others)) { return; }
        const auto column = static_cast<Index>(columns_.size());
        if (!as_it_is) { projections_.push_back({inputs_.id(input), column}); }
        for (Index j = 0; j < input.size; ++j) {
          if (as_it_is) { scaled_.push_back({column + j, input.bbar + j}); }
          columns_.push_back({(bhat + j) * stride, node.index, node.path_v + tree_->velocities(node.index),
                              as_it_is ? Index(input.v) : first_beta_ + column + j});
        }
      });
      step.projections_end = projections_.size();
    }
    first_column.back() = static_cast<Index>(columns_.size());
  }

  /// Whether an active input acts on the subtree of a subsystem.
  bool is_reached(const Node& node) const
  {
    const auto begin = at(node.index), end = at(node.subtree_end);
    return first_row_[begin] < first_row_[end] || first_other_[begin] < first_other_[end];
  }

  Scalar* row(Index k) { return rows_.data() + k * depth_; }

  const TreeData<Scalar>* tree_;
  SortedInputs<Scalar> inputs_;
  HeavyFrames<Scalar> heavy_;
  Index depth_;       // padded length of the longest path
  Index first_beta_;  // row
  // depth × …: Lᵀ = (Γ⁻¹ diag(C))ᵀ, entry (a, v) belongs to the a-th velocity on v's path; then β.
  MatrixX<Scalar> rows_;
  Index H_size_;
  Array<Index> H_of_frame_;  // where in H each begins
  Array<Step> steps_;
  Array<Index> row_end_;                  // of a row of L: where its last lanes end
  Array<Index> first_row_, first_other_;  // of a subsystem: where columns on it begin, rows of L and others
  Array<BetaColumn> columns_;             // both, each sorted along the tree
  Array<Scaled> scaled_;
  Array<Projection> projections_;
};

}  // namespace iim::detail
