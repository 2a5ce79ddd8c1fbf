// What of a workspace no type of subsystem comes into: numbers of frames, and what the tree is like whatever its state.
#pragma once

#include <iim/node_state.hpp>
#include <iim/numerics/array.hpp>
#include <iim/numerics/change_count.hpp>
#include <iim/numerics/turns.hpp>
#include <iim/pass/bodies_beyond.hpp>
#include <iim/pass/free_axis.hpp>
#include <iim/pass/heavy_frames.hpp>
#include <iim/pass/joint_lines.hpp>
#include <iim/pass/parallel_axes.hpp>
#include <iim/pass/second_look.hpp>
#include <iim/pass/shared_places.hpp>
#include <iim/pass/type_facts.hpp>
#include <iim/spatial.hpp>
#include <iim/square_root/common_motion.hpp>
#include <iim/square_root/row_tape.hpp>
#include <iim/square_root/square_root.hpp>
#include <iim/subsystem.hpp>
#include <iim/tree_data.hpp>
#include <iim/update.hpp>

#include <cstddef>
#include <span>
#include <type_traits>

namespace iim::detail {

/// What of a workspace depends on Scalar and update alone: all but what each type of subsystem keeps. The steps of the
/// O(n) pass read and write this, so that a type's steps are compiled once whatever the trees that it is in (with what
/// else depends on Scalar alone: laws of three types in 31 % less time).
template <class Scalar_, Update update_>
class WorkspaceData {
public:
  using Scalar = Scalar_;
  static constexpr Update update = update_;

  const TreeData<Scalar>& tree() const { return *tree_; }

  FrameState<Scalar>& frame(Index f) { return frames_[static_cast<std::size_t>(f)]; }
  const FrameState<Scalar>& frame(Index f) const { return frames_[static_cast<std::size_t>(f)]; }

  Array<FrameState<Scalar>>& frames() { return frames_; }
  /// Of FrameInertia, of several states at once.
  auto& places() { return places_; }

  /// Whether the axes in which subsystem i moves are kept apart from those of the frame that it hangs on: placements
  /// turn them, or a step in a group's axes turns one of the two. (Always, several states take 3 % more.)
  bool keeps_inlet_axes(Index i) const { return keeps_inlet_axes_[static_cast<std::size_t>(i)] != 0; }
  /// These, inlet to world.
  template <class Type>
  [[gnu::always_inline]] const Matrix3<Scalar>& inlet_axes(const Node& node, const NodeMemory<Type>& state) const
  {
    return keeps_inlet_axes(node.index) ? state.R : frame(node.inlet).R;
  }

  /// N of what frame f carries; with Update::square_root, in place of FrameInertia::A.
  detail::RootInertia<Scalar>& root(Index f) { return root_[static_cast<std::size_t>(f)]; }
  const detail::RootInertia<Scalar>& root(Index f) const { return root_[static_cast<std::size_t>(f)]; }
  /// The rows on frame f, from when the first of its children hands them on until its own subsystem has.
  typename detail::RootInertia<Scalar>::Rows& rows(Index f) { return rows_[root(f).place]; }
  void clear_rows()
  {
    for (auto& rows : rows_) { rows.count = 0; }
  }
  const detail::BodyRoot<Scalar>& frame_body(Index f) const { return frame_body_[static_cast<std::size_t>(f)]; }
  const detail::BodyRoot<Scalar>& inlet_body(Index i) const { return inlet_body_[static_cast<std::size_t>(i)]; }

  /// S of the frame that subsystem i hangs on, against i's own.
  detail::SharedAxis<Scalar>& shared_axis(Index i) { return shared_axis_[static_cast<std::size_t>(i)]; }
  const detail::SharedAxis<Scalar>& shared_axis(Index i) const { return shared_axis_[static_cast<std::size_t>(i)]; }

  /// Whether inputs on frame f need what the pass did to its rows (unit_rows.hpp): its body is far heavier than one of
  /// those that carry it.
  bool is_heavy(Index f) const { return heavy_.is_heavy(f); }
  /// Whether a load on subsystem i acts as wrenches on the bodies that it is between (unit_rows.hpp).
  bool loads_bodies(Index i) const { return heavy_.is_between(i); }

