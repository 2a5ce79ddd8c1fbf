// What lies inside a subsystem beside its bodies: rotors that spin, and the springs of an implicit step.
#pragma once

#include <iim/node_state.hpp>
#include <iim/pass/articulated_inertia.hpp>
#include <iim/pass/kinematics.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>
#include <iim/update.hpp>

#include <array>
#include <cstddef>

namespace iim::detail {

/// A rotor in motion. World axes.
template <class S>
struct SpunRotor {
  using Scalar = typename S::Scalar;
  Triple<Scalar> a{Scalar(0), Scalar(0), Scalar(0)};       ///< axis; zero for an armature
  Eigen::Matrix<Scalar, S::n_i, 1> e;                      ///< spin relative to the inlet per q̇_i
  Scalar J;                                                ///< axial inertia
  Scalar bias{0};                                          ///< what a·V̇ of the carrier is for y = 0 and q̈_i = 0
  Triple<Scalar> moment{Scalar(0), Scalar(0), Scalar(0)};  ///< of the spin turning with its carrier
};

template <Scene scene, class S, class RotorType, class Workspace>
[[gnu::always_inline]] inline SpunRotor<S> spin_rotor(const Node& node, const RotorType& rotor,
                                                      const NodeState<S>& state, const Workspace& ws)
{
  using Scalar = typename S::Scalar;
  SpunRotor<S> spun;
#pragma GCC unroll 8
  for (int d = 0; d < S::n_i; ++d) { spun.e(d) = rotor.ratio(d); }
  spun.J = rotor.inertia;
  if (!rotor.coupled) { return spun; }
  const bool on_inlet = rotor.frame < 0;
  spun.a = combined(settled_columns(on_inlet ? ws.inlet_axes(node, state) : ws.frame(node.frame + rotor.frame).R),
                    rotor.axis);
  if (!on_inlet) {
    const auto& S_k = state.S_k[static_cast<std::size_t>(rotor.frame)];
#pragma GCC unroll 8
    for (int d = 0; d < S::n_i; ++d) { spun.e(d) += dot(Triple<Scalar>::settled(S_k.data() + 6 * d + 3), spun.a); }
  }
  if constexpr (scene.velocity) {
    Triple<Scalar> omega(Scalar(0), Scalar(0), Scalar(0));
    if (!on_inlet) {
      const FrameState<Scalar>& f = ws.frame(node.frame + rotor.frame);
      omega = Triple<Scalar>::settled(f.omega.data());
      spun.bias = dot(spun.a, Triple<Scalar>::settled(f.bias.data() + 3));
    } else if (node.inlet >= 0) {
      omega = Triple<Scalar>::settled(ws.frame(node.inlet).omega.data());
    }
    // Spin momentum J (a·ω + ratio q̇) a turns with the carrier.
    Scalar spin = dot(spun.a, omega);
#pragma GCC unroll 8
    for (int d = 0; d < S::n_i; ++d) { spin += rotor.ratio(d) * state.qd(d); }
    spin *= spun.J;
    spun.moment = cross(omega, spun.a) * spin;
  }
  return spun;
}

template <class Scalar>
[[gnu::always_inline]] inline void add_moment(Vector6<Scalar>& wrench, const Triple<Scalar>& moment)
{
#pragma GCC unroll 8
  for (int i = 0; i < 3; ++i) { wrench(i + 3) += moment(i); }
}
template <class Scalar>
[[gnu::always_inline]] inline void add_moment(TriplePair<Scalar>& wrench, const Triple<Scalar>& moment)
{
  wrench.angular += moment;
}

/// The moment of a turning spin momentum on the guidance part and, if the carrier moves with q_i, on q_i.
template <class S, class RotorType, class Wrench>
[[gnu::always_inline]] inline void add_gyroscopic(const SpunRotor<S>& spun, const RotorType& rotor,
                                                  const NodeState<S>& state, Wrench& hg,
                                                  Eigen::Matrix<typename S::Scalar, S::n_i, 1>& hq)
{
  add_moment(hg, spun.moment);
  if (rotor.frame < 0) { return; }
  const auto& S_k = state.S_k[static_cast<std::size_t>(rotor.frame)];
#pragma GCC unroll 8
  for (int d = 0; d < S::n_i; ++d) {
    hq(d) += dot(Triple<typename S::Scalar>::settled(S_k.data() + 6 * d + 3), spun.moment);
  }
}

/// D += ratioᵀ inertia ratio.
template <class Scalar, int n_i>
[[gnu::always_inline]] inline void add_spring(const SpringInertia<Scalar, n_i>& spring,
                                              Eigen::Matrix<Scalar, n_i, n_i>& D)
{
#pragma GCC unroll 8
  for (int d = 0; d < n_i; ++d) {
#pragma GCC unroll 8
    for (int e = 0; e < n_i; ++e) { D(e, d) += spring.ratio(e) * spring.inertia * spring.ratio(d); }
  }
}

template <class S>
using SpunRotors = std::array<SpunRotor<S>, static_cast<std::size_t>(rotor_count<S>())>;

/// Whether rotors, or in an implicit step springs, have a share in M̄*.
template <bool implicit, class S>
bool has_inertia_within(const NodeState<S>& state, const SpunRotors<S>& spun)
{
  using Scalar = typename S::Scalar;
  bool has = false;
  for (const SpunRotor<S>& rotor : spun) { has |= !(rotor.J == Scalar(0)); }
  if constexpr (implicit) {
    for (const auto& spring : state.springs) { has |= !(spring.inertia == Scalar(0)); }
  }
  return has;
}
/// That share, to U and D of one velocity.
template <bool implicit, class S>
[[gnu::noinline]] void add_inertia_within(const NodeState<S>& state, const SpunRotors<S>& spun,
                                          TriplePair<typename S::Scalar>& U, typename S::Scalar& D)
{
  using Scalar = typename S::Scalar;
  for (const SpunRotor<S>& rotor : spun) {
    const Scalar Je = rotor.J * rotor.e(0);
    D += Je * rotor.e(0);
    U.angular += rotor.a * Je;
  }
  if constexpr (implicit) {
    for (const auto& spring : state.springs) { D += spring.ratio(0) * spring.inertia * spring.ratio(0); }
  }
}

/// Rotors: J gᵀg with g = (0, aᵀ, e), to U, to D and its scale, and to h. What is left of it at the guidance part waits
/// for W.
template <Scene scene, class S, class Workspace>
[[gnu::always_inline]] inline void take_rotors(const Node& node, const S& s, const NodeState<S>& state,
                                               const Workspace& ws, SpunRotors<S>& spun,
                                               SixColumns<typename S::Scalar, S::n_i>& U,
                                               Eigen::Matrix<typename S::Scalar, S::n_i, S::n_i>& D,
                                               Eigen::Matrix<typename S::Scalar, S::n_i, 1>& scale,
                                               TriplePair<typename S::Scalar>& hg,
                                               Eigen::Matrix<typename S::Scalar, S::n_i, 1>& hq)
{
  using Scalar = typename S::Scalar;
  const auto rotors = s.rotors();
  for (std::size_t k = 0; k < rotors.size(); ++k) {
    spun[k] = spin_rotor<scene, S>(node, rotors[k], state, ws);
    const Scalar Jb = spun[k].J * spun[k].bias;
#pragma GCC unroll 8
    for (int d = 0; d < S::n_i; ++d) {
      const Scalar Je = spun[k].J * spun[k].e(d);
#pragma GCC unroll 8
      for (int e = 0; e < S::n_i; ++e) { D(e, d) += Je * spun[k].e(e); }
      U[d].angular += spun[k].a * Je;
      scale(d) += Je * spun[k].e(d);
      hq(d) += Jb * spun[k].e(d);
    }
    if constexpr (scene.velocity) {
      hg.angular += spun[k].a * Jb;
      add_gyroscopic(spun[k], rotors[k], state, hg, hq);
    }
  }
}

/// Springs of an implicit step, to D and its scale.
template <class S>
[[gnu::always_inline]] inline void take_springs(const NodeState<S>& state,
                                                Eigen::Matrix<typename S::Scalar, S::n_i, S::n_i>& D,
                                                Eigen::Matrix<typename S::Scalar, S::n_i, 1>& scale)
{
  for (const auto& spring : state.springs) {
    add_spring(spring, D);
#pragma GCC unroll 8
    for (int d = 0; d < S::n_i; ++d) { scale(d) += spring.inertia * spring.ratio(d) * spring.ratio(d); }
  }
}

/// What of the rotors the parent sees, to A, and its size. all_passed_on: it has come there without W.
template <Update update, class S>
[[gnu::always_inline]] inline void hand_on_rotors(const SpunRotors<S>& spun,
                                                  const SixColumns<typename S::Scalar, S::n_i>& W, bool all_passed_on,
                                                  SpatialInertia<typename S::Scalar>& A,
                                                  TriplePair<typename S::Scalar>& size)
{
  using Scalar = typename S::Scalar;
  for (const SpunRotor<S>& rotor : spun) {
    TriplePair<Scalar> z(Triple<Scalar>(Scalar(0), Scalar(0), Scalar(0)), rotor.a);
    if constexpr (update == Update::projected) {
      if (!all_passed_on) [[likely]] {
#pragma GCC unroll 8
        for (int d = 0; d < S::n_i; ++d) { z -= W[d] * rotor.e(d); }
      }
    }
    add_square(rotor.J, z, A);
    // |z| ≤ 1 is wrong by ε.
    const Triple<Scalar> Jz = z.angular * rotor.J, zero(Scalar(0), Scalar(0), Scalar(0));
    size.angular = max(size.angular, max(Jz, zero - Jz));
  }
}

/// And of the springs, as projected.
template <class S>
[[gnu::always_inline]] inline void hand_on_springs(const NodeState<S>& state,
                                                   const SixColumns<typename S::Scalar, S::n_i>& W,
                                                   SpatialInertia<typename S::Scalar>& A)
{
  for (const auto& spring : state.springs) {
    TriplePair<typename S::Scalar> z = W[0] * spring.ratio(0);
#pragma GCC unroll 8
    for (int d = 1; d < S::n_i; ++d) { z += W[d] * spring.ratio(d); }
    add_square(spring.inertia, z, A);
  }
}

/// C b for a root C of M̄_R⁻¹, and M̄_R⁻¹ b, are written out like this throughout: y = A x, n × n.
template <class Scalar, int n>
[[gnu::always_inline]] inline Eigen::Matrix<Scalar, n, 1> product(const Eigen::Matrix<Scalar, n, n>& A,
                                                                  const Eigen::Matrix<Scalar, n, 1>& x)
{
  Eigen::Matrix<Scalar, n, 1> y;
#pragma GCC unroll 8
  for (int d = 0; d < n; ++d) {
    y(d) = A(d, 0) * x(0);
#pragma GCC unroll 8
    for (int e = 1; e < n; ++e) { y(d) += A(d, e) * x(e); }
  }
  return y;
}

}  // namespace iim::detail
