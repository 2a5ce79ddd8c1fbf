// The inward loop of the O(n) pass for one subsystem, (14)–(17): what the tree beyond a coupling point looks like from
// there. In matrix form (Update::printed, projected) by joint_step.hpp and free_inward.hpp, in square-root form by
// inward_root.hpp.
#pragma once

#include <iim/pass/carried.hpp>
#include <iim/pass/free_inward.hpp>
#include <iim/pass/joint_step.hpp>
#include <iim/pass/kinematics.hpp>
#include <iim/pass/roundings.hpp>
#include <iim/pass/turned_step.hpp>
#include <iim/spatial.hpp>
#include <iim/square_root/inward_root.hpp>
#include <iim/subsystem.hpp>
#include <iim/workspace.hpp>

namespace iim::detail {

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
        own_bodies<S, scene.velocity>(ws.tree().frame_mass(node.frame + k), f, all);
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
