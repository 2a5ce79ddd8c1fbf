// One bias and one acceleration pass for several inputs at once: columns of B̂ without anything of size n².
//
// With p_k the wrench on frame k (its sign is that of an applied force, p = −h̄*) the input part of (15), (18) and (19)
// is
//
//     inward    τ = Σ_k S_kᵀ p_k + B̄_i e,   p_inlet += X(r)ᵀ (Σ_k p_k − Wᵀ τ)                       (23)
//     outward   y = X(r) V̇_inlet,   q̈_i = M̄_R⁻¹ τ − W y,   V̇_k = y + S_k q̈_i                       (27), (19)
//
// In square-root form Sᵀ p and S q̈ of a frame with one S are kept apart, so that a child on nearly the same axis sees
// the difference only (SharedAxis); in matrix form between a free base and limbs along its axis (FreeLimb). Inward only
// subsystems between an input and the world have a wrench; outward only trees that an input acts on move.
#pragma once

#include <iim/inputs.hpp>
#include <iim/inversion/sweep_columns.hpp>
#include <iim/numerics/registers.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>
#include <iim/workspace.hpp>

#include <array>
#include <optional>
#include <span>

namespace iim::detail {

/// Of a sweep all that depends on Scalar alone, and the steps of single subsystems. Workspace: its part that depends on
/// Scalar and update alone.
template <class Scalar, int width>
class SweepSteps : protected SweepColumns<Scalar, width> {
protected:
  using Columns = SweepColumns<Scalar, width>;
  using Columns::acted, Columns::at_rest, Columns::by_child, Columns::by_input, Columns::carried;
  using Columns::add, Columns::applied, Columns::clear, Columns::copy, Columns::zero;
  using Columns::along_, Columns::buffers_, Columns::loads_, Columns::moving_, Columns::reach_, Columns::rows_,
      Columns::shared_, Columns::shares_;
  using Columns::Columns;
  using typename Columns::Lane, typename Columns::Reach, typename Columns::Six;

  /// The wrench on a frame, from its children and from inputs.
  [[gnu::always_inline]] void receive(Index frame, Six& p)
  {
    char& load = loads_[at(frame)];
    if ((load & by_child) != 0) {
      copy(moving_[at(buffers_[frame])], p);
      if ((load & by_input) != 0) { add(applied(frame), p); }
    } else if (load != 0) {
      copy(applied(frame), p);
    } else {
      clear(p);
    }
    load = 0;
  }

