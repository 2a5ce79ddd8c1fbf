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
#include <iim/registers.hpp>
#include <iim/scalar.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>
#include <iim/transpose.hpp>
#include <iim/unit_rows.hpp>
#include <iim/workspace.hpp>

#include <algorithm>
#include <array>
#include <cassert>
#include <cstddef>
#include <type_traits>
#include <vector>

namespace iim::detail {

/// Of a sweep all that depends on Scalar alone, and the steps of single subsystems. Workspace: its part that depends on
/// Scalar and update alone.
template <class Scalar, int width>
class SweepSteps {
protected:
  [[gnu::cold]] SweepSteps(const TreeData<Scalar>& tree, const InputBlocks<Scalar>& inputs)
      : tree_(&tree), sorted_(inputs), buffers_(tree), moving_(static_cast<std::size_t>(buffers_.count())),
        applied_(static_cast<std::size_t>(tree.n_frames())), loads_(applied_.size(), 0), along_(applied_.size(), zero()),
        rows_(static_cast<std::size_t>(tree.n_v())), reach_(static_cast<std::size_t>(tree.size()), at_rest), unit_rows_(tree)
  {
    for (Six& six : applied_) { six.fill(zero()); }
    for (Lane& row : rows_) { row = zero(); }
    if (unit_rows_.are_needed()) { shares_.resize(rows_.size(), zero()); }
  }

  static constexpr int side = std::min(register_lanes<Scalar>, width);  ///< of a register
  using Lane = std::conditional_t<width == 1, Scalar, Row<Scalar, width>>;
  using Six = std::array<Lane, 6>;
  enum Reach : char {
    at_rest,  ///< no input of this block reaches it
    carried,  ///< moves with its parent
    acted     ///< lies between an input and the world
  };
  enum Load : char { by_input = 1, by_child = 2 };  ///< where a wrench on a frame comes from: a sum of these, 0 without one

  static Lane zero()
  {
    if constexpr (width == 1) {
      return Scalar(0);
    } else {
      return Lane::Zero();
    }
  }

  // Component by component, so that six stay in registers: 20 % less for one input on a chain of 50.
  [[gnu::always_inline]] static void clear(Six& to)
  {
    unrolled<6>([&](auto c) __attribute__((always_inline)) { to[c] = zero(); });
  }
  [[gnu::always_inline]] static void copy(const Six& from, Six& to)
  {
    unrolled<6>([&](auto c) __attribute__((always_inline)) { to[c] = from[c]; });
  }
  [[gnu::always_inline]] static void add(const Six& x, Six& to)
  {
    unrolled<6>([&](auto c) __attribute__((always_inline)) { to[c] += x[c]; });
  }

