// One bias and one acceleration pass for several inputs at once: columns of B̂ without anything of size n².
//
// With p_k the wrench on frame k (its sign is that of an applied force, p = −h̄*) the input part of (15), (18) and (19) is
//
//     inward    τ = Σ_k S_kᵀ p_k + B̄_i e,   p_inlet += X(r)ᵀ (Σ_k p_k − Wᵀ τ)                       (23)
//     outward   y = X(r) V̇_inlet,   q̈_i = M̄_R⁻¹ τ − W y,   V̇_k = y + S_k q̈_i                       (27), (19)
//
// In square-root form Sᵀ p and S q̈ of a frame with one S are kept apart, so that a child on nearly the same axis sees the
// difference only (SharedAxis).
// Inward only subsystems between an input and the world have a wrench; outward only trees that an input acts on move.
#pragma once

#include <iim/branches.hpp>
#include <iim/inputs.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>
#include <iim/workspace.hpp>

#include <algorithm>
#include <array>
#include <cassert>
#include <cstddef>
#include <type_traits>
#include <vector>

namespace iim::detail {

/// Columns of B̂, `width` at a time. Construction allocates O(n_v·width); nothing after it does. Refers to the tree.
template <class Tree, int width>
class Sweep {
public:
  using Scalar = typename Tree::Scalar;

  Sweep(const Tree& tree, const Inputs<Tree>& inputs)
      : tree_(&tree), sorted_(inputs), frames_(static_cast<std::size_t>(tree.n_frames())),
        along_(static_cast<std::size_t>(tree.n_frames()), zero()),
        rows_(static_cast<std::size_t>(tree.n_v())), reach_(static_cast<std::size_t>(tree.size()), at_rest)
  {
    for (Six& six : frames_) { six.fill(zero()); }
    for (Lane& row : rows_) { row = zero(); }
    tree.outward([&]<class N, class S>(const N&, const S&) { own_.push_back({S::n_frames, S::n_i, is_free<S>()}); });
  }

  /// Writes all active columns (n_v × inputs.columns()). The workspace holds the O(n) pass of the state.
  template <class Workspace, class Matrix>
  void operator()(const Workspace& ws, Matrix& Bhat)
  {
    assert(Bhat.cols() == sorted_.inputs().columns() && Bhat.rows() == tree_->n_v());
    std::array<Index, width> columns;
    int lane = 0;
    const auto finish = [&] {
      inward(ws);
      outward(ws);
      for (int l = 0; l < lane; ++l) {
        Scalar* target = Bhat.data() + columns[at(l)] * Bhat.rows();
        for (const Lane& row : rows_) { *target++ = entry(row, l); }
      }
      lane = 0;
      std::fill(reach_.begin(), reach_.end(), at_rest);
    };
    sorted_.number_columns();
    sorted_.for_each([&](const Input<Scalar>& input, Index column) {
      for (Index j = 0; j < input.size; ++j) {
        columns[at(lane)] = column + j;
        act(ws, input, j, lane++);
        if (lane == width) { finish(); }
      }
    });
    if (lane > 0) { finish(); }
  }

private:
  using Lane = std::conditional_t<width == 1, Scalar, Eigen::Array<Scalar, width, 1>>;
  using Six = std::array<Lane, 6>;
  enum Reach : char {
    at_rest,  ///< no input of this block reaches it
    carried,  ///< moves with its parent
    acted     ///< lies between an input and the world
  };

  static Lane zero()
  {
    if constexpr (width == 1) {
      return Scalar(0);
    } else {
      return Lane::Zero();
    }
  }
  template <class L>
  static auto& entry(L& lane, int l)
  {
    if constexpr (width == 1) {
      return lane;
    } else {
      return lane.coeffRef(l);
    }
  }
  static const Scalar& entry(const Lane& lane, int l)
  {
    if constexpr (width == 1) {
      return lane;
    } else {
      return lane.data()[l];
    }
  }

  /// The unit in column j of an input, on its subsystem; clears what the inward pass adds to on the path to the world.
  template <class Workspace>
  void act(const Workspace& ws, const Input<Scalar>& input, Index j, int lane)
  {
    for (Index i = input.subsystem; i >= 0 && reach_[at(i)] != acted; i = own_[at(i)].free ? -1 : tree_->node(i).parent) {
      const Node& node = tree_->node(i);
      reach_[at(i)] = acted;
      for (int k = 0; k < own_[at(i)].frames; ++k) { frames_[at(node.frame + k)].fill(zero()); }
      along_[at(node.frame)] = zero();
      for (int d = 0; d < own_[at(i)].velocities; ++d) { rows_[at(node.v + d)] = zero(); }
    }
    if (input.kind == InputKind::motor) {
      for (Index d = 0; d < input.velocities; ++d) {
        entry(rows_[at(input.v + d)], lane) = ws.Bbar()(input.bbar + j * input.velocities + d);
      }
    } else {
      const Vector6<Scalar> w = input_wrench(input, ws.frame(input.frame), j);
      for (int c = 0; c < 6; ++c) { entry(frames_[at(input.frame)][at(c)], lane) = w(c); }
      if constexpr (Workspace::update == Update::square_root) {
        const RootInertia<Scalar>& f = ws.root(input.frame);
        for (int c = 0; c < 6 && f.keeps_v; ++c) { entry(along_[at(input.frame)], lane) += f.S(c) * w(c); }
      }
    }
  }

