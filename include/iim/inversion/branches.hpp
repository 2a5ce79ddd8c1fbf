// What the methods know of a tree's branching: unbranched runs of subsystems, velocities numbered along a path, columns
// of B̂ sorted along the tree.
//
// Velocities are numbered depth first, so that those of a subtree are one range. The velocities on the path from the
// world to a subsystem are numbered too, from 0: the path positions. Row v of a matrix that is non-zero only on v's
// path (L, Γ⁻¹, the lower half of M) is kept in path positions: no zero of the branching is stored or multiplied.
#pragma once

#include <iim/inputs.hpp>
#include <iim/numerics/array.hpp>
#include <iim/numerics/lane_count.hpp>
#include <iim/spatial.hpp>
#include <iim/tree.hpp>

#include <algorithm>
#include <cstddef>

namespace iim::detail {

/// An unbranched run of subsystems.
struct Limb {
  Index parent;      ///< limb that it hangs on; −1: the world
  Index begin, end;  ///< path positions of its own velocities
  Index v;           ///< its first velocity: path position a is velocity v + (a − begin)
  Index v_end;       ///< first velocity after its subtree
};

/// The limbs of a tree, parents before children.
class Limbs {
public:
  template <class Scalar>
  [[gnu::cold]] explicit Limbs(const TreeData<Scalar>& tree) : depth_(tree.max_path_v())
  {
    Array<Index> children(static_cast<std::size_t>(tree.size()), 0);
    for (const Node& node : tree.nodes()) {
      if (node.parent >= 0) { ++children[static_cast<std::size_t>(node.parent)]; }
    }
    for (const Node& node : tree.nodes()) {
      const Index own = tree.velocities(node.index);
      if (node.parent >= 0 && children[static_cast<std::size_t>(node.parent)] == 1) {
        limb_of_.push_back(limb_of(node.parent));
        limbs_[static_cast<std::size_t>(limb_of_.back())].end += own;
      } else {
        limb_of_.push_back(size());
        limbs_.push_back(
            {node.parent < 0 ? -1 : limb_of(node.parent), node.path_v, node.path_v + own, node.v, node.v_end});
      }
      for (Index d = 0; d < own; ++d) { limb_of_velocity_.push_back(limb_of_.back()); }
    }
  }

  /// All n velocities on one path, whatever the tree: for dense matrices.
  static Limbs unbranched(Index n)
  {
    Limbs limbs;
    limbs.depth_ = n;
    limbs.limbs_.push_back({-1, 0, n, 0, n});
    limbs.limb_of_velocity_.assign(static_cast<std::size_t>(n), 0);
    return limbs;
  }

  Index size() const { return static_cast<Index>(limbs_.size()); }
  Index depth() const { return depth_; }  ///< path positions of the longest path
  Index n_v() const { return static_cast<Index>(limb_of_velocity_.size()); }
  const Limb& operator[](Index limb) const { return limbs_[static_cast<std::size_t>(limb)]; }
  Index limb_of(Index subsystem) const { return limb_of_[static_cast<std::size_t>(subsystem)]; }
  Index limb_of_velocity(Index v) const { return limb_of_velocity_[static_cast<std::size_t>(v)]; }
  Index path_position(Index v) const  ///< of a velocity
  {
    const Limb& limb = (*this)[limb_of_velocity(v)];
    return limb.begin + (v - limb.v);
  }

  /// Calls f(first path position, first velocity, count) for the runs that path positions begin … end of `limb`'s path
  /// consist of, from the limb towards the world.
  template <class F>
  [[gnu::always_inline]] void for_each_run(Index limb, Index begin, Index end, F&& f) const
  {
    for (; limb >= 0; limb = (*this)[limb].parent) {
      const Limb& run = (*this)[limb];
      const Index first = std::max(begin, run.begin);
      const Index last = std::min(end, run.end);
      if (first < last) { f(first, run.v + (first - run.begin), last - first); }
      if (run.begin <= begin) { return; }
    }
  }

private:
  Limbs() = default;