  /// Wrenches from the inputs to the world; leaves M̄_R⁻¹ τ in rows_.
  template <class S, class Workspace>
  void inward(const Node& node, const NodeMemory<S>& state, const Workspace& ws)
  {
    constexpr int n_i = S::n_i;
    if (reach_[at(node.index)] != acted) { return; }
    constexpr bool keeps_v = one_column<S, Workspace>;
    constexpr bool several = shares_motion<S, Workspace> && !keeps_v;
    [[maybe_unused]] Lane share = zero();  // S_iᵀ p' on the inlet's S
    [[maybe_unused]] Lane shares[several && n_i > 1 ? n_i : 1];
    const FreeLimb<Scalar>* limb = nullptr;
    if constexpr (follows_free_axis<S, Workspace>) { limb = ws.free_limb(node.index); }
    if constexpr (shares_motion<S, Workspace> && n_i > 0) {
      if (ws.loads_bodies(node.index)) [[unlikely]] { this->load_bodies(node, state.S_k[0].data(), n_i, state.r, ws); }
    }
    [[maybe_unused]] const bool loaded = loads_[at(node.frame)] != 0;
    std::array<Six, S::n_frames> p_k;
    unrolled<S::n_frames>([&](auto k) __attribute__((always_inline)) { receive(node.frame + k, p_k[k]); });
    Six p;
    copy(p_k[0], p);
    for (int k = 1; k < S::n_frames; ++k) { add(p_k[at(k)], p); }
    if constexpr (is_free<S>() && Workspace::update == Update::square_root) {
      move_free(ws.root(node.frame), node, state, p);
    } else if constexpr (n_i > 0) {
      if constexpr (is_free<S>()) {
        if (const FreeAxis<Scalar>* const base = ws.free_axis(node.frame); base->child >= 0) {
          move_along_axis(*base, ws.limbs(*base), node, state, p, loaded);
          return;
        }
      }
      std::array<Lane, n_i> tau;
      for_each_velocity<n_i, Scalar>([&](auto d) __attribute__((always_inline)) {
        tau[d] = rows_[at(node.v + d)];
        if constexpr (keeps_v || follows_free_axis<S, Workspace>) { share = -tau[0]; }
        if constexpr (several) { shares[d] = -tau[d]; }
        if constexpr (keeps_v) {
          tau[0] += along_[at(node.frame)];
        } else {
          unrolled<S::n_frames>([&](auto k) __attribute__((always_inline)) {
            unrolled<6>([&](auto c) __attribute__((always_inline)) {
              if constexpr (c < 3 ? S::pattern.linear : S::pattern.angular) {
                tau[d] += p_k[k][c] * state.S_k[k].coeff(c, d);
              }
            });
          });
        }
      });
      if (limb != nullptr) [[unlikely]] {  // a column has a share or what comes from beyond, not both
        along_[at(node.frame)] = (tau[0] + share) * limb->slip + share * limb->undone;
      }
      for_each_velocity<n_i, Scalar>([&](auto d) __attribute__((always_inline)) {
        Lane row = tau[0] * state.MbarR_inv.coeff(d, 0);
        for_each_velocity<n_i - 1, Scalar>(
            [&](auto e) __attribute__((always_inline)) { row += tau[e + 1] * state.MbarR_inv.coeff(d, e + 1); });
        if constexpr (Workspace::update == Update::square_root) {
          if (shared_) [[unlikely]] {
            for (int e = 0; e < n_i; ++e) { row += shares_[at(node.v + e)] * state.MbarR_inv_root.coeff(d, e); }
          }
        }
        rows_[at(node.v + d)] = row;
      });
      if constexpr (is_free<S>()) { return; }  // Wᵀ Sᵀ = 1: p is zero but for roundings
      if (node.inlet < 0) { return; }
      unrolled<6>([&](auto c) __attribute__((always_inline)) {
        for_each_velocity<n_i, Scalar>([&](auto d)
                                           __attribute__((always_inline)) { p[c] -= tau[d] * state.W.coeff(d, c); });
      });
    }
    if (is_free<S>() || node.inlet < 0) { return; }
    if constexpr (Workspace::update == Update::square_root) {
      if (ws.root(node.inlet).keeps_v) {
        const SharedAxis<Scalar>& shared = ws.shared_axis(node.index);
        Lane& sum = along_[at(node.inlet)];
        if constexpr (keeps_v) { sum += share * shared.undone(0) + along_[at(node.frame)] * shared.slip; }
        if constexpr (several) {
          for (int d = 0; d < n_i; ++d) { sum += shares[d] * shared.undone(d); }
        }
        unrolled<6>([&](auto c) __attribute__((always_inline)) { sum += p[c] * shared.difference.coeff(c); });
      }
    }
    move_wrench(state.r, p);
    if (limb != nullptr) [[unlikely]] {
      copy(p, applied(node.frame));
      return;
    }
    Six& inlet = moving_[at(buffers_[node.inlet])];
    char& load = loads_[at(node.inlet)];
    if ((load & by_child) != 0) {
      add(p, inlet);
    } else {
      copy(p, inlet);
      load = static_cast<char>(load | by_child);
    }
  }