  /// Wrenches from the inputs to the world; leaves M̄_R⁻¹ τ in rows_.
  template <class Workspace>
  void inward(const Workspace& ws)
  {
    tree_->inward([&]<class N, class S>(const N& node, const S&) {
      constexpr int n_i = S::n_i;
      if (reach_[at(node.index)] != acted) { return; }
      const NodeState<S>& state = ws.template node<S>(node);
      constexpr bool apart = one_column<S, Workspace>;
      [[maybe_unused]] Lane share = zero();  // S_iᵀ p' on the inlet's S
      Six p = frames_[at(node.frame)];
      for (int k = 1; k < S::n_frames; ++k) {
        for (int c = 0; c < 6; ++c) { p[at(c)] += frames_[at(node.frame + k)][at(c)]; }
      }
      if constexpr (is_free<S>() && Workspace::update == Update::square_root) {
        move_free(ws.root(node.frame), node, state);
      } else if constexpr (n_i > 0) {
        std::array<Lane, n_i> tau;
        for (int d = 0; d < n_i; ++d) {
          tau[at(d)] = rows_[at(node.v + d)];
          if constexpr (apart) {
            share = -tau[0];
            tau[0] += along_[at(node.frame)];
            break;
          }
          for (int k = 0; k < S::n_frames; ++k) {
            constexpr int first = S::pattern.linear ? 0 : 3, last = S::pattern.angular ? 6 : 3;
            for (int c = first; c < last; ++c) { tau[at(d)] += frames_[at(node.frame + k)][at(c)] * state.S_k[at(k)](c, d); }
          }
        }
        for (int d = 0; d < n_i; ++d) {
          Lane row = tau[0] * state.MbarR_inv(d, 0);
          for (int e = 1; e < n_i; ++e) { row += tau[at(e)] * state.MbarR_inv(d, e); }
          rows_[at(node.v + d)] = row;
        }
        if constexpr (is_free<S>()) { return; }  // Wᵀ Sᵀ = 1: p is zero but for roundings
        if (node.inlet < 0) { return; }
        for (int c = 0; c < 6; ++c) {
          for (int d = 0; d < n_i; ++d) { p[at(c)] -= tau[at(d)] * state.W(d, c); }
        }
      }
      if (is_free<S>() || node.inlet < 0) { return; }
      if constexpr (Workspace::update == Update::square_root) {
        if (ws.root(node.inlet).keeps_v) {
          const SharedAxis<Scalar>& shared = ws.shared_axis(node.index);
          Lane& sum = along_[at(node.inlet)];
          sum += share * shared.undone;
          if constexpr (apart && has_within<S>()) { sum += along_[at(node.frame)] * shared.slip; }
          for (int c = 0; c < 6; ++c) { sum += p[at(c)] * shared.difference(c); }
        }
      }
      p[3] += p[2] * state.r(1) - p[1] * state.r(2);
      p[4] += p[0] * state.r(2) - p[2] * state.r(0);
      p[5] += p[1] * state.r(0) - p[0] * state.r(1);
      for (int c = 0; c < 6; ++c) { frames_[at(node.inlet)][at(c)] += p[at(c)]; }
    });
  }