  Index depth_ = 0;
  Array<Limb> limbs_;
  Array<Index> limb_of_;  // of a subsystem
  Array<Index> limb_of_velocity_;
};

/// Whether two velocities have more than three path positions in common, in the mean over all pairs: from there on half
/// of a symmetric product of rows of L, copied to the other half, takes less than all of it (several states: chain of
/// 20, with 7, 6 % less; arm of 7, with 2.9, 2 % more; tree of 15, with 1.6, 4 % more).
template <class Scalar>
[[gnu::cold]] bool paths_are_shared(const TreeData<Scalar>& tree)
{
  double common = 0;
  for (const Node& node : tree.nodes()) {
    const auto beyond = static_cast<double>(node.v_end - node.v);
    common += static_cast<double>(tree.velocities(node.index)) * beyond * beyond;
  }
  const auto rows = static_cast<double>(tree.n_v());
  return common > 3 * rows * rows;
}

/// One column of β, sorted along the tree. What it holds depends on which inputs are active, not on the state.
struct BetaColumn {
  Index begin;      ///< place of its first entry in B̂
  Index subsystem;  ///< that the input acts on
  Index depth;      ///< path positions that the input reaches
  Index row;        ///< where it stands, by path position, among the rows of L and what comes after these
};

/// Memory for something per frame that only the frame's children read, on a walk outward: it lives until the last child
/// is done, which may write over it.
class FrameBuffers {
public:
  template <class Scalar>
  [[gnu::cold]] explicit FrameBuffers(const TreeData<Scalar>& tree)
      : of_frame_(static_cast<std::size_t>(tree.n_frames()), -1)
  {
    Array<Index> last_use(of_frame_.size(), -1);
    for (const Node& node : tree.nodes()) {
      if (node.inlet >= 0) { last_use[static_cast<std::size_t>(node.inlet)] = node.index; }
    }
    Array<int> free;
    for (const Node& node : tree.nodes()) {
      const Index end = tree.end_of_frames(node.index);
      if (node.inlet >= 0 && last_use[static_cast<std::size_t>(node.inlet)] == node.index) {
        free.push_back((*this)[node.inlet]);
      }
      for (Index f = node.frame; f < end; ++f) {
        if (free.empty()) { free.push_back(count_++); }
        of_frame_[static_cast<std::size_t>(f)] = free.back();
        free.pop_back();
      }
      for (Index f = node.frame; f < end; ++f) {
        if (last_use[static_cast<std::size_t>(f)] < 0) { free.push_back((*this)[f]); }
      }
    }
  }

  int count() const { return count_; }
  int operator[](Index frame) const { return of_frame_[static_cast<std::size_t>(frame)]; }

private:
  Array<int> of_frame_;
  int count_ = 0;
};

/// Blocks of inputs in the order of the subsystems that they act on: those on a subtree stand together.
template <class Scalar>
class SortedInputs {
public:
  /// Throws ModelError if the inputs are those of another tree.
  [[gnu::cold]] SortedInputs(const TreeData<Scalar>& tree, const InputBlocks<Scalar>& inputs)
      : inputs_(&inputs), begin_(static_cast<std::size_t>(tree.size()) + 1, 0)
  {
    static_cast<void>(inputs.max_columns_on(tree));
    const auto end_of = [&](Index id) -> std::size_t& {
      return begin_[static_cast<std::size_t>(inputs.block(id).subsystem)];
    };
    for (Index id = 0; id < inputs.blocks(); ++id) { ++end_of(id); }
    for (std::size_t i = 1; i < begin_.size(); ++i) { begin_[i] += begin_[i - 1]; }
    order_.resize(static_cast<std::size_t>(inputs.blocks()));
    for (Index id = inputs.blocks() - 1; id >= 0; --id) { order_[--end_of(id)] = id; }
    bhat_column_.assign(order_.size(), -1);
  }

  const InputBlocks<Scalar>& inputs() const { return *inputs_; }

  /// Number of one of its blocks.
  Index id(const Input<Scalar>& block) const { return static_cast<Index>(&block - &inputs_->block(0)); }

  /// Notes which blocks are active now; before the loops below. Returns whether these are others than the last time
  /// (at first: than none).
  bool number_columns()
  {
    if (inputs_->changes() == changes_) { return false; }
    changes_ = inputs_->changes();
    bool same = true;
    for (std::size_t id = 0; id < bhat_column_.size(); ++id) {
      same &= (bhat_column_[id] >= 0) == inputs_->block(static_cast<Index>(id)).active;
    }
    if (same) { return false; }
    Index column = 0;
    for (std::size_t id = 0; id < bhat_column_.size(); ++id) {
      const Input<Scalar>& input = inputs_->block(static_cast<Index>(id));
      bhat_column_[id] = input.active ? column : -1;
      column += input.active ? input.size : 0;
    }
    return true;
  }

  /// Calls f(block, its first column in B̂) for the active blocks that act on a subsystem.
  template <class F>
  [[gnu::always_inline]] void for_each_on(Index subsystem, F&& f) const
  {
    const std::size_t end = begin_[static_cast<std::size_t>(subsystem) + 1];
    for (std::size_t k = begin_[static_cast<std::size_t>(subsystem)]; k < end; ++k) { call(k, f); }
  }

  /// The same for all active blocks, sorted.
  template <class F>
  void for_each(F&& f) const
  {
    for (std::size_t k = 0; k < order_.size(); ++k) { call(k, f); }
  }

private:
  template <class F>
  [[gnu::always_inline]] void call(std::size_t k, F& f) const
  {
    const Input<Scalar>& input = inputs_->block(order_[k]);
    if (input.active) { f(input, bhat_column_[static_cast<std::size_t>(order_[k])]); }
  }

  const InputBlocks<Scalar>* inputs_;
  Index changes_ = -1;  // of the inputs, when they were numbered
  Array<Index> order_;
  Array<std::size_t> begin_;  // of a subsystem: place in order_ of its first block
  Array<Index> bhat_column_;  // of a block: first column of B̂; −1: not active
};

}  // namespace iim::detail