  /// Accelerations from the world outward; leaves q̈ in rows_.
  template <class S, class Workspace>
  void outward(const Node& node, const NodeMemory<S>& state, const Workspace& ws)
  {
    constexpr int n_i = S::n_i;
    Reach& reach = reach_[at(node.index)];
    const bool guided = node.parent >= 0 && reach_[at(node.parent)] != at_rest;
    if (reach == at_rest) {
      for (int d = 0; d < n_i; ++d) { rows_[at(node.v + d)] = zero(); }
      if (!guided) { return; }
      reach = carried;
    }
    constexpr bool keeps_v = one_column<S, Workspace>;
    // Of q̈, against the inlet's rate along the same motion.
    constexpr bool shares = shares_motion<S, Workspace>;
    [[maybe_unused]] Lane undone[shares && n_i > 1 ? n_i : 1];
    if constexpr (keeps_v || shares || follows_free_axis<S, Workspace>) {
      for (Lane& of_velocity : undone) { of_velocity = zero(); }
    }
    [[maybe_unused]] Lane slip = zero();
    const FreeLimb<Scalar>* limb = nullptr;
    if constexpr (follows_free_axis<S, Workspace>) { limb = ws.free_limb(node.index); }
    Six y;
    if (guided) {
      if (limb != nullptr) [[unlikely]] {
        if (reach_[at(node.parent)] == acted) {
          copy(applied(node.frame), y);
          slip = along_[at(node.frame)] * limb->slip;
          undone[0] = along_[at(node.frame)] * limb->undone;
        } else {
          clear(y);
        }
      } else {
        copy(moving_[at(buffers_[node.inlet])], y);
      }
      move_twist(state.r, y);
      if constexpr (Workspace::update == Update::square_root) {
        if (ws.root(node.inlet).keeps_v) {
          const SharedAxis<Scalar>& shared = ws.shared_axis(node.index);
          const Lane& rate = along_[at(node.inlet)];
          unrolled<6>([&](auto c) __attribute__((always_inline)) { y[c] += rate * shared.difference.coeff(c); });
          if constexpr (shares) {
            for (int d = 0; d < n_i; ++d) { undone[d] = rate * shared.undone(d); }
          }
          slip = rate * shared.slip;
        }
      }
    } else {
      clear(y);
    }
    std::array<Lane, n_i> qdd;
    for_each_velocity<n_i, Scalar>([&](auto d) __attribute__((always_inline)) {
      qdd[d] = rows_[at(node.v + d)];
      Lane row = qdd[d];
      if (guided) {
        unrolled<6>([&](auto c) __attribute__((always_inline)) { row -= y[5 - c] * state.W.coeff(d, 5 - c); });
        rows_[at(node.v + d)] = row;
        if (keeps_v || limb != nullptr) {
          rows_[at(node.v)] -= undone[0];
          row += slip;
        } else if constexpr (shares) {
          rows_[at(node.v + d)] -= undone[d];
        }
      }
      if constexpr (!is_free<S>()) { qdd[d] = row; }
    });
    if constexpr (is_free<S>() && Workspace::update == Update::square_root) {
      Six& motion = moving_[at(buffers_[node.frame])];
      if (reach == acted) {
        copy(applied(node.frame), motion);
      } else {
        clear(motion);
        along_[at(node.frame)] = zero();
      }
      return;
    }
    // V̇ = y + S (M̄_R⁻¹ τ − W y) with S W = 1: the guidance does not reach the frame.
    if constexpr (is_free<S>()) { clear(y); }
    if constexpr (keeps_v) {
      copy(y, moving_[at(buffers_[node.frame])]);
      along_[at(node.frame)] = qdd[0];
      return;
    }
    unrolled<S::n_frames>([&](auto k) __attribute__((always_inline)) {
      Six& Vdot = moving_[at(buffers_[node.frame + k])];
      unrolled<6>([&](auto c) __attribute__((always_inline)) {
        Lane sum = y[c];
        if constexpr (c < 3 ? S::pattern.linear : S::pattern.angular) {
          for_each_velocity<n_i, Scalar>(
              [&](auto d) __attribute__((always_inline)) { sum += qdd[d] * state.S_k[k].coeff(c, d); });
        }
        Vdot[c] = sum;
      });
    });
  }

  /// A free frame in matrix form, under the wrench p and forces on its velocities (`others`: if there are any) and what
  /// has come from the limbs along its axis (`applied` and along_ of their frames): leaves q̈ in rows_, and for those
  /// limbs how the frame moves, apart from S (free_inward.hpp).
  template <class S>
  void move_along_axis(const FreeAxis<Scalar>& axis, std::span<const FreeLimb<Scalar>> limbs, const Node& node,
                       const NodeMemory<S>& state, const Six& p, bool others)
  {
    Six all;
    clear(all);
    Lane on_axis = zero();
    for (const FreeLimb<Scalar>& limb : limbs) {
      if (reach_[at(limb.child)] != acted) { continue; }
      const Index frame = this->tree_->node(limb.child).frame;
      add(applied(frame), all);
      on_axis += in_sense(limb.sense, along_[at(frame)]);
    }
    Six tau;
    for (int d = 0; d < 6 && others; ++d) {
      tau[at(d)] = rows_[at(node.v + d)];
      for (int c = 0; c < (d < 3 ? 3 : 6); ++c) { tau[at(d)] += p[at(c)] * state.S_k[0](c, d); }
    }
    for (int d = 0; d < 6; ++d) { rows_[at(node.v + d)] = zero(); }
    Six motion;
    motion.fill(zero());
    Lane e = zero();
    for (int k = 0; k < 6; ++k) {
      const int end = k < 3 ? 3 : 6;  // the first three do not turn the frame
      e = k < 5 ? zero() : Lane(on_axis * axis.last);
      for (int c = 0; c < end; ++c) {
        e += all[at(c)] * axis.E(c, k);
        if (others) { e += tau[at(c)] * state.MbarR_inv_root(c, k); }
      }
      for (int c = 0; c < end; ++c) {
        motion[at(c)] += e * axis.E(c, k);
        rows_[at(node.v + c)] += e * state.MbarR_inv_root(c, k);
      }
    }
    for (const FreeLimb<Scalar>& limb : limbs) {
      const Index frame = this->tree_->node(limb.child).frame;
      copy(motion, applied(frame));
      along_[at(frame)] = in_sense(limb.sense, Lane(e * axis.last));
    }
  }

