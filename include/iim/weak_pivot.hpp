// Pivots that are small against the inertia that they stand in, in the projected form.
//
// Where thin parts lie along a joint's axis, as a wrist that is stretched along the forearm, D = Sᵀ A S is a difference of large
// entries of A, and wrong by ‖A‖/D roundings; with D all that M⁻¹ says of this joint. By Gauss's principle D is also
//
//     D = Σ_b a_bᵀ I_b a_b + Σ_r J_r (g_r a)²,        a: q̈_i = 1, and beyond it q̈_j = −W_j y_j
//
// over all bodies and rotors from the joint on, that is what the joint moves where the joints beyond it are free. Of all motions
// beyond this is the least such sum, so that errors of W count by their squares only; it has no differences, and the moments of a
// body meet the motion in its own axes.
//
// A' = PᵀA P would bring the roundings of A along S in again, times ‖W‖². As A' S = 0, it is taken across S alone:
//
//     A' = E (A − ½ (U W + Wᵀ Uᵀ)) E,        E = 1 − S Sᵀ
//
// which is for the first weak pivot on the way inward: behind it, and where D is smaller by far, as under heavy loads, the
// roundings of A, U and D hang together, and are better left together (masses × 10 per link, 12 links: a hundred times worse with
// this than without).
//
// Measured (double, B̂, worst of 1000 random states in ε): an arm of six axes whose wrist is of light thin links 61, with this 15;
// a robot with two arms of seven 27 and 9. Where a pivot's roundings would not be seen beside larger parts of M⁻¹ nothing is done:
// of the robots tried up to one pass in six has such a pivot, of a biped without gears one in three, and chains and trees have none.
#pragma once

#include <iim/articulated_inertia.hpp>
#include <iim/carried.hpp>
#include <iim/internal_inertia.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>
#include <iim/workspace.hpp>

#include <array>
#include <cstddef>

namespace iim::detail {

/// Σ_b a_bᵀ I_b a_b + Σ_r J_r (g_r a)² over what hangs on a subsystem, for unit acceleration of its joint. The pass, which knows
/// the types of the tree, adds it up (sum_beyond); the steps know this alone.
template <class Scalar>
struct SumBeyond {
  void* pass;
  Scalar (*of)(void* pass, const Node& node);
  Scalar largest = Scalar(0);  ///< of all M̄_R⁻¹ of one velocity so far, which ‖M⁻¹‖ is not less than

  Scalar operator()(const Node& node) const { return of(pass, node); }
};

/// a_bᵀ I_b a_b of the body on a frame. a: acceleration of the frame at its coupling point.
template <class Scalar>
[[gnu::noinline]] Scalar square_of(const FrameMass<Scalar>& body, const Matrix3<Scalar>& R, const Vector3<Scalar>& r,
                                   const Vector6<Scalar>& a)
{
  if (!body.present) { return Scalar(0); }
  const TriplePair<Scalar> at(a.data());
  const Triple<Scalar> centre = triple(r) + combined(R, body.com);
  const Triple<Scalar> v = at.linear + cross(at.angular, centre);
  const Vector3<Scalar> omega(dot(column(R, 0), at.angular), dot(column(R, 1), at.angular), dot(column(R, 2), at.angular));
  return body.mass * dot(v, v) + dot(triple(omega), combined(body.central_inertia, omega));
}

/// One subsystem's share of the sum; leaves the accelerations of its frames in FrameState::Vdot, as it found its inlet's there.
template <Scene scene, class S, class Data>
typename S::Scalar share_of_sum(const Node& node, const S& s, const NodeState<S>& state, Data& ws)
{
  using Scalar = typename S::Scalar;
  if constexpr (is_free<S>()) {  // stays where it is
    ws.frame(node.frame).Vdot.setZero();
    return Scalar(0);
  } else {
    const Vector6<Scalar> y = shift_twist(state.r, ws.frame(node.inlet).Vdot);
    Scalar sum = square_of(ws.tree().inlet_mass(node.index), state.R, Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(0)), y);
    Velocities<S> qdd;
    for (int d = 0; d < S::n_i; ++d) {
      qdd(d) = Scalar(0);
      for (int i = 0; i < 6; ++i) { qdd(d) -= state.W(d, i) * y(i); }
    }
    const auto add = [&](const Scalar& inertia, Scalar rate, const auto& ratio) {
      for (int d = 0; d < S::n_i; ++d) { rate += ratio(d) * qdd(d); }
      sum += inertia * (rate * rate);
    };
    if constexpr (rotor_count<S>() > 0) {
      for (const auto& rotor : s.rotors()) {
        const auto spun = spin_rotor<Scene{.velocity = false}>(node, rotor, state, ws);
        add(spun.J, dot(triple(spun.a), triple(angular(y))), spun.e);
      }
    }
    if constexpr (scene.implicit) {
      for (const auto& spring : state.springs) { add(spring.inertia, Scalar(0), spring.ratio); }
    }
    for (int k = 0; k < S::n_frames; ++k) {
      FrameState<Scalar>& f = ws.frame(node.frame + k);
      f.Vdot = y;
      if constexpr (S::n_i > 0) {
        const auto& S_k = state.S_k[static_cast<std::size_t>(k)];
        for (int d = 0; d < S::n_i; ++d) {
          for (int i = S::pattern.linear ? 0 : 3; i < (S::pattern.angular ? 6 : 3); ++i) { f.Vdot(i) += S_k(i, d) * qdd(d); }
        }
      }
      sum += square_of(ws.tree().frame_mass(node.frame + k), f.R, f.r, f.Vdot);
    }
    return sum;
  }
}

