// Columns of B̂ in the lanes of a sweep (sweep.hpp): the inputs that are in them, and their way to the matrix.
#pragma once

#include <iim/inputs.hpp>
#include <iim/inversion/branches.hpp>
#include <iim/numerics/array.hpp>
#include <iim/numerics/registers.hpp>
#include <iim/numerics/row.hpp>
#include <iim/numerics/transpose.hpp>
#include <iim/pass/heavy_frames.hpp>
#include <iim/scalar.hpp>
#include <iim/spatial.hpp>
#include <iim/square_root/unit_rows.hpp>
#include <iim/workspace.hpp>

#include <algorithm>
#include <array>
#include <cassert>
#include <cstddef>
#include <optional>
#include <type_traits>

namespace iim::detail {

/// What the lanes hold per frame and velocity, and what does not depend on types of subsystems.
template <class Scalar, int width>
class SweepColumns {
protected:
  [[gnu::cold]] SweepColumns(const TreeData<Scalar>& tree, const InputBlocks<Scalar>& inputs)
      : tree_(&tree), sorted_(tree, inputs), buffers_(tree), moving_(static_cast<std::size_t>(buffers_.count())),
        place_(static_cast<std::size_t>(tree.n_frames()), -1), loads_(place_.size(), 0), along_(place_.size(), zero()),
        rows_(static_cast<std::size_t>(tree.n_v())), reach_(static_cast<std::size_t>(tree.size()), at_rest),
        unit_rows_(tree)
  {
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
  enum Load : char {
    by_input = 1,
    by_child = 2
  };  ///< where a wrench on a frame comes from: a sum of these, 0 without one

  [[gnu::always_inline]] static Lane zero()
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
    Lane* const y = to.data();
    unrolled<6>([=](auto c) __attribute__((always_inline)) { y[c] = zero(); });
  }
  [[gnu::always_inline]] static void copy(const Six& from, Six& to)
  {
    const Lane* const x = from.data();
    Lane* const y = to.data();
    unrolled<6>([=](auto c) __attribute__((always_inline)) { y[c] = x[c]; });
  }
  [[gnu::always_inline]] static void add(const Six& x, Six& to)
  {
    const Lane* const a = x.data();
    Lane* const b = to.data();
    unrolled<6>([=](auto c) __attribute__((always_inline)) { b[c] += a[c]; });
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

  /// Once own_ is complete: room for the frames that `applied` is asked for.
  [[gnu::cold]] void find_places()
  {
    const auto add = [&](Index frame) {
      int& place = place_[at(frame)];
      if (place < 0) { place = applied_count_++; }
    };
    for (const Node& node : tree_->nodes()) {
      if (own_[at(node.index)].free || (node.parent >= 0 && own_[at(node.parent)].free)) { add(node.frame); }
    }
    const HeavyFrames<Scalar> heavy = unit_rows_.are_needed() ? HeavyFrames<Scalar>(*tree_) : HeavyFrames<Scalar>();
    for (Index id = 0; id < sorted_.inputs().blocks(); ++id) {
      const Input<Scalar>& input = sorted_.inputs().block(id);
      if (input.kind != InputKind::motor) {
        add(input.frame);
      } else if (heavy.is_between(input.subsystem)) {
        add(tree_->node(input.subsystem).frame);
        add(tree_->node(input.subsystem).inlet);
      }
    }
    applied_.resize(at(applied_count_));
    for (Six& six : applied_) { six.fill(zero()); }
  }
  Six& applied(Index frame)
  {
    assert(place_[at(frame)] >= 0);
    return applied_[at(place_[at(frame)])];
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
    carried_ = -1;
    sorted_.for_each([&](const Input<Scalar>& input, Index column) {
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
    for (Index i = input.subsystem; i >= 0 && reach_[at(i)] != acted;
         i = own_[at(i)].free ? -1 : tree_->node(i).parent) {
      const Node& node = tree_->node(i);
      reach_[at(i)] = acted;
      if constexpr (Workspace::update == Update::square_root) { along_[at(node.frame)] = zero(); }
      for (int d = 0; d < own_[at(i)].velocities; ++d) { rows_[at(node.v + d)] = zero(); }
    }
    if (input.kind != InputKind::motor) {
      put_on(input.frame, input_wrench(input, ws.frame(input.frame), j), ws, lane);
      return;
    }
    for (Index d = 0; d < input.velocities; ++d) {
      entry(rows_[at(input.v + d)], lane) = ws.Bbar()(input.bbar + j * input.velocities + d);
    }
    if (own_[at(input.subsystem)].free) {
      const Index frame = tree_->node(input.subsystem).frame;
      if (loads_[at(frame)] == 0) { applied(frame).fill(zero()); }
      loads_[at(frame)] = by_input;
    }
  }

  /// Loads on the velocities of a subsystem between heavy bodies, as wrenches on these. S, r: as opposed_wrenches has
  /// them.
  template <class Workspace>
  [[gnu::cold, gnu::noinline]] void load_bodies(const Node& node, const Scalar* S, int n_i, const Vector3<Scalar>& r,
                                                const Workspace& ws)
  {
    for (int d = 0; d < n_i; ++d) {
      Lane& load = rows_[at(node.v + d)];
      for (int l = 0; l < width; ++l) {
        const Scalar size = entry(load, l);
        if (size == Scalar(0)) { continue; }
        const std::optional<OpposedWrenches<Scalar>> wrenches = opposed_wrenches(node, S, n_i, d, r, ws);
        if (!wrenches) { continue; }
        put_on(wrenches->frame, wrenches->on_frame * size, ws, l, wrenches->is_shared);
        put_on(wrenches->inlet, wrenches->on_inlet * size, ws, l);
        entry(load, l) = Scalar(0);
      }
    }
  }

  /// A wrench on a frame. shared: UnitRows::carry_inward.
  template <class Workspace>
  void put_on(Index frame, Vector6<Scalar> w, const Workspace& ws, int lane, bool shared = false)
  {
    if constexpr (Workspace::update == Update::square_root) {
      if (ws.is_heavy(frame)) { share(ws, frame, w, lane, shared); }
    }
    Six& wrench = applied(frame);
    char& load = loads_[at(frame)];
    if ((load & by_input) == 0) { wrench.fill(zero()); }
    load = static_cast<char>(load | by_input);
    for (int c = 0; c < 6; ++c) { entry(wrench[at(c)], lane) += w(c); }
    if constexpr (Workspace::update == Update::square_root) {
      const RootInertia<Scalar>& f = ws.root(frame);
      for (int c = 0; c < 6 && f.keeps_v; ++c) { entry(along_[at(frame)], lane) += f.S(c) * w(c); }
    }
  }

  /// Takes from a wrench on a heavy frame what its body's rows carry, and notes what each joint gets of it.
  template <class Workspace>
  void share(const Workspace& ws, Index frame, Vector6<Scalar>& w, int lane, bool shared)
  {
    if (carried_ != frame || shared_load_ != shared) { unit_rows_.carry_inward(ws, frame, shared); }
    carried_ = frame;
    shared_load_ = shared;
    const FrameState<Scalar>& f = ws.frame(frame);
    const RootRow<Scalar> z = put_on_rows(ws.frame_body(frame), f.R, f.bodies_at(), w);
    for (Index i = tree_->owner(frame); i >= 0; i = tree_->node(i).parent) {
      const Node& node = tree_->node(i);
      for (int d = 0; d < own_[at(i)].velocities; ++d) {
        entry(shares_[at(node.v + d)], lane) += unit_rows_.share(node.path_v + d, z);
      }
    }
    shared_ = true;
  }

  /// rows_ to `count` columns of B̂, a square of a register's side at a time: 14 % less for a chain of 1000 with all
  /// joints driven than number by number, and B̂ is not read again to see whether it is finite.
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

  struct Own {
    int velocities;
    bool free;
  };

  const TreeData<Scalar>* tree_;
  SortedInputs<Scalar> sorted_;
  // Of a frame, inward p_k that its children hand on, outward V̇_k; apart from S q̈ in square-root form. Memory that
  // lives from a frame's own step to its last child's is little and stays in cache: a chain of 1000, all joints driven,
  // takes 20 % less.
  FrameBuffers buffers_;
  Array<Six> moving_;
  // To a frame by inputs; of a free one in square-root form its motion, till the outward loop. In matrix form of a
  // FreeLimb what it hands to the free frame, then how that moves apart from S. Of other frames there is none.
  Array<Six> applied_;
  Array<int> place_;  // of a frame
  int applied_count_ = 0;
  Array<char> loads_;  // of a frame, of type Load
  Array<Lane> along_;  // in square-root form, and of a FreeLimb: inward Sᵀ p, outward q̈ along S
  Array<Lane> rows_;   // inward B̄_i e and M̄_R⁻¹ τ, outward q̈
  Array<Reach> reach_;
  Array<Own> own_;
  UnitRows<Scalar> unit_rows_;
  Index carried_ = -1;        // the frame that they are of,
  bool shared_load_ = false;  // and whether as rotors share a load
  Array<Lane> shares_;        // of a unit force on a heavy body: z₁ of the velocity
  bool shared_ = false;       // whether some are not zero
};

}  // namespace iim::detail