  /// A free frame under the wrench p and along_: leaves its motion in `applied` and along_, and q̈ in rows_
  /// (free_root.hpp).
  template <class S>
  void move_free(const RootInertia<Scalar>& inertia, const Node& node, const NodeMemory<S>& state, Six& p)
  {
    Lane& along = along_[at(node.frame)];
    for (int d = 0; d < S::n_i; ++d) {  // forces of inputs on the velocities themselves
      const Lane& tau = rows_[at(node.v + d)];
      for (int c = 0; c < 6; ++c) {
        p[at(c)] += tau * state.W(d, c);
        if (inertia.keeps_v) { along += tau * (inertia.S(c) * state.W(d, c)); }
      }
    }
    Six motion;
    motion.fill(zero());
    Lane rate = zero();
    for (int k = 0; k < 6; ++k) {
      const auto& G = inertia.G;
      Lane e = along * G[free_rate](k);
      for (int c = 0; c < 6; ++c) { e += p[at(c)] * G[at(c)](k); }
      if (shared_) [[unlikely]] { e += shares_[at(node.v + k)]; }
      for (int c = 0; c < 6; ++c) { motion[at(c)] += e * G[at(c)](k); }
      rate += e * G[free_rate](k);
    }
    applied(node.frame) = motion;
    along = rate;
    if (inertia.keeps_v) {
      for (int c = 0; c < 6; ++c) { motion[at(c)] += rate * inertia.S(c); }
    }
    for (int d = 0; d < S::n_i; ++d) {
      Lane& row = rows_[at(node.v + d)];
      row = motion[0] * state.W(d, 0);
      for (int c = 1; c < 6; ++c) { row += motion[at(c)] * state.W(d, c); }
    }
  }
};

/// Columns of B̂, `width` at a time. Construction allocates O(n_v·width); nothing after it does. Refers to the tree.
template <class Tree, int width>
class Sweep : SweepSteps<typename Tree::Scalar, width> {
  using Steps = SweepSteps<typename Tree::Scalar, width>;

public:
  using Scalar = typename Tree::Scalar;

  [[gnu::cold]] Sweep(const Tree& tree, const Inputs<Tree>& inputs) : Steps(tree, inputs)
  {
    tree.outward([&]<class S>(const Node&, const S&) { this->own_.push_back({S::n_i, is_free<S>()}); });
    this->find_places();
  }

  /// Writes all active columns (n_v × inputs.columns()). The workspace holds the O(n) pass of the state.
  /// Returns true if B̂ is known to be finite.
  template <class Workspace, class Matrix>
  bool operator()(const Workspace& ws, Matrix& Bhat)
  {
    const typename Workspace::Data& data = ws;
    return this->compute(data, Bhat, [&] {
      ws.tree().inward(
          [&]<class S>(const Node& node, const S&) { this->inward(node, ws.template node<S>(node), data); });
      ws.tree().outward(
          [&]<class S>(const Node& node, const S&) { this->outward(node, ws.template node<S>(node), data); });
    });
  }
};

/// Columns of B̂ by sweeps of as many lanes as pay: those of a vector register, or of two where more columns are active.
/// A step waits for the one before it, and with two registers computes meanwhile (48 inputs on a chain of 200: 0.60 of
/// the time with AVX-512, 0.66 with AVX2, 0.61 with SSE2; but 7, 20 and 18 % more for one input).
template <class Tree>
class Sweeps {
  static constexpr int lanes = register_lanes<typename Tree::Scalar>;
  static constexpr bool several = lanes > 1;

public:
  [[gnu::cold]] Sweeps(const Tree& tree, const Inputs<Tree>& inputs) : inputs_(&inputs), narrow_(tree, inputs)
  {
    if constexpr (several) {
      if (inputs.max_columns() > lanes) { wide_.emplace(tree, inputs); }
    }
  }

  /// As of a Sweep.
  template <class Workspace, class Matrix>
  bool operator()(const Workspace& ws, Matrix& Bhat)
  {
    if constexpr (several) {
      if (inputs_->columns() > lanes) { return (*wide_)(ws, Bhat); }
    }
    return narrow_(ws, Bhat);
  }

private:
  const Inputs<Tree>* inputs_;
  Sweep<Tree, lanes> narrow_;
  std::optional<Sweep<Tree, several ? 2 * lanes : 1>> wide_;
};

}  // namespace iim::detail