/// Whether the steps of S do so: of a joint that moves one frame along one unit column, turning it or sliding, without springs of
/// its own (an implicit step adds their inertia to D).
template <class S, class Data>
constexpr bool mends_pivots()
{
  if constexpr (Data::update == Update::projected && !bodies_first<typename S::Scalar>) {
    return has_own_twist<S>() && spring_count<S>() == 0 && S::pattern.linear != S::pattern.angular;
  }
  return false;
}

/// S in all six rows.
template <class S>
Vector6<typename S::Scalar> unit_column(const NodeState<S>& state)
{
  using Scalar = typename S::Scalar;
  Vector6<Scalar> column;
  for (int i = 0; i < 6; ++i) { column(i) = (i < 3 ? S::pattern.linear : S::pattern.angular) ? state.S_k[0](i, 0) : Scalar(0); }
  return column;
}

/// D of a pivot D that is small against `scale`, if it is one of those above; else 0. (By value: what a function that is not
/// inlined may write to would not stay in registers.)
template <class S, class Data>
[[gnu::noinline]] typename S::Scalar mended_pivot(const Node& node, const NodeState<S>& state,
                                  const std::array<SpunRotor<S>, static_cast<std::size_t>(rotor_count<S>())>& spun,
                                  const typename S::Scalar scale, const SumBeyond<typename S::Scalar>& sum_beyond, Data& ws,
                                  const typename S::Scalar D)
{
  using Scalar = typename S::Scalar;
  constexpr Index most_subsystems = 32;  // what is summed takes as long as the step of one joint for every two
  const Scalar least(1.0 / 512);         // of scale
  const Index beyond = node.subtree_end - node.index - 1;
  FrameState<Scalar>& f = ws.frame(node.frame);
  if (beyond == 0 || beyond > most_subsystems || f.loses || ws.axes().of(node.frame) != nullptr) { return Scalar(0); }
  if (!ScalarTraits<Scalar>::is_positive(D - least * scale)) { return Scalar(0); }
  // What the roundings of this pivot would be in M⁻¹, against the larger parts of it.
  if (!ScalarTraits<Scalar>::is_positive(scale - Scalar(2) * D * D * sum_beyond.largest)) { return Scalar(0); }
  for (const SpunRotor<S>& rotor : spun) {  // A' S = 0 is for joints without inertia of their own
    if (!(rotor.J == Scalar(0))) { return Scalar(0); }
  }
  f.Vdot = unit_column(state);
  return state.own.D + sum_beyond(node);
}

/// A' of such a pivot.
template <class Scalar>
[[gnu::noinline]] SpatialInertia<Scalar> across(SpatialInertia<Scalar> A, const Vector6<Scalar>& S, TriplePair<Scalar> U,
                                                TriplePair<Scalar> W)
{
  Matrix6<Scalar> T = A.dense();
  for (int j = 0; j < 6; ++j) {
    for (int i = 0; i < 6; ++i) { T(i, j) -= Scalar(0.5) * (U(i) * W(j) + W(i) * U(j)); }
  }
  // E T E = T − S xᵀ − x Sᵀ, x = T S − ½ (Sᵀ T S) S
  Vector6<Scalar> x;
  Scalar twice(0);
  for (int i = 0; i < 6; ++i) {
    x(i) = Scalar(0);
    for (int j = 0; j < 6; ++j) { x(i) += T(i, j) * S(j); }
    twice += S(i) * x(i);
  }
  for (int i = 0; i < 6; ++i) { x(i) -= Scalar(0.5) * twice * S(i); }
  SpatialInertia<Scalar> result;
  for (int j = 0; j < 3; ++j) {
    for (int i = 0; i < 3; ++i) {
      result.M(i, j) = T(i, j) - (S(i) * x(j) + x(i) * S(j));
      result.H(i, j) = T(i, j + 3) - (S(i) * x(j + 3) + x(i) * S(j + 3));
      result.J(i, j) = T(i + 3, j + 3) - (S(i + 3) * x(j + 3) + x(i + 3) * S(j + 3));
    }
  }
  return result;
}

}  // namespace iim::detail
