// The outward kinematic loop of the O(n) pass: orientations, Jacobians, velocity terms (8), (19), and bodies (A1),
// (A2).
#pragma once

#include <iim/errors.hpp>
#include <iim/pass/articulated_inertia.hpp>
#include <iim/scene.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>
#include <iim/workspace.hpp>

#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

namespace iim::detail {

/// What went wrong first.
struct Diagnosis {
  Status status = Status::ok;
  Index subsystem = -1;

  void fail(Status what, Index where)
  {
    if (status == Status::ok) {
      status = what;
      subsystem = where;
    }
  }
};

/// What of the scene the first two loops see: a step that no term of it changes is compiled once for all scenes.
constexpr Scene without_gravity(Scene scene)
{
  scene.gravity = true;
  return scene;
}

/// Rows first … first + 2 of S q̇: velocity of a frame relative to the inlet.
template <int first, class Scalar, int n>
[[gnu::always_inline]] inline Triple<Scalar> relative(const Eigen::Matrix<Scalar, 6, n>& S_k,
                                                      const Eigen::Matrix<Scalar, n, 1>& qd)
{
  if constexpr (n == 0) {
    return Triple<Scalar>(Scalar(0), Scalar(0), Scalar(0));
  } else {
    Triple<Scalar> v = Triple<Scalar>(S_k.data() + first) * qd(0);
#pragma GCC unroll 8
    for (int d = 1; d < n; ++d) { v += Triple<Scalar>(S_k.data() + 6 * d + first) * qd(d); }
    return v;
  }
}

/// Where `motion` writes: the frames of the subsystem in the workspace.
template <class S, class Workspace, std::size_t... K>
std::array<FrameMotion<typename S::Scalar, S::n_i>, S::n_frames> frame_motions(Index first, NodeState<S>& state,
                                                                               Workspace& ws, std::index_sequence<K...>)
{
  return {{{ws.frame(first + static_cast<Index>(K)).R, ws.frame(first + static_cast<Index>(K)).r, state.S_k[K],
            ws.frame(first + static_cast<Index>(K)).bias}...}};
}

/// bias = turning, plus what `motion` has left there.
template <bool has_own, class Scalar>
[[gnu::always_inline]] inline void add_bias(const Triple<Scalar>& turning, Scalar* bias)
{
  if constexpr (has_own) {
    (turning + Triple<Scalar>(bias)).put(bias);
  } else {
    turning.put(bias);
  }
}

/// Whether a frame of S has a bias acceleration in the linear (0) or angular (3) rows.
template <Scene scene, class S>
constexpr bool has_bias(int rows)
{
  return scene.velocity && (S::pattern.bias || (rows == 0 ? S::pattern.linear : S::pattern.angular));
}

/// Springs at the end of a step h: f(q + h q̇ + h² q̈, q̇ + h q̈) = f + h K q̇ + (h C + h² K) q̈ to first order, f: internal
/// forces. `apart`: a spring's force stays with it (square_root.hpp); what is then left of f, if more than roundings,
/// and the forces that stay with none, is subtracted from the loads.
template <bool apart, class Springs, class S, class Load>
void stretch(const Springs& springs, const Velocities<S>& qd, const typename S::Scalar& step, Velocities<S> f,
             NodeState<S>& state, Load load)
{
  using std::abs;
  using Scalar = typename S::Scalar;
  Velocities<S> size = f.cwiseAbs();
  for (std::size_t k = 0; k < springs.size(); ++k) {
    const auto& spring = springs[k];
    const Scalar h_stiffness = step * spring.stiffness;
    Scalar rate(0);
#pragma GCC unroll 8
    for (int d = 0; d < S::n_i; ++d) { rate += spring.ratio(d) * qd(d); }
    SpringInertia<Scalar, S::n_i>& own = state.springs[k];
    own.ratio = spring.ratio;
    own.inertia = step * (spring.damping + h_stiffness);
    own.force = Scalar(0);
    Scalar more = h_stiffness * rate;
    if (apart && own.inertia > Scalar(0)) {
      own.force = spring.force + more;
      more = -spring.force;
    }
#pragma GCC unroll 8
    for (int d = 0; d < S::n_i; ++d) {
      f(d) += spring.ratio(d) * more;
      size(d) += abs(spring.ratio(d) * more);
    }
  }
  const Scalar roundings = Scalar(16) * Eigen::NumTraits<Scalar>::epsilon();
#pragma GCC unroll 8
  for (int d = 0; d < S::n_i; ++d) {
    if (!apart || !(abs(f(d)) <= roundings * size(d))) { load(d) -= f(d); }
  }
}

/// From the base outward: orientations, Jacobians, velocity terms; in square-root form, the bodies in world axes. Of
/// one subsystem.
template <Scene scene, class Data, class Q, class V>
struct KinematicStep {
  using Scalar = typename Data::Scalar;
  const Q& q;
  const V& qd;
  Data& ws;
  Diagnosis& diagnosis;
  const Scalar& step;  ///< of an implicit step [s]

