// q̈₀ at a state, q̈ under inputs, and the same over an implicit step: the O(n) pass (forward_pass.hpp) as functions.
#pragma once

#include <iim/pass/forward_pass.hpp>
#include <iim/pass/kinematics.hpp>
#include <iim/receipt.hpp>

namespace iim {

namespace detail {

template <Scene scene, class Workspace, class Q, class V>
ForwardDynamics<Workspace> run_pass(const Q& q, const V& qd, const typename Workspace::Scalar& step,
                                    Workspace& workspace)
{
  ForwardPass<scene, Workspace> pass(workspace, step);
  if (pass.fits(q, qd)) {
    pass.out_and_in(q, qd, [] {});
    pass.accelerations();
  }
  return pass.receipt();
}

template <Scene scene, class Workspace, class Q, class V, class InputsType, class U>
Acceleration<typename Workspace::Scalar> run_pass(const Q& q, const V& qd, const typename Workspace::Scalar& step,
                                                  const InputsType& inputs, const U& u, Workspace& workspace)
{
  ForwardPass<scene, Workspace> pass(workspace, step);
  if (pass.fits(q, qd) && pass.takes(inputs, u)) {
    pass.out_and_in(q, qd, [&] { pass.apply(inputs, u); });
    pass.accelerations();
  }
  return pass.acceleration();
}

/// The first loop of the pass alone: the receipt is for methods that need M̄*, W and q̈₀ of no subsystem.
template <Scene scene, class Workspace, class Q, class V>
ForwardDynamics<Workspace> run_kinematics(const Q& q, const V& qd, Workspace& workspace)
{
  ForwardPass<scene, Workspace> pass(workspace);
  if (pass.fits(q, qd)) { kinematics<scene>(q, qd, workspace, pass.diagnosis()); }
  return pass.receipt();
}

/// The same scene with springs at the end of the step.
constexpr Scene implicit(Scene scene)
{
  scene.implicit = true;
  return scene;
}

}  // namespace detail

/// q̈₀ of the tree at the state (q, q̇), and in the workspace all that the input-Jacobian methods need. O(n).
/// q, q̇: dense vectors of n_q and n_v entries. Does not allocate or throw; a state that cannot be computed comes back
/// as a status.
template <Scene scene = Scene{}, class Workspace, class Q, class V>
ForwardDynamics<Workspace> forward_dynamics(const Eigen::MatrixBase<Q>& q, const Eigen::MatrixBase<V>& qd,
                                            Workspace& workspace)
{
  static_assert(!scene.implicit, "implicit_step(q, qd, step, workspace) says how long the step is");
  return detail::run_pass<scene>(q.derived(), qd.derived(), typename Workspace::Scalar(0), workspace);
}

/// q̈ of the tree at the state (q, q̇) under the inputs u (as many as inputs.columns()). O(n).
template <Scene scene = Scene{}, class Workspace, class Q, class V, class InputsType, class U>
Acceleration<typename Workspace::Scalar> forward_dynamics(const Eigen::MatrixBase<Q>& q, const Eigen::MatrixBase<V>& qd,
                                                          const InputsType& inputs, const Eigen::MatrixBase<U>& u,
                                                          Workspace& workspace)
{
  static_assert(!scene.implicit, "implicit_step(q, qd, step, inputs, u, workspace) says how long the step is");
  return detail::run_pass<scene>(q.derived(), qd.derived(), typename Workspace::Scalar(0), inputs, u.derived(),
                                 workspace);
}

/// Mean accelerations over a step of length h > 0 [s], with the springs and dampers of the subsystems (`springs`) at
/// its end and all else as it is now: the linearly implicit Euler step
///
///     (M + h C + h² K) q̈₀ = −h̄(q, q̇) − h K q̇,      q̇⁺ = q̇ + h (q̈₀ + B̂u),      q⁺ = q + h q̇⁺,
///
/// stable whatever the stiffness. h C + h² K lies in the blocks M̄_R of (17), so the same pass serves, and every method
/// that is applied to the receipt returns B̂ = (M + h C + h² K)⁻¹ B: h B̂u is what the inputs add to the velocities in
/// the step. (GlobalInverse, UnitForcePublished, EquationsOfMotion and Tasks need Scene{.implicit = true} as template
/// argument.) First order in h. As forward_dynamics otherwise; a step that is negative or not finite is
/// Status::invalid_state.
template <Scene scene = Scene{}, class Workspace, class Q, class V>
ForwardDynamics<Workspace> implicit_step(const Eigen::MatrixBase<Q>& q, const Eigen::MatrixBase<V>& qd,
                                         const typename Workspace::Scalar& step, Workspace& workspace)
{
  return detail::run_pass<detail::implicit(scene)>(q.derived(), qd.derived(), step, workspace);
}

/// The same under the inputs u.
template <Scene scene = Scene{}, class Workspace, class Q, class V, class InputsType, class U>
Acceleration<typename Workspace::Scalar> implicit_step(const Eigen::MatrixBase<Q>& q, const Eigen::MatrixBase<V>& qd,
                                                       const typename Workspace::Scalar& step, const InputsType& inputs,
                                                       const Eigen::MatrixBase<U>& u, Workspace& workspace)
{
  return detail::run_pass<detail::implicit(scene)>(q.derived(), qd.derived(), step, inputs, u.derived(), workspace);
}

}  // namespace iim