  /// What was done to the rows of subsystem i, after what was done to those on frame f; nullptr if nothing heavy lies
  /// there or beyond.
  RowTape<Scalar>* tape(Index i) { return is_on(tapes_, i) ? &tapes_[static_cast<std::size_t>(i)] : nullptr; }
  const RowTape<Scalar>& tape(Index i) const { return tapes_[static_cast<std::size_t>(i)]; }
  RowTape<Scalar>* frame_tape(Index f)
  {
    return is_on(frame_tapes_, f) ? &frame_tapes_[static_cast<std::size_t>(f)] : nullptr;
  }
  const RowTape<Scalar>& frame_tape(Index f) const { return frame_tapes_[static_cast<std::size_t>(f)]; }
  void clear_tapes()
  {
    for (RowTape<Scalar>& tape : tapes_) { tape.clear(); }
    for (RowTape<Scalar>& tape : frame_tapes_) { tape.clear(); }
  }

  /// Axes of FrameInertia::A and h, with the other updates.
  detail::ParallelAxes<Scalar>& axes() { return axes_; }
  const detail::ParallelAxes<Scalar>& axes() const { return axes_; }

  /// Free frames that move apart along a child's axis.
  const Array<detail::FreeAxis<Scalar>>& free_axes() const { return free_axes_; }
  detail::FreeAxis<Scalar>& free_axis_of(const detail::FreeLimb<Scalar>& limb) { return free_axes_[limb.axis]; }
  const detail::FreeAxis<Scalar>& free_axis_of(const detail::FreeLimb<Scalar>& limb) const
  {
    return free_axes_[limb.axis];
  }
  /// In matrix form the limbs along an axis, by their numbers.
  std::span<const detail::FreeLimb<Scalar>> limbs(const detail::FreeAxis<Scalar>& axis) const
  {
    return {free_limbs_.data() + axis.first_limb, free_limbs_.data() + axis.end_of_limbs};
  }
  /// That of a free frame; nullptr if it has none.
  detail::FreeAxis<Scalar>* free_axis(Index frame)
  {
    for (detail::FreeAxis<Scalar>& axis : free_axes_) {
      if (axis.frame == frame) { return &axis; }
    }
    return nullptr;
  }
  const detail::FreeAxis<Scalar>* free_axis(Index frame) const
  {
    return const_cast<WorkspaceData&>(*this).free_axis(frame);
  }
  /// In matrix form the limb along such an axis that subsystem i begins; nullptr if it begins none.
  [[gnu::always_inline]] detail::FreeLimb<Scalar>* free_limb(Index i)
  {
    if constexpr (update_ == Update::square_root) { return nullptr; }
    const Index limb = limb_of_[static_cast<std::size_t>(i)];
    return limb < 0 ? nullptr : &free_limbs_[static_cast<std::size_t>(limb)];
  }
  [[gnu::always_inline]] const detail::FreeLimb<Scalar>* free_limb(Index i) const
  {
    return const_cast<WorkspaceData&>(*this).free_limb(i);
  }

  /// Of the joint angles that the pass began with.
  detail::Turns<Scalar>& turns() { return turns_; }

  /// Sums over what a subsystem carries (weak_pivot.hpp).
  detail::BodiesBeyond<Scalar>& bodies_beyond() { return bodies_beyond_; }
  /// At what small pivots leave.
  detail::SecondLook<Scalar>& second_look() { return second_look_; }

  /// How often the workspace has been written: a receipt is good for one of these numbers.
  Index uses() const { return uses_; }
  void begin_use(bool implicit)
  {
    ++uses_;
    implicit_ = implicit;
  }
  /// Whether springs count as inertias: of an implicit step.
  bool is_implicit() const { return implicit_; }

  VectorX<Scalar>& qdd() { return qdd_; }
  const VectorX<Scalar>& qdd() const { return qdd_; }
  /// Generalised forces on the velocities themselves: Bu, less internal forces but those in SpringInertia::force.
  VectorX<Scalar>& load() { return load_; }
  const VectorX<Scalar>& load() const { return load_; }
  VectorX<Scalar>& Bbar() { return Bbar_; }  ///< the q̇ rows of all B̄_i, column by column (Node::bbar)
  const VectorX<Scalar>& Bbar() const { return Bbar_; }

protected:
  [[gnu::cold]] explicit WorkspaceData(const TreeData<Scalar>& tree)
      : tree_(&tree), frames_(static_cast<std::size_t>(tree.n_frames())), qdd_(tree.n_v()), load_(tree.n_v()),
        Bbar_(tree.n_bbar())
  {
    if constexpr (update == Update::square_root) {
      for (Index f = 0; f < tree.n_frames(); ++f) { frame_body_.emplace_back(tree.frame_mass(f)); }
      for (Index i = 0; i < tree.size(); ++i) { inlet_body_.emplace_back(tree.inlet_mass(i)); }
      root_.resize(frames_.size());
      for (Index f = 0; f < tree.n_frames(); ++f) { root(f).own.set(frame_body(f)); }
      place_rows();
      shared_axis_.resize(static_cast<std::size_t>(tree.size()));
      heavy_ = HeavyFrames<Scalar>(tree);
      if (heavy_.any()) {
        tapes_.resize(static_cast<std::size_t>(tree.size()));
        frame_tapes_.resize(frames_.size());
      }
    }
    qdd_.setZero();
    load_.setZero();
    Bbar_.setZero();
    for (FrameState<Scalar>& f : frames_) {
      f.R.setIdentity();
      f.r.setZero();
      f.omega.setZero();
      f.bias.setZero();
      f.Vdot.setZero();
      if constexpr (!is_several<Scalar>) {
        f.h.setZero();
        f.A.set_zero();
      }
    }
  }