  template <class L>
  static auto& entry(L& lane, int l)
  {
    if constexpr (width == 1) {
      return lane;
    } else {
      return lane(l);
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

  /// All columns; loops: inward and outward for those that are in the lanes.
  template <class Workspace, class Matrix, class Loops>
  bool compute(const Workspace& ws, Matrix& Bhat, Loops&& loops)
  {
    assert(Bhat.cols() == sorted_.inputs().columns() && Bhat.rows() == tree_->n_v());
    std::array<Index, width> columns;
    int lane = 0;
    Lane check = zero();  // the sum of all that was written to B̂
    const auto finish = [&] {
      loops();
      write(columns, lane, Bhat, check);
      lane = 0;
      std::fill(reach_.begin(), reach_.end(), at_rest);
      if (shared_) { std::fill(shares_.begin(), shares_.end(), zero()); }
      shared_ = false;
    };
    sorted_.number_columns();
    sorted_.for_each([&](const Input<Scalar>& input, Index column) {
      if constexpr (Workspace::update == Update::square_root) {
        if (input.kind != InputKind::motor && ws.is_heavy(input.frame)) { unit_rows_.carry_inward(ws, input.frame); }
      }
      for (Index j = 0; j < input.size; ++j) {
        columns[at(lane)] = column + j;
        act(ws, input, j, lane++);
        if (lane == width) { finish(); }
      }
    });
    if (lane > 0) { finish(); }
    if constexpr (width == 1) {
      return false;
    } else {
      Scalar sum(0);
      for (int l = 0; l < width; ++l) { sum += entry(check, l); }
      return detail::is_finite(sum);
    }
  }

  /// The unit in column j of an input, on its subsystem; clears what the inward pass adds to on the path to the world.
  template <class Workspace>
  void act(const Workspace& ws, const Input<Scalar>& input, Index j, int lane)
  {
    for (Index i = input.subsystem; i >= 0 && reach_[at(i)] != acted; i = own_[at(i)].free ? -1 : tree_->node(i).parent) {
      const Node& node = tree_->node(i);
      reach_[at(i)] = acted;
      if constexpr (Workspace::update == Update::square_root) { along_[at(node.frame)] = zero(); }
      for (int d = 0; d < own_[at(i)].velocities; ++d) { rows_[at(node.v + d)] = zero(); }
    }
    if (input.kind == InputKind::motor) {
      for (Index d = 0; d < input.velocities; ++d) {
        entry(rows_[at(input.v + d)], lane) = ws.Bbar()(input.bbar + j * input.velocities + d);
      }
    } else {
      Vector6<Scalar> w = input_wrench(input, ws.frame(input.frame), j);
      if constexpr (Workspace::update == Update::square_root) {
        if (ws.is_heavy(input.frame)) { share(ws, input, w, lane); }
      }
      Six& applied = applied_[at(input.frame)];
      if (loads_[at(input.frame)] == 0) { applied.fill(zero()); }
      loads_[at(input.frame)] = by_input;
      for (int c = 0; c < 6; ++c) { entry(applied[at(c)], lane) = w(c); }
      if constexpr (Workspace::update == Update::square_root) {
        const RootInertia<Scalar>& f = ws.root(input.frame);
        for (int c = 0; c < 6 && f.keeps_v; ++c) { entry(along_[at(input.frame)], lane) += f.S(c) * w(c); }
      }
    }
  }

  /// Takes from the wrench of an input on a heavy frame what its body's rows carry, and notes what each joint gets of it.
  template <class Workspace>
  void share(const Workspace& ws, const Input<Scalar>& input, Vector6<Scalar>& w, int lane)
  {
    const FrameState<Scalar>& f = ws.frame(input.frame);
    const RootRow<Scalar> z = put_on_rows(ws.frame_body(input.frame), f.R, f.r, w);
    for (Index i = input.subsystem; i >= 0; i = tree_->node(i).parent) {
      const Node& node = tree_->node(i);
      for (int d = 0; d < own_[at(i)].velocities; ++d) { entry(shares_[at(node.v + d)], lane) = unit_rows_.at(node.path_v + d, z); }
    }
    shared_ = true;
  }

  /// The wrench on a frame, from its children and from inputs.
  [[gnu::always_inline]] void receive(Index frame, Six& p)
  {
    char& load = loads_[at(frame)];
    if ((load & by_child) != 0) {
      copy(moving_[at(buffers_[frame])], p);
      if ((load & by_input) != 0) { add(applied_[at(frame)], p); }
    } else if (load != 0) {
      copy(applied_[at(frame)], p);
    } else {
      clear(p);
    }
    load = 0;
  }

  /// Wrenches from the inputs to the world; leaves M̄_R⁻¹ τ in rows_.
  template <class S, class Workspace>
  void inward(const Node& node, const NodeState<S>& state, const Workspace& ws)
  {
    constexpr int n_i = S::n_i;
    if (reach_[at(node.index)] != acted) { return; }
    constexpr bool apart = one_column<S, Workspace>;
    [[maybe_unused]] Lane share = zero();  // S_iᵀ p' on the inlet's S
    std::array<Six, S::n_frames> p_k;
    unrolled<S::n_frames>([&](auto k) __attribute__((always_inline)) { receive(node.frame + k, p_k[k]); });
    Six p;
    copy(p_k[0], p);
    for (int k = 1; k < S::n_frames; ++k) { add(p_k[at(k)], p); }
    if constexpr (is_free<S>() && Workspace::update == Update::square_root) {
      move_free(ws.root(node.frame), node, state, p);
    } else if constexpr (n_i > 0) {
      std::array<Lane, n_i> tau;
      unrolled<n_i>([&](auto d) __attribute__((always_inline)) {
        tau[d] = rows_[at(node.v + d)];
        if constexpr (apart) {
          share = -tau[0];
          tau[0] += along_[at(node.frame)];
        } else {
          unrolled<S::n_frames>([&](auto k) __attribute__((always_inline)) {
            unrolled<6>([&](auto c) __attribute__((always_inline)) {
              if constexpr (c < 3 ? S::pattern.linear : S::pattern.angular) { tau[d] += p_k[k][c] * state.S_k[k].coeff(c, d); }
            });
          });
        }
      });
      unrolled<n_i>([&](auto d) __attribute__((always_inline)) {
        Lane row = tau[0] * state.MbarR_inv.coeff(d, 0);
        unrolled<n_i - 1>([&](auto e) __attribute__((always_inline)) { row += tau[e + 1] * state.MbarR_inv.coeff(d, e + 1); });
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
        unrolled<n_i>([&](auto d) __attribute__((always_inline)) { p[c] -= tau[d] * state.W.coeff(d, c); });
      });
    }
    if (is_free<S>() || node.inlet < 0) { return; }
    if constexpr (Workspace::update == Update::square_root) {
      if (ws.root(node.inlet).keeps_v) {
        const SharedAxis<Scalar>& shared = ws.shared_axis(node.index);
        Lane& sum = along_[at(node.inlet)];
        sum += share * shared.undone;
        if constexpr (apart && has_within<S>()) { sum += along_[at(node.frame)] * shared.slip; }
        unrolled<6>([&](auto c) __attribute__((always_inline)) { sum += p[c] * shared.difference.coeff(c); });
      }
    }
    move_wrench(state.r, p);
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
  void outward(const Node& node, const NodeState<S>& state, const Workspace& ws)
  {
    constexpr int n_i = S::n_i;
    Reach& reach = reach_[at(node.index)];
    const bool guided = node.parent >= 0 && reach_[at(node.parent)] != at_rest;
    if (reach == at_rest) {
      for (int d = 0; d < n_i; ++d) { rows_[at(node.v + d)] = zero(); }
      if (!guided) { return; }
      reach = carried;
    }
    constexpr bool apart = one_column<S, Workspace>;
    [[maybe_unused]] Lane undone = zero();  // of q̈, against the inlet's rate about the same axis
    [[maybe_unused]] Lane slip = zero();
    Six y;
    if (guided) {
      copy(moving_[at(buffers_[node.inlet])], y);
      move_twist(state.r, y);
      if constexpr (Workspace::update == Update::square_root) {
        if (ws.root(node.inlet).keeps_v) {
          const SharedAxis<Scalar>& shared = ws.shared_axis(node.index);
          const Lane& rate = along_[at(node.inlet)];
          unrolled<6>([&](auto c) __attribute__((always_inline)) { y[c] += rate * shared.difference.coeff(c); });
          undone = rate * shared.undone;
          if constexpr (has_within<S>()) { slip = rate * shared.slip; }
        }
      }
    } else {
      clear(y);
    }
    std::array<Lane, n_i> qdd;
    unrolled<n_i>([&](auto d) __attribute__((always_inline)) {
      qdd[d] = rows_[at(node.v + d)];
      Lane row = qdd[d];
      if (guided) {
        unrolled<6>([&](auto c) __attribute__((always_inline)) { row -= y[5 - c] * state.W.coeff(d, 5 - c); });
        rows_[at(node.v + d)] = row;
        if constexpr (apart) { rows_[at(node.v)] -= undone; }
        if constexpr (apart && has_within<S>()) { row += slip; }
      }
      if constexpr (!is_free<S>()) { qdd[d] = row; }
    });
    if constexpr (is_free<S>() && Workspace::update == Update::square_root) {
      Six& motion = moving_[at(buffers_[node.frame])];
      if (reach == acted) {
        copy(applied_[at(node.frame)], motion);
      } else {
        clear(motion);
        along_[at(node.frame)] = zero();
      }
      return;
    }
    // V̇ = y + S (M̄_R⁻¹ τ − W y) with S W = 1: the guidance does not reach the frame.
    if constexpr (is_free<S>()) { clear(y); }
    if constexpr (apart) {
      copy(y, moving_[at(buffers_[node.frame])]);
      along_[at(node.frame)] = qdd[0];
      return;
    }
    unrolled<S::n_frames>([&](auto k) __attribute__((always_inline)) {
      Six& Vdot = moving_[at(buffers_[node.frame + k])];
      unrolled<6>([&](auto c) __attribute__((always_inline)) {
        Lane sum = y[c];
        if constexpr (c < 3 ? S::pattern.linear : S::pattern.angular) {
          unrolled<n_i>([&](auto d) __attribute__((always_inline)) { sum += qdd[d] * state.S_k[k].coeff(c, d); });
        }
        Vdot[c] = sum;
      });
    });
  }

  /// A free frame under the wrench p and along_: leaves its motion in applied_ and along_, and q̈ in rows_ (free_root.hpp).
  template <class S>
  void move_free(const RootInertia<Scalar>& inertia, const Node& node, const NodeState<S>& state, Six& p)
  {
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
      if (shared_) [[unlikely]] { e += shares_[at(node.v + k)]; }
      for (int c = 0; c < 6; ++c) { motion[at(c)] += e * G[at(c)](k); }
      rate += e * G[free_rate](k);
    }
    applied_[at(node.frame)] = motion;
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

  /// rows_ to `count` columns of B̂, a square of a register's side at a time: 14 % less for a chain of 1000 with all joints
  /// driven than number by number, and B̂ is not read again to see whether it is finite.
  template <class Matrix>
  void write(const std::array<Index, width>& columns, int count, Matrix& Bhat, Lane& check) const
  {
    const Index n = tree_->n_v();
    Index v = 0;
    if constexpr (side > 1 && width % side == 0) {
      for (; v < n && n >= side; v += side) {
        const Index begin = std::min(v, n - side);  // the last rows may be written twice
        const Lane* const rows = rows_.data() + begin;
        for (int part = 0; part < count; part += side) {
          std::array<Scalar, side> beyond;
          transpose<Scalar, side>([&](auto r) __attribute__((always_inline)) { return &entry(rows[r], part); },
                                  [](auto) __attribute__((always_inline)) { return Scalar(1); },
                                  [&](auto c) __attribute__((always_inline)) {
                                    return part + c < count ? &Bhat(begin, columns[at(part + c)]) : beyond.data();
                                  });
        }
        Lane sum = rows[0];
        for (int r = 1; r < side; ++r) { sum += rows[r]; }
        check += sum;
      }
    }
    for (; v < n; ++v) {
      for (int l = 0; l < count; ++l) { Bhat(v, columns[at(l)]) = entry(rows_[at(v)], l); }
      if constexpr (width > 1) { check += rows_[at(v)]; }
    }
  }

  static constexpr std::size_t at(Index i) { return static_cast<std::size_t>(i); }

  struct Own {
    int velocities;
    bool free;
  };

  const TreeData<Scalar>* tree_;
  SortedInputs<Scalar> sorted_;
  // Of a frame, inward p_k that its children hand on, outward V̇_k; apart from S q̈ in square-root form. Memory that lives
  // from a frame's own step to its last child's is little and stays in cache: a chain of 1000, all joints driven, takes 20 % less.
  FrameBuffers buffers_;
  std::vector<Six> moving_;
  std::vector<Six> applied_;  // to a frame by inputs; of a free one in square-root form its motion, till the outward loop
  std::vector<char> loads_;   // of a frame, of type Load
  std::vector<Lane> along_;  // in square-root form: inward Sᵀ p, outward q̈ along S
  std::vector<Lane> rows_;   // inward B̄_i e and M̄_R⁻¹ τ, outward q̈
  std::vector<Reach> reach_;
  std::vector<Own> own_;
  UnitRows<Scalar> unit_rows_;
  std::vector<Lane> shares_;  // of a unit force on a heavy body: z₁ of the velocity
  bool shared_ = false;       // whether some are not zero
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
  }

  /// Writes all active columns (n_v × inputs.columns()). The workspace holds the O(n) pass of the state.
  /// Returns true if B̂ is known to be finite.
  template <class Workspace, class Matrix>
  bool operator()(const Workspace& ws, Matrix& Bhat)
  {
    const typename Workspace::Data& data = ws;
    return this->compute(data, Bhat, [&] {
      ws.tree().inward([&]<class S>(const Node& node, const S&) { this->inward(node, ws.template node<S>(node), data); });
      ws.tree().outward([&]<class S>(const Node& node, const S&) { this->outward(node, ws.template node<S>(node), data); });
    });
  }
};

}  // namespace iim::detail
