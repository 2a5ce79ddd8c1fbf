// What the O(n) pass leaves behind for the input-Jacobian methods: sized once, then only overwritten.
#pragma once

#include <iim/node_state.hpp>
#include <iim/numerics/array.hpp>
#include <iim/pass/bodies_beyond.hpp>
#include <iim/pass/joint_lines.hpp>
#include <iim/pass/parallel_axes.hpp>
#include <iim/pass/second_look.hpp>
#include <iim/pass/type_facts.hpp>
#include <iim/pass/workspace_data.hpp>
#include <iim/square_root/common_motion.hpp>
#include <iim/subsystem.hpp>
#include <iim/tree.hpp>
#include <iim/update.hpp>

#include <cstddef>
#include <type_traits>
#include <utility>

namespace iim {

/// Intermediates of the O(n) pass over one tree. Construction allocates; nothing after it does.
/// One per thread; the tree may be shared. Refers to the tree, which must stay where it is.
template <class TreeType, Update update_ = Update::projected>
class Workspace : public detail::WorkspaceData<typename TreeType::Scalar, update_> {
public:
  using Tree = std::remove_const_t<TreeType>;
  using Scalar = typename Tree::Scalar;
  using Data = detail::WorkspaceData<Scalar, update_>;
  using Data::update;

  [[gnu::cold]] explicit Workspace(const Tree& tree) : Data(tree), nodes_(tree)
  {
    detail::JointLines<Scalar> lines(tree.size());
    detail::InletTwists<Scalar> twists;
    detail::Array<detail::TypeFacts<Scalar>> facts(static_cast<std::size_t>(tree.size()));
    tree.outward([&]<class S>(const Node& node, const S& s) {
      lines.set(node.index, s);
      facts[static_cast<std::size_t>(node.index)] = detail::facts_of(s, tree.frame_mass(node.frame));
      if constexpr (update == Update::square_root) {
        if (node.inlet >= 0 && this->root(node.inlet).is_free) { twists.add(node, s, tree); }
      }
      // What a motion pattern declares zero is written here, once.
      NodeState<S>& state = this->node<S>(node);
      for (int k = 0; k < S::n_frames; ++k) {
        state.S_k[static_cast<std::size_t>(k)].setZero();
        this->frame(node.frame + k).offset = detail::is_placed_off<S>();
      }
      if constexpr (Data::update == Update::square_root && detail::is_free<S>()) {
        this->root(node.frame).is_free = true;
      }
      if constexpr (detail::one_column<S, Data>) {
        this->root(node.frame).keeps_v = true;
        if constexpr (detail::has_own_twist<S>()) {
          this->frame_body_[static_cast<std::size_t>(node.frame)].set_own_twist(s.own_twist());
        }
      }
      if constexpr (detail::has_own_twist<S>()) { state.own = {tree.frame_mass(node.frame), s.own_twist()}; }
      if constexpr (update == Update::square_root) {
        this->add_tape(node, S::n_i, S::n_frames, detail::rotor_count<S>() + detail::spring_count<S>());
      }
      state.W.setZero();
      state.c.setZero();
      state.r.setZero();
      state.R = tree.placement(node.index).R;
      if constexpr (detail::takes_turn<S>()) { this->turns_.add(node.q); }
    });
    this->turns_.allocate();
    this->choose_free_axes(facts, twists);
    if constexpr (update == Update::square_root) {
      this->find_shared(lines, twists);
    } else {
      this->axes_ = detail::ParallelAxes<Scalar>(tree, facts, !detail::mends<Data>);
      this->find_limbs(lines);
    }
    this->choose_inlet_axes();
    if constexpr (detail::is_several<Scalar>) {
      this->places_.allocate(tree, update == Update::square_root, this->frames_);
    }
    find_numbers();
    if constexpr (detail::refines<Data>) {
      this->bodies_beyond_.find_coaxial(tree, lines);
      this->second_look_.find_planes(tree, facts);
    }
  }

  explicit Workspace(const Tree&&) = delete;
  Workspace(const Workspace& other) : Data(other), nodes_(other.nodes_) { find_numbers(); }
  Workspace(Workspace&& other) : Data(std::move(other)), nodes_(std::move(other.nodes_)) { find_numbers(); }
  Workspace& operator=(Workspace other)
  {
    Data::operator=(std::move(other));
    nodes_ = std::move(other.nodes_);
    find_numbers();
    return *this;
  }
  ~Workspace() = default;

  const Tree& tree() const { return static_cast<const Tree&>(*this->tree_); }

  template <class S>
  NodeState<S>& node(const Node& node)
  {
    return nodes_.template at<S>(node);
  }
  template <class S>
  const NodeState<S>& node(const Node& node) const
  {
    return nodes_.template at<S>(node);
  }

private:
  /// Tells frames and bodies_beyond() where numbers are.
  [[gnu::cold]] void find_numbers()
  {
    if constexpr (detail::is_several<Scalar>) { this->places_.put(this->frames_); }
    if constexpr (detail::refines<Data>) {
      detail::BodiesBeyond<Scalar>& bodies = this->bodies_beyond_;
      bodies.clear();
      tree().outward([&]<class S>(const Node& node, const S& s) {
        const NodeState<S>& state = this->node<S>(node);
        bodies.add(s, this->inlet_axes(node, state), state);
      });
      bodies.allocate(tree(), detail::mends_several<Data>);
      this->second_look_.allocate(tree(), update == Update::square_root);
      if constexpr (detail::refines_root<Data>) {
        if (detail::outweigh_free<Scalar>(this->free_axes_, tree())) { this->second_look_.leave_heavy(); }
      }
    }
  }

  typename Tree::template Storage<NodeState> nodes_;
};

template <class TreeType>
Workspace(const TreeType&) -> Workspace<TreeType>;

}  // namespace iim