  template <class S>
  void operator()(const Node& node, const S& s, NodeState<S>& state) const
  {
    const Triple<Scalar> omega = begin_at_inlet(node, state);
    Coordinates<S> q_i;
    Velocities<S> qd_i;
#pragma GCC unroll 8
    for (int d = 0; d < S::n_q; ++d) { q_i(d) = q(node.q + d); }
#pragma GCC unroll 8
    for (int d = 0; d < S::n_i; ++d) {
      if constexpr (scene.velocity) {
        qd_i(d) = qd(node.v + d);
      } else {
        qd_i(d) = Scalar(0);
      }
    }
    if (!all_finite(q_i) || !all_finite(qd_i)) { diagnosis.fail(Status::invalid_state, node.index); }

    auto frames = frame_motions<S>(node.frame, state, ws, std::make_index_sequence<S::n_frames>{});
    if constexpr (scene.velocity && S::pattern.bias) {  // what the pass before left there is not for `motion` to remove
      for (int k = 0; k < S::n_frames; ++k) { ws.frame(node.frame + k).bias.setZero(); }
    }
    const Matrix3<Scalar>& R = ws.inlet_axes(node, state);
    bool moved = false;
    if constexpr (takes_turn<S>()) {
      moved = s.motion(R, ws.turns().of(node.q, q_i(0)), qd_i, frames);
    } else {
      moved = s.motion(R, q_i, qd_i, frames);
    }
    if (!moved) { diagnosis.fail(Status::invalid_state, node.index); }
    if (ws.tree().straightens(node.index)) {
      for (int k = 0; k < S::n_frames; ++k) { straighten(ws.frame(node.frame + k).R); }
    }
    if constexpr (is_free<S>() || follows_frame<S>()) { go_to_frame(node, R, q_i, omega, state); }
    if constexpr (rotor_count<S>() > 0) { state.qd = qd_i; }

#pragma GCC unroll 2
    for (int k = 0; k < S::n_frames; ++k) {
      FrameState<Scalar>& f = ws.frame(node.frame + k);
      if constexpr (scene.velocity) { set_velocity<S>(state.S_k[static_cast<std::size_t>(k)], omega, qd_i, f); }
      if constexpr (Data::update == Update::square_root) {
        put_roots<S>(node.frame + k, state, f);
      } else {
        f.arrived = false;
        f.loses = false;
      }
    }
    put_forces(node, s, q_i, qd_i, state);
  }

private:
  /// r, and where the inlet's axes are kept R; c; returns the inlet's ω.
  template <class S>
  [[gnu::always_inline]] Triple<Scalar> begin_at_inlet(const Node& node, NodeState<S>& state) const
  {
    const Placement<Scalar>& at = ws.tree().placement(node.index);
    Triple<Scalar> omega(Scalar(0), Scalar(0), Scalar(0));
    if (node.inlet < 0) {
      state.r = at.p;
      return omega;
    }
    const FrameState<Scalar>& inlet = ws.frame(node.inlet);
    if (ws.keeps_inlet_axes(node.index)) {
      if (ws.tree().placement_turns(node.index)) {
        multiply(inlet.R, at.R, state.R);
      } else {
#pragma GCC unroll 8
        for (int j = 0; j < 3; ++j) { column(inlet.R, j).put(state.R.data() + 3 * j); }
      }
    }
    const Triple<Scalar> r = Triple<Scalar>(inlet.r.data()) + combined(inlet.R, at.p);
    r.put(state.r.data());
    if constexpr (scene.velocity) {
      omega = Triple<Scalar>(inlet.omega.data());
      if constexpr (!is_free<S>() && !follows_frame<S>()) { cross(omega, cross(omega, r)).put(state.c.data()); }
    }
    return omega;
  }

