// The inward loop of the O(n) pass for one subsystem, (14)–(17): what the tree beyond a coupling point looks like from
// there. In matrix form (Update::printed, projected); in square-root form: inward_root.hpp.
#pragma once

#include <iim/numerics/registers.hpp>
#include <iim/numerics/spd.hpp>
#include <iim/pass/articulated_inertia.hpp>
#include <iim/pass/carried.hpp>
#include <iim/pass/free_inward.hpp>
#include <iim/pass/internal_inertia.hpp>
#include <iim/pass/kinematics.hpp>
#include <iim/pass/mended_compound.hpp>
#include <iim/pass/mended_root.hpp>
#include <iim/pass/roundings.hpp>
#include <iim/pass/turned_step.hpp>
#include <iim/pass/weak_pivot.hpp>
#include <iim/spatial.hpp>
#include <iim/square_root/inward_root.hpp>
#include <iim/subsystem.hpp>
#include <iim/workspace.hpp>

#include <algorithm>
#include <array>
#include <cstddef>

namespace iim::detail {

/// Inertia A and wrench p about a coupling point, to the inlet's inertia and wrench. c: acceleration of the coupling
/// point that comes with the inlet turning.
template <Scene scene, class Scalar>
[[gnu::always_inline]] inline void hand_on(const SpatialInertia<Scalar>& A, const TriplePair<Scalar>& wrench,
                                           const Vector3<Scalar>& c, const Vector3<Scalar>& r,
                                           FrameState<Scalar>& inlet)
{
  FrameInertia<Scalar>& there = inlet.inertia();
  TriplePair<Scalar> p = wrench;
  if constexpr (scene.velocity) { p += A.of_linear(c); }
  p.angular += cross(Triple<Scalar>::settled(r.data()), p.linear);
  if constexpr (is_several<Scalar>) {
    there.A.add_shifted(A, r);
    p += TriplePair<Scalar>(there.h.data());
  } else {
    SpatialInertia<Scalar> moved = A.shifted(r);
    if (inlet.arrived) {
      moved += there.A;
      p += TriplePair<Scalar>(there.h.data());
    } else {
      clear_size(inlet);
    }
    there.A = moved;  // once: g++ copies through memory what either branch assigns (pass of a chain 15 % more)
  }
  p.put(there.h.data());
}

/// Matrix form. receiver: the frame that takes what is handed on. (Inlined: called, a motor-arm's step takes 6 %
/// longer.)
template <Scene scene, class S, class Workspace>
[[gnu::always_inline]] inline void matrix_inward(const Node& node, Index receiver, const S& s, NodeState<S>& state,
                                                 Workspace& ws, Diagnosis& diagnosis,
                                                 typename S::Scalar& largest_inverse)
{
  using Scalar = typename S::Scalar;
  constexpr MotionPattern pattern = S::pattern;
  constexpr int n_i = S::n_i;
  constexpr int n_frames = S::n_frames;
  constexpr int n_rotors = rotor_count<S>();
  constexpr Mended small = mended_as<S, Workspace>();  // pivots
  constexpr bool small_make_W = small == Mended::root || small == Mended::compound;
  using VectorI = Eigen::Matrix<Scalar, n_i, 1>;
  using Columns = SixColumns<Scalar, n_i>;

  // U, D, h_g, h_q over the frames.
  std::array<Columns, n_frames> U_k;
  Eigen::Matrix<Scalar, n_i, n_i> D;
  TriplePair<Scalar> hg{};
  VectorI hq, scale;
  std::array<TriplePair<Scalar>, n_frames> size;
  constexpr bool in_registers = !is_several<Scalar>;
  std::array<Carried<Scalar>, in_registers ? n_frames : 1> carried;
  const auto A_of = [&](std::size_t k) __attribute__((always_inline)) -> const SpatialInertia<Scalar>& {
    if constexpr (in_registers) {
      return carried[k].A;
    } else {
      return ws.frame(node.frame + static_cast<Index>(k)).inertia().A;
    }
  };
#pragma GCC unroll 8
  for (int d = 0; d < n_i; ++d) { hq(d) = scale(d) = Scalar(0); }
#pragma GCC unroll 2
  for (int k = 0; k < n_frames; ++k) {
    const auto at = static_cast<std::size_t>(k);
    FrameState<Scalar>& f = ws.frame(node.frame + k);
    const FrameMass<Scalar>& body = ws.tree().frame_mass(node.frame + k);
    if constexpr (in_registers) { carried[at] = own_bodies<S, scene.velocity>(body, f); }
    if constexpr (has_own_twist<S>() && in_registers) {
      TriplePair<Scalar>& U_0 = U_k[0][0];
      U_0 = own_column(state, f);
      D(0, 0) = state.own.D;
      if (f.arrived) {
        Columns U_arrived;
        inertia_times<pattern>(f.inertia().A, state.S_k[0], U_arrived);
        add_joint_inertia<pattern>(state.S_k[0], U_arrived, false, D);
        U_0 += U_arrived[0];
      }
      add_arrived(f, carried[at]);
    } else {
      if constexpr (in_registers) { add_arrived(f, carried[at]); }
      inertia_times<pattern>(A_of(at), state.S_k[at], U_k[at]);
      add_joint_inertia<pattern>(state.S_k[at], U_k[at], k == 0, D);
    }
    size[at] = largest(f, A_of(at));
    add_scale<pattern>(size[at], state.S_k[at], scale);
    const TriplePair<Scalar> h =
        in_registers ? carried[in_registers ? at : 0].h : TriplePair<Scalar>(f.inertia().h.data());
    const TriplePair<Scalar> p = bias_wrench<scene, S>(A_of(at), h, f);
#pragma GCC unroll 8
    for (int d = 0; d < n_i; ++d) { hq(d) += column_dot<pattern>(state.S_k[at], d, p); }
    if (k == 0) {
      hg = p;
    } else {
      hg += p;
    }
  }
  if constexpr (in_registers) {
    for (int k = 0; k < n_frames; ++k) { keep(carried[static_cast<std::size_t>(k)], ws.frame(node.frame + k)); }
  }
  [[maybe_unused]] const VectorI scale_of_A = scale;
  Columns U = U_k[0];
#pragma GCC unroll 2
  for (int k = 1; k < n_frames; ++k) {
#pragma GCC unroll 8
    for (int d = 0; d < n_i; ++d) { U[d] += U_k[static_cast<std::size_t>(k)][d]; }
  }

  SpunRotors<S> spun;
  if constexpr (n_rotors > 0) { take_rotors<scene>(node, s, state, ws, spun, U, D, scale, hg, hq); }
  if constexpr (scene.implicit) { take_springs<S>(state, D, scale); }

  [[maybe_unused]] const VectorI unloaded = hq;
#pragma GCC unroll 8
  for (int d = 0; d < n_i; ++d) { hq(d) -= ws.load()(node.v + d); }
  bool weak = loses(D, scale);
  [[maybe_unused]] bool mended = false;
  if constexpr (small == Mended::pivot) {
    if (weak) [[unlikely]] {
      const auto pivot = mended_pivot(node, state, D(0, 0), scale(0), hq(0), scene.velocity, ws.is_implicit(), ws);
      mended = ScalarTraits<Scalar>::is_positive(pivot.D);
      if (mended) {
        TriplePair<Scalar> all = U_k[0][0] = pivot.U;
        Scalar moved = pivot.D;
        add_inertia_within<scene.implicit, S>(state, spun, all, moved);
        U[0] = all;
        D(0, 0) = moved;
        hq(0) += pivot.more_h;
        weak = false;
      }
    }
  }
  VectorI along;
  bool losing = false;
  for (int k = 0; k < n_frames; ++k) { losing |= ws.frame(node.frame + k).loses; }
  if (losing || weak) [[unlikely]] {
    along = along_loss(&ws.frame(node.frame), state);
    for (int d = 0; d < n_i; ++d) { scale(d) += along(d) * along(d); }
  }
  Eigen::Matrix<Scalar, n_i, n_i> D_inv;  // read back from the workspace it would wait for the store (inward loop 3 %)
  bool positive = invert_spd<Scalar, n_i>(D, scale, state.MbarR_inv_root, D_inv, mended);
  Columns W;
  if constexpr (small == Mended::root) {
    if (is_weak(state.MbarR_inv_root, scale_of_A, Scalar(2), Scalar(0)) && diagnosis.status == Status::ok &&
        !has_inertia_within<scene.implicit, S>(state, spun)) [[unlikely]] {
      mended = mend<pattern>(node, state.S_k[0], size[0], ws.is_implicit(), ws,
                             Reduction<Scalar, n_i>{state.MbarR_inv_root, D_inv, W, carried[0].A, positive});
      weak = weak && !mended;
    }
  }
  [[maybe_unused]] Columns V;
  if constexpr (small == Mended::compound) {
    if (is_weak(state.MbarR_inv_root, scale_of_A, Scalar(8), Scalar(0)) && diagnosis.status == Status::ok &&
        ws.axes().of(node.frame) == nullptr) [[unlikely]] {  // what is beyond stands in the world's axes
      mended =
          mend_compound<Scalar, n_i>(node, D, scale, ws.is_implicit(), ws, positive, state.MbarR_inv_root, D_inv, V, W);
      weak = weak && !mended;
    }
  }
  if (!positive) [[unlikely]] { note_small_pivot(node, ws, diagnosis); }
  if constexpr (mends_several<Workspace> && n_frames == 1) {
    if constexpr (has_unit_column<S>()) {
      largest_inverse = std::max(largest_inverse, D_inv(0, 0));
    } else if (!ws.free_axes().empty()) {  // by how the frame moves, whatever the coordinate's unit is
      for (int d = 0; d < n_i; ++d) {
        const TriplePair<Scalar> column = column_of<pattern>(state.S_k[0], d);
        largest_inverse = std::max(largest_inverse, Scalar(D_inv(d, d) * dot(column, column)));
      }
    }
  }
  if constexpr (!is_several<Scalar>) { state.MbarR = D; }
  state.MbarR_inv = D_inv;
  state.psi = product(D_inv, hq);
  if constexpr (!is_several<Scalar>) {  // which nothing needs: several states 1 to 3 % less
#pragma GCC unroll 8
    for (int d = 0; d < n_i; ++d) { U[d].put(&state.U(0, d)); }
  }
#pragma GCC unroll 8
  for (int d = 0; d < n_i; ++d) {
    if (!(small_make_W && mended)) [[likely]] {
      W[d] = U[0] * D_inv(d, 0);
#pragma GCC unroll 8
      for (int e = 1; e < n_i; ++e) { W[d] += U[e] * D_inv(d, e); }
    }
    if constexpr (n_i == 1) {
      W[0].put(state.W.data());
    } else {
#pragma GCC unroll 8
      for (int j = 0; j < 6; ++j) { state.W(d, j) = W[d](j); }
    }
  }
  if (node.inlet < 0) { return; }

  [[maybe_unused]] SpatialInertia<Scalar> reduced;
  if constexpr (small == Mended::pivot) {
    if (mended) [[unlikely]] {
      const bool has_own = has_inertia_within<scene.implicit, S>(state, spun);
      SpatialInertia<Scalar> from;  // apart, so that A stays in registers where no pivot is mended
      copy(A_of(0), from);
      reduce(from, column_of<pattern>(state.S_k[0], 0), TriplePair<Scalar>(U_k[0][0]), TriplePair<Scalar>(W[0]),
             has_own, reduced);
      if constexpr (in_registers) { copy(reduced, carried[0].A); }
      if (!has_own) {  // A S = 0 from here on: `projected` leaves it as it is
        const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
        U_k[0][0] = {zero, zero};
      }
    }
  }

  // What the parent sees, before the shift to its own point.
  const auto passed_on = [&](std::size_t k) __attribute__((always_inline)) {
    const SpatialInertia<Scalar>& A_k = !in_registers && small == Mended::pivot && mended ? reduced : A_of(k);
    if constexpr (small_make_W) {
      return mended ? A_k : projected<pattern>(A_k, state.S_k[k], U_k[k], W);
    } else if constexpr (Workspace::update == Update::projected) {
      return projected<pattern>(A_k, state.S_k[k], U_k[k], W);
    } else {
      return A_k;
    }
  };
  SpatialInertia<Scalar> A = passed_on(0);  // made, not assigned to: g++ copies through memory what is assigned
  for (std::size_t k = 1; k < n_frames; ++k) { A += passed_on(k); }
  const bool all_passed_on = small == Mended::compound && mended;  // with what is within
  if constexpr (n_rotors > 0) { hand_on_rotors<Workspace::update, S>(spun, W, all_passed_on, A, size[0]); }
  if constexpr (scene.implicit && Workspace::update == Update::projected) {
    if (!all_passed_on) [[likely]] { hand_on_springs<S>(state, W, A); }
  }
  if constexpr (Workspace::update == Update::printed) { subtract_product(U, W, A); }
  if constexpr (small == Mended::compound) {
    if (mended) [[unlikely]] { subtract_product(V, V, A); }
  }

  add_inlet_bodies<scene>(node, state, ws, A, hg);
#pragma GCC unroll 8
  for (int d = 0; d < n_i; ++d) { hg -= W[d] * hq(d); }
  if constexpr (turns_about_axis<S>()) {
    FreeLimb<Scalar>* const limb = ws.free_limb(node.index);
    if (limb != nullptr) [[unlikely]] { set_limb<scene>(node, s, state, spun, unloaded(0), ws, *limb); }
  }
  FrameState<Scalar>& inlet = ws.frame(receiver);
  hand_on<scene>(A, hg, state.c, state.r, inlet);
  for (const TriplePair<Scalar>& largest_of_frame : size) { pass_size(largest_of_frame, state.r, inlet); }
  if (losing || weak) [[unlikely]] { pass_loss(&ws.frame(node.frame), state, scale_of_A, along, weak, inlet); }
}

/// A subsystem without internal velocities hands on what it carries.
template <Scene scene, class S, class Workspace>
void rigid_inward(const Node& node, NodeState<S>& state, Workspace& ws)
{
  using Scalar = typename S::Scalar;
  if (node.inlet < 0) {
    if constexpr (Workspace::update == Update::square_root) {
      for (int k = 0; k < S::n_frames; ++k) { ws.rows(node.frame + k).count = 0; }
    }
    return;
  }
  [[maybe_unused]] FrameState<Scalar>& inlet = ws.frame(node.inlet);
#pragma GCC unroll 2
  for (int k = 0; k < S::n_frames; ++k) {
    FrameState<Scalar>& f = ws.frame(node.frame + k);
    if constexpr (Workspace::update == Update::square_root) {
      share_axis<S>(node, state, false, ws);
      put_wrench<S>(node, state, TriplePair<Scalar>(f.inertia().h.data()), Scalar(0), ws);
      in_one_function<Scalar>([&] { fixed_root_inward<scene>(node, state, k, ws); });
      ws.rows(node.frame + k).count = 0;
    } else {
      Carried<Scalar> all;
      if constexpr (is_several<Scalar>) {
        all = carried_at(f);
      } else {
        all = own_bodies<S, scene.velocity>(ws.tree().frame_mass(node.frame + k), f);
        add_arrived(f, all);
      }
      const TriplePair<Scalar> size = largest(f, all.A);
      keep(all, f);
      if (k == 0) { add_inlet_bodies<scene>(node, state, ws, all.A, all.h); }
      hand_on<scene>(all.A, all.h, state.c, state.r, inlet);
      pass_size(size, state.r, inlet);
      if (f.loses) [[unlikely]] { add_loss(f.inertia().loss, state.r, inlet); }
    }
  }
}

/// What of the scene a step of S sees.
template <class S>
constexpr Scene scene_inward(Scene scene)
{
  scene.implicit = scene.implicit && spring_count<S>() > 0;
  return without_gravity(scene);
}

/// scene: scene_inward. Workspace: its part that depends on Scalar and update alone.
template <Scene scene, class S, class Workspace>
void inward(const Node& node, const S& s, NodeState<S>& state, Workspace& ws, Diagnosis& diagnosis,
            [[maybe_unused]] typename S::Scalar& largest_inverse)
{
  if constexpr (Workspace::update == Update::square_root) {
    if constexpr (S::n_i == 0) {
      rigid_inward<scene>(node, state, ws);
    } else {
      square_root_inward<scene>(node, s, state, ws, diagnosis);
    }
  } else {
    Index receiver = node.inlet;
    if (node.inlet >= 0) {
      if constexpr (turns_about_axis<S>()) {
        if (const auto* const limb = ws.free_limb(node.index)) [[unlikely]] {
          const auto& axis = ws.free_axis_of(*limb);
          if (axis.receiver >= 0) {
            receiver = axis.receiver;
            if (limb == &ws.limbs(axis).back()) { ws.frame(receiver).arrived = false; }
          }
        }
      }
    }
    if constexpr (is_several<typename S::Scalar>) {
      for (int k = 0; k < S::n_frames; ++k) { arrive<scene.velocity>(node.frame + k, ws); }
      if (receiver >= 0) { arrive<scene.velocity>(receiver, ws); }
    }
    TurnedStep<Workspace> step;
    const bool turned = ws.axes().turned();
    if (turned) [[unlikely]] { step.enter(node.frame, node.inlet, receiver, StepData(state), ws); }
    if constexpr (S::n_i == 0) {
      rigid_inward<scene>(node, state, ws);
    } else if constexpr (is_free<S>()) {
      free_matrix_inward<scene>(node, state, ws, diagnosis, largest_inverse);
    } else {
      matrix_inward<scene>(node, receiver, s, state, ws, diagnosis, largest_inverse);
    }
    if (turned) [[unlikely]] {
      step.leave(node.frame, node.inlet, receiver, StepData(state), ws);
      if constexpr (is_free<S>()) {
        FreeAxis<typename S::Scalar>& axis = *ws.free_axis(node.frame);
        step.turn_to_world(ws.frame(node.frame).Vdot.data(), 2);
        step.turn_to_world(axis.rest.data(), 2);
        step.turn_to_world(axis.E.data(), 12);
      }
      if (receiver != node.inlet) {
        FreeLimb<typename S::Scalar>& limb = *ws.free_limb(node.index);
        step.turn_to_inlet(limb.S.data(), 2);
        step.turn_to_inlet(limb.held.data(), 2);
      }
    }
  }
}

}  // namespace iim::detail