  [[gnu::cold]] void place_rows()
  {
    Array<std::size_t> place(root_.size()), vacant;
    share_places(*tree_, Array<char>(root_.size(), false), place, vacant, [&] {
      rows_.emplace_back();
      return rows_.size() - 1;
    });
    for (std::size_t f = 0; f < place.size(); ++f) { root_[f].place = place[f]; }
  }

  /// For a subsystem of n_i velocities, n_frames frames, n_within rotors and springs.
  [[gnu::cold]] void add_tape(const Node& node, int n_i, int n_frames, int n_within)
  {
    constexpr std::size_t rank = 6, most = RootInertia<Scalar>::most;
    const auto at = [](Index k) { return static_cast<std::size_t>(k); };
    if (node.parent >= 0 && heavy_.carries(node.parent)) {  // what any child does to the rows of its inlet
      frame_tapes_[at(node.inlet)].add_room(rank, 2 * (most + rank + at(n_within)), 2);
    }
    if (!heavy_.carries(node.index)) { return; }
    tapes_[at(node.index)].add_room(at(n_i) + rank, (most + rank) * at(n_frames) + at(n_within), at(n_within));
    for (int k = 0; k < n_frames; ++k) {
      frame_tapes_[at(node.frame + k)].add_room(0, 0, 1);
      if (n_i == 0) { frame_tapes_[at(node.frame + k)].add_room(rank, most + rank, 0); }  // what is compressed
    }
  }

  [[gnu::cold]] void choose_inlet_axes()
  {
    for (const Node& node : tree_->nodes()) {
      const Index i = node.index;
      keeps_inlet_axes_.push_back(node.inlet < 0 || tree_->placement_turns(i) || axes_.has_group(node.inlet) ||
                                  axes_.has_group(node.frame));
    }
  }

  /// Of each free frame the child with one column that carries most; in matrix form, one that turns about an axis; in
  /// square-root form, what two heavier ones of several columns have in common.
  [[gnu::cold]] void choose_free_axes(const Array<TypeFacts<Scalar>>& facts, const InletTwists<Scalar>& twists)
  {
    const auto at = [](Index k) { return static_cast<std::size_t>(k); };
    Array<Scalar> carried(facts.size(), Scalar(0));
    Array<Index> child(frames_.size(), -1);
    for (Index i = tree_->size(); i-- > 0;) {
      const Node& node = tree_->node(i);
      const TypeFacts<Scalar>& part = facts[at(i)];
      for (Index f = node.frame; f < tree_->end_of_frames(i); ++f) {
        if (tree_->frame_mass(f).present) { carried[at(i)] += tree_->frame_mass(f).mass; }
      }
      if (part.is_free) {
        const Index heaviest = child[at(node.frame)];
        if constexpr (update == Update::square_root) {
          const auto common = heaviest_common(node.frame, twists, carried, *tree_);
          if (heaviest >= 0 && !(carried[at(heaviest)] < common.carried)) {
            free_axes_.push_back({.frame = node.frame, .child = heaviest});
          } else if (Scalar(0) < common.carried) {
            free_axes_.push_back({.frame = node.frame, .child = -1, .common = common.twist});
          } else {
            continue;
          }
          root(node.frame).keeps_v = true;
        } else {
          const Scalar turning = heaviest >= 0 ? facts[at(heaviest)].turning : Scalar(1);
          free_axes_.push_back({.frame = node.frame, .child = heaviest, .turning = turning});
        }
      } else if (node.inlet >= 0) {
        carried[at(node.parent)] += carried[at(i)];
        Index& heaviest = child[at(node.inlet)];
        const bool suits = update == Update::square_root ? part.keeps_v : part.turns_about_axis;
        // Of equal ones the first, which comes last on the way inward.
        if (suits && (heaviest < 0 || !(carried[at(i)] < carried[at(heaviest)]))) { heaviest = i; }
      }
    }
  }

