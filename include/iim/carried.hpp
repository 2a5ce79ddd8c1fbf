// What a frame carries, in matrix form: its bodies, before what hangs on it hands on its own.
#pragma once

#include <iim/articulated_inertia.hpp>
#include <iim/body.hpp>
#include <iim/kinematics.hpp>
#include <iim/parallel_axes.hpp>
#include <iim/spatial.hpp>
#include <iim/workspace.hpp>

namespace iim::detail {

/// A, h and size of the bodies on a frame, in its axes (ParallelAxes::of).
template <bool velocity, class Scalar>
[[gnu::noinline]] void place(const FrameMass<Scalar>& body, const Matrix3<Scalar>* axes, FrameState<Scalar>& f)
{
  const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
  f.size = {zero, zero};
  f.placed = true;
  if (axes) [[unlikely]] {
    Matrix3<Scalar> R = f.R;
    Vector3<Scalar> r = f.bodies_at(), omega = f.omega;
    turn_triples(*axes, false, R.data(), 3);
    turn_triples(*axes, false, r.data(), 1);
    turn_triples(*axes, false, omega.data(), 1);
    place_bodies<true, velocity>(body, R, r, omega, f.A, f.h);
  } else if (f.offset) {
    place_bodies<true, velocity>(body, f.R, f.r, f.omega, f.A, f.h);
  } else {
    place_bodies<false, velocity>(body, f.R, f.r, f.omega, f.A, f.h);
  }
}

/// Nothing on a frame.
template <class Scalar>
void clear(FrameState<Scalar>& f)
{
  const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
  f.size = {zero, zero};
  f.loses = false;
  f.A.set_zero();
  f.h.setZero();
}

/// Matrix form: before anything else comes to the frame. Not in the outward loop: there 33 numbers would wait in memory for
/// the way back, and the steps inward wait for one another, which leaves the processor time for it (pass of a chain of 30 with
/// lanes 8 % less).
template <bool velocity, class Workspace>
[[gnu::always_inline]] inline void place_frame(Index f, Workspace& ws)
{
  if (!ws.frame(f).placed) { place<velocity>(ws.tree().frame_mass(f), ws.axes().of(f), ws.frame(f)); }
}

/// Bias wrench of what a frame carries: h + A bias.
template <Scene scene, class S>
[[gnu::always_inline]] inline TriplePair<typename S::Scalar> bias_wrench(const FrameState<typename S::Scalar>& f)
{
  using Scalar = typename S::Scalar;
  TriplePair<Scalar> p(f.h.data());
  if constexpr (has_bias<scene, S>(0)) { p += f.A.of_linear(ColumnPart<0, Scalar, 1>{f.bias, 0}); }
  if constexpr (has_bias<scene, S>(3)) { p += f.A.of_angular(ColumnPart<3, Scalar, 1>{f.bias, 0}); }
  return p;
}

}  // namespace iim::detail