  /// The coupling point to where the frame is; of a free frame, W.
  template <class S>
  [[gnu::always_inline]] void go_to_frame(const Node& node, const Matrix3<Scalar>& R, const Coordinates<S>& q_i,
                                          const Triple<Scalar>& omega, NodeState<S>& state) const
  {
    if constexpr (is_free<S>()) {
      add(state.r, times(R, Vector3<Scalar>(q_i(0), q_i(1), q_i(2))));
      for (int i = 0; i < 3; ++i) { state.r(i) -= ws.frame(node.frame).r(i); }
      const auto& S_0 = state.S_k[0];
#pragma GCC unroll 8
      for (int d = 0; d < 3; ++d) {
#pragma GCC unroll 8
        for (int i = 0; i < 3; ++i) {  // S⁻¹
          state.W(d, i) = state.W(d + 3, i + 3) = S_0(i, d);
          state.W(d, i + 3) = S_0(i, d + 3);
        }
      }
    } else {
      add(state.r, ws.frame(node.frame).r);
      ws.frame(node.frame).r.setZero();
    }
    if constexpr (scene.velocity) {
      if (node.inlet >= 0) { cross(omega, cross(omega, triple(state.r))).put(state.c.data()); }
    }
  }

  /// ω of a frame, and the accelerations that come with the inlet turning. omega: the inlet's.
  template <class S>
  [[gnu::always_inline]] void set_velocity(const Eigen::Matrix<Scalar, 6, S::n_i>& S_k, const Triple<Scalar>& omega,
                                           const Velocities<S>& qd_i, FrameState<Scalar>& f) const
  {
    constexpr MotionPattern pattern = S::pattern;
    Triple<Scalar> spin = omega;
    if constexpr (pattern.linear) {
      const Triple<Scalar> coriolis = cross(omega, relative<0>(S_k, qd_i)) * Scalar(2);
      add_bias<pattern.bias>(coriolis, f.bias.data());
    }
    if constexpr (pattern.angular) {
      const Triple<Scalar> w = relative<3>(S_k, qd_i);
      add_bias<pattern.bias>(cross(omega, w), f.bias.data() + 3);
      spin += w;
    }
    spin.put(f.omega.data());
  }

  /// In square-root form the rows of the frame's bodies, and the wrench beside them.
  template <class S>
  [[gnu::always_inline]] void put_roots(Index frame, const NodeState<S>& state, FrameState<Scalar>& f) const
  {
    RootInertia<Scalar>& N_k = ws.root(frame);
    if constexpr (along<S>() != Along::nothing) {
      TriplePair<Scalar>(state.S_k[0].data())
          .put(N_k.S.data());  // as it was written: other loads wait for these stores
      N_k.h.setZero();
      N_k.h_along = Scalar(0);
    }
    const Vector3<Scalar> at_point(Scalar(0), Scalar(0), Scalar(0));
    const BodyRoot<Scalar>& body = ws.frame_body(frame);
    place_roots<scene.velocity, along<S>()>(body, f.R, is_free<S>() ? at_point : f.r, f.omega, N_k);
    f.inertia().h.setZero();
    if constexpr (scene.velocity) {
      if (body.has_beside) [[unlikely]] { f.inertia().h.template tail<3>() = moment_beside(body, f.R, f.omega); }
    }
  }

  /// B̄, and what springs and dampers do.
  template <class S>
  [[gnu::always_inline]] void put_forces(const Node& node, const S& s, const Coordinates<S>& q_i,
                                         const Velocities<S>& qd_i, [[maybe_unused]] NodeState<S>& state) const
  {
    if constexpr (S::n_u > 0) {
      const Eigen::Matrix<Scalar, S::n_i, S::n_u> Bbar = s.Bbar(q_i);
      for (int k = 0; k < S::n_i * S::n_u; ++k) { ws.Bbar()(node.bbar + k) = Bbar.data()[k]; }
    }
    if constexpr (scene.implicit && spring_count<S>() > 0) {
      stretch<Data::update == Update::square_root>(s.springs(q_i, qd_i), qd_i, step, s.internal_force(q_i, qd_i), state,
                                                   ws.load().template segment<S::n_i>(node.v));
    } else if constexpr (has_internal_force<S>()) {
      ws.load().template segment<S::n_i>(node.v) -= s.internal_force(q_i, qd_i);
    }
  }
};

/// Of all.
template <Scene scene, class Workspace, class Q, class V>
void kinematics(const Q& q, const V& qd, Workspace& ws, Diagnosis& diagnosis,
                const typename Workspace::Scalar& step = typename Workspace::Scalar(0))
{
  ws.turns().set(q);
  const KinematicStep<without_gravity(scene), typename Workspace::Data, Q, V> kinematic_step{q, qd, ws, diagnosis,
                                                                                             step};
  ws.tree().outward([&]<class S>(const Node& node, const S& s) { kinematic_step(node, s, ws.template node<S>(node)); });
}

}  // namespace iim::detail
