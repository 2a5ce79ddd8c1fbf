// What a limb of a free frame hands on to it along the first joint's axis, apart from all else: free_inward.hpp says
// why.
#pragma once

#include <iim/pass/articulated_inertia.hpp>
#include <iim/pass/carried.hpp>
#include <iim/pass/free_axis.hpp>
#include <iim/pass/internal_inertia.hpp>
#include <iim/pass/kinematics.hpp>
#include <iim/pass/roundings.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>
#include <iim/workspace.hpp>

#include <array>
#include <cstddef>

namespace iim::detail {

/// To what limbs along the axis hand on, A, h and size of what else the frame f carries.
template <class Scalar>
[[gnu::always_inline]] inline void complete_axis(const SpatialInertia<Scalar>& A, const TriplePair<Scalar>& h,
                                                 FreeAxis<Scalar>& axis)
{
  const TriplePair<Scalar> S(axis.S.data());
  TriplePair<Scalar> a(axis.held.data());
  a += A.of_linear(S.linear);
  a += A.of_angular(S.angular);
  a.put(axis.held.data());
  axis.force += dot(S, h);
}
template <class Scalar>
[[gnu::always_inline]] inline void complete_axis(const FrameState<Scalar>& f, FreeAxis<Scalar>& axis)
{
  const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
  axis.size = {zero, zero};
  axis.loss = Scalar(0);
  if (!f.arrived) { return; }
  complete_axis(f.inertia().A, TriplePair<Scalar>(f.inertia().h.data()), axis);
  axis.size = largest(f, f.inertia().A);
  if (f.loses) [[unlikely]] { axis.loss = dot(TriplePair<Scalar>(axis.S.data()), f.inertia().loss); }
}

/// What the limbs along the axis hand on along S.
template <class Scalar, class Workspace>
[[gnu::noinline]] void take_limbs(const Workspace& ws, FreeAxis<Scalar>& axis)
{
  const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
  TriplePair<Scalar> held(zero, zero);
  axis.force = axis.within = Scalar(0);
  for (const FreeLimb<Scalar>& limb : ws.limbs(axis)) {
    const TriplePair<Scalar> of_limb(limb.held.data());
    if (limb.sense == Sense::opposite) {
      held -= of_limb;
    } else {
      held += of_limb;
    }
    axis.force += in_sense(limb.sense, limb.force);
    axis.within += limb.within;
    if (limb.child == axis.child) { axis.S = limb.S; }
  }
  held.put(axis.held.data());
}

/// Of a limb along the axis, which begins with s, at the step inward of s. U: A S of what its frame carries. h_q: its
/// bias force without the load.
template <Scene scene, class S, class Workspace>
[[gnu::noinline]] void set_limb(const Node& node, const S& s, const NodeState<S>& state, const SpunRotors<S>& spun,
                                const TriplePair<typename S::Scalar>& U, const typename S::Scalar& h_q, Workspace& ws,
                                FreeLimb<typename S::Scalar>& limb)
{
  using Scalar = typename S::Scalar;
  static_assert(S::n_i == 1 && S::n_frames == 1);
  const Scalar load = ws.load()(node.v);
  const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
  SpatialInertia<Scalar> A_body;  // on the inlet
  TriplePair<Scalar> h_body(zero, zero);
  A_body.set_zero();
  add_inlet_bodies<scene>(node, state, ws, A_body, h_body);
  const TriplePair<Scalar> own(state.S_k[0].data()), W(state.W.data());
  TriplePair<Scalar> held = times(A_body, own);
  limb.force = dot(own, h_body);
  Scalar left(0);  // M̄_R (1 − W S)
  // A rotor adds J gᵀg, g = (0, aᵀ, e); z = (0; a) − Wᵀ e is what of it follows the guidance, and Σ J (zᵀS) z of all,
  // with zᵀS written as what it is for W S = 1, is A' S. Of geared rotors next to nothing is left of z as a difference:
  // M̄_R z = (0; a) SᵀU − U e + Σ J_j e_j (a e_j − a_j e) over the other rotors, and springs. (Gear 1000, 10⁻³ kg m² on
  // a link of 10⁻³: the column of a moment on the base 222 ε as a difference.)
  struct Within {
    Scalar J, e;
    Triple<Scalar> a;
  };
  std::array<Within, static_cast<std::size_t>(rotor_count<S>() + (scene.implicit ? spring_count<S>() : 0))> within;
  if constexpr (rotor_count<S>() > 0) {
    for (std::size_t k = 0; k < spun.size(); ++k) { within[k] = {spun[k].J, spun[k].e(0), spun[k].a}; }
  }
  if constexpr (scene.implicit) {
    std::size_t k = static_cast<std::size_t>(rotor_count<S>());
    for (const auto& spring : state.springs) { within[k++] = {spring.inertia, spring.ratio(0), zero}; }
  }
  const Scalar moved = dot(own, U);
  for (std::size_t k = 0; k < within.size(); ++k) {
    const Within& g = within[k];
    const Scalar slip = g.J * (dot(g.a, own.angular) - g.e), share = slip * state.MbarR_inv(0, 0);
    TriplePair<Scalar> z = U * (Scalar(0) - g.e);
    z.angular += g.a * moved;
    for (std::size_t j = 0; j < within.size(); ++j) {
      if (j != k) { z.angular += (g.a * within[j].e - within[j].a * g.e) * (within[j].J * within[j].e); }
    }
    held += z * share;
    left -= slip * g.e;
    if constexpr (scene.velocity && rotor_count<S>() > 0) {
      if (k < spun.size()) {
        limb.force += slip * spun[k].bias;
        if (s.rotors()[k].frame < 0) { limb.force += dot(own.angular, spun[k].moment); }
      }
    }
  }
  limb.slip = left * state.MbarR_inv(0, 0);
  // (Stiff springs and geared rotors hold nearly all: of 1 − slip nothing would be left. Ratio 10³ on a rotor of 10⁻²
  // kg m²: one motor's column 2.5e3 ε; implicit steps of 0.1 s, springs up to 10⁹ N m/rad: B̂ 1.5e4, q̈₀ 4.6e5 ε.)
  limb.undone = if_greater(limb.slip, Scalar(0.5), dot(W, own), Scalar(Scalar(1) - limb.slip));
  limb.force += limb.slip * h_q + limb.undone * load;
  if constexpr (scene.velocity) { limb.force += dot(held.linear, triple(state.c)); }
  limb.within = dot(own, held);
  held.angular += cross(triple(state.r), held.linear);
  held.put(limb.held.data());
  TriplePair<Scalar> S_free = own;
  S_free.linear = own.linear - cross(own.angular, triple(state.r));
  S_free.put(limb.S.data());
  FreeAxis<Scalar>& axis = ws.free_axis_of(limb);
  if (axis.receiver < 0) {
    take_limbs(ws, axis);
    complete_axis(ws.frame(node.inlet), axis);
  }
}

}  // namespace iim::detail