  /// The limbs along each free axis, and one more frame for them where others hand on after the first of them or have
  /// other axes.
  [[gnu::cold]] void find_limbs(const JointLines<Scalar>& lines)
  {
    limb_of_.assign(static_cast<std::size_t>(tree_->size()), -1);
    const Array<Scalar> moments = free_axes_.empty() ? Array<Scalar>() : moments_about_joints(*tree_);
    for (std::size_t k = 0; k < free_axes_.size(); ++k) {
      FreeAxis<Scalar>& axis = free_axes_[k];
      axis.first_limb = axis.end_of_limbs = free_limbs_.size();
      if (axis.child < 0) { continue; }
      const bool joined = is_outweighed(axis, lines, moments, *tree_);
      bool others_after = false;
      for (const Node& node : tree_->nodes()) {
        if (node.inlet != axis.frame) { continue; }
        const Sense sense = node.index == axis.child ? Sense::same
                            : joined                 ? lines.against_other(node.index, axis.child, *tree_)
                                                     : Sense::none;
        if (sense != Sense::none) {
          limb_of_[static_cast<std::size_t>(node.index)] = static_cast<Index>(free_limbs_.size());
          free_limbs_.push_back({.child = node.index, .axis = k, .sense = sense});
        }
        others_after |= node.index < axis.child;
      }
      axis.end_of_limbs = free_limbs_.size();
      if (limbs(axis).size() == 1 && !others_after && axes_.share(axis.frame, tree_->node(axis.child).frame)) {
        continue;
      }
      axis.receiver = static_cast<Index>(frames_.size());
      frames_.push_back(frames_.front());
    }
  }
  /// In square-root form which joints have the same S as their inlets, or have it among their motions.
  [[gnu::cold]] void find_shared(const JointLines<Scalar>& lines, const InletTwists<Scalar>& twists)
  {
    for (const Node& node : tree_->nodes()) {
      if (node.inlet >= 0 && !root(node.inlet).is_free) {
        shared_axis(node.index).sense = lines.against_inlet(node.index, *tree_);
      }
    }
    for (const FreeAxis<Scalar>& axis : free_axes_) {
      const Vector6<Scalar> S = axis.child < 0 ? axis.common : lines.twist(axis.child, *tree_);
      for (const Node& node : tree_->nodes()) {
        if (node.inlet != axis.frame) { continue; }
        Sense& sense = shared_axis(node.index).sense;
        if (twists.is_known(node.index)) {
          sense = twists.contain(node.index, S) ? Sense::same : Sense::none;
        } else if (axis.child >= 0) {
          const bool is_child = node.index == axis.child;
          sense = is_child ? Sense::same : lines.against_other(node.index, axis.child, *tree_);
        }
      }
    }
  }

  static bool is_on(const Array<RowTape<Scalar>>& tapes, Index k)
  {
    return !tapes.empty() && tapes[static_cast<std::size_t>(k)].is_on();
  }

  const TreeData<Scalar>* tree_;
  Array<FrameState<Scalar>> frames_;
  Array<RootInertia<Scalar>> root_;
  Array<typename RootInertia<Scalar>::Rows> rows_;  // by RootInertia::place
  Array<SharedAxis<Scalar>> shared_axis_;
  Array<BodyRoot<Scalar>> frame_body_;  // of a frame, and on the inlet of a subsystem
  Array<BodyRoot<Scalar>> inlet_body_;
  HeavyFrames<Scalar> heavy_;
  Array<RowTape<Scalar>> tapes_;        // of a subsystem; empty if nothing is heavy
  Array<RowTape<Scalar>> frame_tapes_;  // of a frame
  Turns<Scalar> turns_;
  Array<char> keeps_inlet_axes_;
  [[no_unique_address]] std::conditional_t<is_several<Scalar>, SharedPlaces<Scalar>, Nothing> places_;
  ParallelAxes<Scalar> axes_;
  Array<FreeAxis<Scalar>> free_axes_;
  Array<FreeLimb<Scalar>> free_limbs_;  // in matrix form
  Array<Index> limb_of_;                // of a subsystem: which of them it begins
  VectorX<Scalar> qdd_;
  VectorX<Scalar> load_;
  VectorX<Scalar> Bbar_;
  BodiesBeyond<Scalar> bodies_beyond_;
  SecondLook<Scalar> second_look_;
  ChangeCount uses_;
  bool implicit_ = false;
};

}  // namespace iim::detail
