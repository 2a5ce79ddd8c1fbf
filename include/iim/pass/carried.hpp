// What a frame carries, in matrix form: its own bodies, and what hangs on it, which is handed on in the steps before
// its own.
#pragma once

#include <iim/body.hpp>
#include <iim/node_state.hpp>
#include <iim/pass/articulated_inertia.hpp>
#include <iim/pass/kinematics.hpp>
#include <iim/pass/parallel_axes.hpp>
#include <iim/spatial.hpp>

namespace iim::detail {

/// Of what comes to a frame, all but A and h, before the first of it.
template <class Scalar>
[[gnu::always_inline]] inline void clear_size(FrameState<Scalar>& f)
{
  const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
  f.inertia().size = {zero, zero};
  f.loses = false;
  f.arrived = true;
}

/// The bodies on a frame, in its axes (ParallelAxes::of).
template <bool velocity, class Scalar>
[[gnu::noinline]] void place(const FrameMass<Scalar>& body, const Matrix3<Scalar>* axes, FrameState<Scalar>& f)
{
  clear_size(f);
  FrameInertia<Scalar>& all = f.inertia();
  TriplePair<Scalar> h;
  if (axes) [[unlikely]] {
    Matrix3<Scalar> R = f.R;
    Vector3<Scalar> r = f.bodies_at(), omega = f.omega;
    turn_triples(*axes, false, R.data(), 3);
    turn_triples(*axes, false, r.data(), 1);
    turn_triples(*axes, false, omega.data(), 1);
    place_bodies<true, velocity>(body, R, triple(r), triple(omega), all.A, h);
  } else if (f.offset) {
    place_bodies<true, velocity>(body, f.R, triple(f.r), triple(f.omega), all.A, h);
  } else {
    place_bodies<false, velocity>(body, f.R, triple(f.r), triple(f.omega), all.A, h);
  }
  h.put(all.h.data());
}

/// Before anything else comes to a frame.
template <bool velocity, class Workspace>
[[gnu::always_inline]] inline void arrive(Index frame, Workspace& ws)
{
  using Scalar = typename Workspace::Scalar;
  FrameState<Scalar>& f = ws.frame(frame);
  if (f.arrived) { return; }
  if (is_several<Scalar> && frame < ws.tree().n_frames()) {
    place<velocity>(ws.tree().frame_mass(frame), ws.axes().of(frame), f);
  } else {
    clear_size(f);
    f.inertia().A.set_zero();
    f.inertia().h.setZero();
  }
}

/// All that a frame carries, in the axes of the step: its own bodies, and what has come to it.
template <class Scalar>
struct Carried {
  SpatialInertia<Scalar> A;
  TriplePair<Scalar> h;
};

/// What has come to it.
template <class Scalar>
[[gnu::always_inline]] inline Carried<Scalar> carried_at(const FrameState<Scalar>& f)
{
  return {f.inertia().A, TriplePair<Scalar>(f.inertia().h.data())};
}

/// Its own bodies.
template <class S, bool velocity, class Scalar>
[[gnu::always_inline]] inline void own_bodies(const FrameMass<Scalar>& body, const FrameState<Scalar>& f,
                                              Carried<Scalar>& own)
{
  place_bodies<is_placed_off<S>(), velocity>(body, f.R, Triple<Scalar>::settled(f.r.data()),
                                             Triple<Scalar>::settled(f.omega.data()), own.A, own.h);
}
template <class Scalar>
[[gnu::always_inline]] inline void add_arrived(const FrameState<Scalar>& f, Carried<Scalar>& all)
{
  if (!f.arrived) { return; }
  all.A += f.inertia().A;
  all.h += TriplePair<Scalar>(f.inertia().h.data());
}

/// For who looks at it: FrameInertia::A and h.
template <class Scalar>
[[gnu::always_inline]] inline void keep(const Carried<Scalar>& all, FrameState<Scalar>& f)
{
  copy(all.A, f.inertia().A);
  all.h.put(f.inertia().h.data());
}

/// The bodies that a subsystem has on its inlet. (Few have any: called.)
template <bool velocity, class Scalar>
[[gnu::noinline]] Carried<Scalar> bodies_on_inlet(const FrameMass<Scalar>& body, const Matrix3<Scalar>& R,
                                                  const Vector3<Scalar>& omega)
{
  Carried<Scalar> own;
  const Triple<Scalar> at_inlet(Scalar(0), Scalar(0), Scalar(0));
  place_bodies<false, velocity>(body, R, at_inlet, Triple<Scalar>::settled(omega.data()), own.A, own.h);
  return own;
}
template <Scene scene, class S, class Workspace>
[[gnu::always_inline]] inline void add_inlet_bodies(const Node& node, const NodeState<S>& state, const Workspace& ws,
                                                    SpatialInertia<typename S::Scalar>& A,
                                                    TriplePair<typename S::Scalar>& h)
{
  const FrameMass<typename S::Scalar>& body = ws.tree().inlet_mass(node.index);
  if (!body.present) { return; }
  const auto own = bodies_on_inlet<scene.velocity>(body, ws.inlet_axes(node, state), ws.frame(node.inlet).omega);
  A += own.A;
  h += own.h;
}

/// A S of the frame's own bodies, of a joint that moves it along one column.
template <class S>
[[gnu::always_inline]] inline TriplePair<typename S::Scalar> own_column(const NodeState<S>& state,
                                                                        const FrameState<typename S::Scalar>& f)
{
  using Scalar = typename S::Scalar;
  const auto R = settled_columns(f.R);
  TriplePair<Scalar> U{combined(R, state.own.linear), combined(R, state.own.angular)};
  if constexpr (is_placed_off<S>()) { U.angular += cross(Triple<Scalar>::settled(f.r.data()), U.linear); }
  return U;
}

/// Diagonal of the largest inertia that A of a frame is reduced from, itself included.
template <class Scalar>
[[gnu::always_inline]] inline TriplePair<Scalar> largest(const FrameState<Scalar>& f, const SpatialInertia<Scalar>& A)
{
  if (!is_several<Scalar> && !f.arrived) { return {A.M.diagonal(), A.J.diagonal()}; }
  const TriplePair<Scalar>& size = f.inertia().size;
  return {max(size.linear, A.M.diagonal()), max(size.angular, A.J.diagonal())};
}

/// Bias wrench of what a frame carries: h + A bias.
template <Scene scene, class S>
[[gnu::always_inline]] inline TriplePair<typename S::Scalar> bias_wrench(const SpatialInertia<typename S::Scalar>& A,
                                                                         const TriplePair<typename S::Scalar>& h,
                                                                         const FrameState<typename S::Scalar>& f)
{
  using Scalar = typename S::Scalar;
  TriplePair<Scalar> p = h;
  if constexpr (has_bias<scene, S>(0)) { p += A.of_linear(ColumnPart<0, Scalar, 1>{f.bias, 0}); }
  if constexpr (has_bias<scene, S>(3)) { p += A.of_angular(ColumnPart<3, Scalar, 1>{f.bias, 0}); }
  return p;
}

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

}  // namespace iim::detail