  /// Accelerations from the world outward; leaves q̈ in rows_ and V̇ in frames_.
  template <class Workspace>
  void outward(const Workspace& ws)
  {
    tree_->outward([&]<class N, class S>(const N& node, const S&) {
      constexpr int n_i = S::n_i;
      Reach& reach = reach_[at(node.index)];
      const bool guided = node.parent >= 0 && reach_[at(node.parent)] != at_rest;
      if (reach == at_rest) {
        for (int d = 0; d < n_i; ++d) { rows_[at(node.v + d)] = zero(); }
        if (!guided) { return; }
        reach = carried;
      }
      const NodeState<S>& state = ws.template node<S>(node);
      constexpr bool apart = one_column<S, Workspace>;
      [[maybe_unused]] Lane undone = zero();  // of q̈, against the inlet's rate about the same axis
      [[maybe_unused]] Lane slip = zero();
      Six y;
      if (guided) {
        y = frames_[at(node.inlet)];
        y[0] += y[4] * state.r(2) - y[5] * state.r(1);
        y[1] += y[5] * state.r(0) - y[3] * state.r(2);
        y[2] += y[3] * state.r(1) - y[4] * state.r(0);
        if constexpr (Workspace::update == Update::square_root) {
          if (ws.root(node.inlet).keeps_v) {
            const SharedAxis<Scalar>& shared = ws.shared_axis(node.index);
            const Lane& rate = along_[at(node.inlet)];
            for (int c = 0; c < 6; ++c) { y[at(c)] += rate * shared.difference(c); }
            undone = rate * shared.undone;
            if constexpr (has_within<S>()) { slip = rate * shared.slip; }
          }
        }
      } else {
        y.fill(zero());
      }
      std::array<Lane, n_i> qdd;
      for (int d = 0; d < n_i; ++d) {
        qdd[at(d)] = rows_[at(node.v + d)];
        Lane row = qdd[at(d)];
        if (guided) {
          for (int c = 0; c < 6; ++c) { row -= y[at(c)] * state.W(d, c); }
          rows_[at(node.v + d)] = row;
          if constexpr (apart) { rows_[at(node.v)] -= undone; }
          if constexpr (apart && has_within<S>()) { row += slip; }
        }
        if constexpr (!is_free<S>()) { qdd[at(d)] = row; }
      }
      if constexpr (is_free<S>() && Workspace::update == Update::square_root) {
        if (reach != acted) {
          frames_[at(node.frame)].fill(zero());
          along_[at(node.frame)] = zero();
        }
        return;
      }
      // V̇ = y + S (M̄_R⁻¹ τ − W y) with S W = 1: the guidance does not reach the frame.
      if constexpr (is_free<S>()) { y.fill(zero()); }
      if constexpr (apart) {
        frames_[at(node.frame)] = y;
        along_[at(node.frame)] = qdd[0];
        return;
      }
      for (int k = 0; k < S::n_frames; ++k) {
        for (int c = 0; c < 6; ++c) {
          Lane Vdot = y[at(c)];
          if (c < 3 ? S::pattern.linear : S::pattern.angular) {
            for (int d = 0; d < n_i; ++d) { Vdot += qdd[at(d)] * state.S_k[at(k)](c, d); }
          }
          frames_[at(node.frame + k)][at(c)] = Vdot;
        }
      }
    });
  }

  /// A free frame under the wrench in frames_ and along_: leaves its motion there, and q̈ in rows_ (free_root.hpp).
  template <class S, class N>
  void move_free(const RootInertia<Scalar>& inertia, const N& node, const NodeState<S>& state)
  {
    Six& p = frames_[at(node.frame)];
    Lane& along = along_[at(node.frame)];
    for (int d = 0; d < S::n_i; ++d) {  // forces of inputs on the velocities themselves
      const Lane& tau = rows_[at(node.v + d)];
      for (int c = 0; c < 6; ++c) {
        p[at(c)] += tau * state.S_k[0](c, d);
        if (inertia.keeps_v) { along += tau * (inertia.S(c) * state.S_k[0](c, d)); }
      }
    }
    Six motion;
    motion.fill(zero());
    Lane rate = zero();
    for (int k = 0; k < 6; ++k) {
      const auto& G = inertia.row;
      Lane e = along * G[free_rate](k);
      for (int c = 0; c < 6; ++c) { e += p[at(c)] * G[at(c)](k); }
      for (int c = 0; c < 6; ++c) { motion[at(c)] += e * G[at(c)](k); }
      rate += e * G[free_rate](k);
    }
    p = motion;
    along = rate;
    if (inertia.keeps_v) {
      for (int c = 0; c < 6; ++c) { motion[at(c)] += rate * inertia.S(c); }
    }
    for (int d = 0; d < S::n_i; ++d) {
      Lane& row = rows_[at(node.v + d)];
      row = motion[0] * state.S_k[0](0, d);
      for (int c = 1; c < 6; ++c) { row += motion[at(c)] * state.S_k[0](c, d); }
    }
  }

  static constexpr std::size_t at(Index i) { return static_cast<std::size_t>(i); }

  struct Own {
    int frames;
    int velocities;
    bool free;
  };

  const Tree* tree_;
  SortedInputs<Tree> sorted_;
  std::vector<Six> frames_;  // inward p_k, outward V̇_k; apart from S q̈ in square-root form
  std::vector<Lane> along_;  // in square-root form: inward Sᵀ p, outward q̈ along S
  std::vector<Lane> rows_;   // inward B̄_i e and M̄_R⁻¹ τ, outward q̈
  std::vector<Reach> reach_;
  std::vector<Own> own_;
};

}  // namespace iim::detail
