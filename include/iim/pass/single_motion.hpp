// One acceleration of a frame followed through what hangs on it, where the joints beyond follow freely, q̈ = −W y: the
// sum G = Σ_b aᵀ I_b a + Σ_r J_r (g_r a)² on the way outward, and on the way back the wrench that it takes,
//
//     w = Σ_b Pᵀ I_b a,        P = 1 − S W of each joint between,
//
// so that aₑᵀ w is the sum of the products with any other acceleration aₑ of the frame. Of free joints Sᵀ w is zero but
// for what W is wrong by, which w then has by its square only, as G. (With the six aₑ beside a in
// eight lanes a mended pivot took 1030 instructions instead of 750.)
#pragma once

#include <iim/body.hpp>
#include <iim/node_state.hpp>
#include <iim/numerics/array.hpp>
#include <iim/pass/parallel_axes.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>
#include <iim/tree_data.hpp>

#include <algorithm>
#include <array>
#include <cstddef>

namespace iim::detail {

/// Qᵀ of both parts of a, or `back` Q of them.
template <class Scalar>
[[gnu::noinline]] TriplePair<Scalar> turned(const Matrix3<Scalar>& Q, bool back, const TriplePair<Scalar>& a)
{
  if (back) { return {combined(Q, a.linear), combined(Q, a.angular)}; }
  const TransposedRotation<Scalar> to_own(Q);
  return {to_own * a.linear, to_own * a.angular};
}

/// A a.
template <class Scalar>
[[gnu::always_inline]] inline TriplePair<Scalar> times(const SpatialInertia<Scalar>& A, const TriplePair<Scalar>& a)
{
  TriplePair<Scalar> wrench = A.of_linear(a.linear);
  wrench += A.of_angular(a.angular);
  return wrench;
}

/// The body on a frame that has the acceleration V̇ at its coupling point, from which the frame's origin is r away.
/// Turning in the body's axes, where its moments are what they are.
template <class Scalar>
struct BodyAccelerated {
  Triple<Scalar> centre, a;         ///< of mass, from the coupling point; its acceleration
  std::array<Triple<Scalar>, 3> R;  ///< columns
  TransposedRotation<Scalar> back;
  Triple<Scalar> turning, moment;  ///< angular acceleration, and what it takes

  [[gnu::always_inline]] BodyAccelerated(const FrameMass<Scalar>& body, const Matrix3<Scalar>& axes,
                                         const Triple<Scalar>& r, const TriplePair<Scalar>& Vdot)
      : R(settled_columns(axes)), back(R)
  {
    centre = combined(R, body.com) + r;
    a = Vdot.linear + cross(Vdot.angular, centre);
    turning = back * Vdot.angular;
    moment = combined(settled_columns(body.central_inertia), turning);
  }
  [[gnu::always_inline]] void add_centripetal(const FrameMass<Scalar>& body, const Triple<Scalar>& omega)
  {
    const Triple<Scalar> own = back * omega;
    a += cross(omega, cross(omega, centre));
    moment += cross(own, combined(settled_columns(body.central_inertia), own));
  }
  /// On it, about the coupling point; to G the sum V̇ᵀ I V̇.
  [[gnu::always_inline]] TriplePair<Scalar> wrench(const FrameMass<Scalar>& body) const
  {
    const Triple<Scalar> force = a * body.mass;
    return {force, combined(R, moment) + cross(centre, force)};
  }
  [[gnu::always_inline]] TriplePair<Scalar> wrench(const FrameMass<Scalar>& body, Scalar& G) const
  {
    const TriplePair<Scalar> all = wrench(body);
    G += dot(TriplePair<Scalar>(a, turning), TriplePair<Scalar>(all.linear, moment));
    return all;
  }
};

/// Sᵀ of what the body of a frame takes that has the acceleration V̇ at its coupling point, S: a column of the joint's,
/// U: I S, from the body's own axes. Nothing of it that does not move the body along S.
template <class Scalar>
[[gnu::noinline]] Scalar along_column(const FrameMass<Scalar>& body, const FrameState<Scalar>& f,
                                      const TriplePair<Scalar>& S, const TriplePair<Scalar>& U,
                                      const TriplePair<Scalar>& Vdot, bool velocity)
{
  const Scalar force = dot(U, Vdot);
  if (!velocity || !body.present) { return force; }
  const auto R = settled_columns(f.R);
  const TransposedRotation<Scalar> back(R);
  const Triple<Scalar> omega = triple(f.omega), own = back * omega,
                       centre = combined(R, body.com) + triple(f.bodies_at());
  return force + dot(U.linear, cross(omega, cross(omega, centre))) +
         dot(back * S.angular, cross(own, combined(settled_columns(body.central_inertia), own)));
}

/// G, and of rotors, if they turned with what carries them: what their spins are left of.
template <class Scalar>
struct MotionSum {
  Scalar G = Scalar(0), turning = Scalar(0);
};

/// Room for it.
template <class Scalar>
class SingleMotion {
public:
  [[gnu::cold]] void allocate(const TreeData<Scalar>& tree)
  {
    Index most = 0;
    for (const Node& node : tree.nodes()) { most = std::max(most, tree.velocities(node.index)); }
    qdd_.resize(at(most));
    load_.resize(at(tree.n_v()));
    a_.resize(at(tree.n_frames()));
    w_.resize(at(tree.n_frames()));
    at_inlet_.resize(at(tree.size()));
    moved_.resize(at(tree.size()));
  }

  /// A frame has the acceleration a, and nothing else moves.
  [[gnu::always_inline]] void start(Index frame, const TriplePair<Scalar>& a)
  {
    n_moved_ = 0;
    a_[at(frame)] = a;
    w_[at(frame)] = none();
  }
  [[gnu::always_inline]] TriplePair<Scalar> acceleration(Index frame) const { return a_[at(frame)]; }
  [[gnu::always_inline]] TriplePair<Scalar> wrench(Index frame) const { return w_[at(frame)]; }
  Scalar& qdd(int d) { return qdd_[static_cast<std::size_t>(d)]; }

  /// To `sum` what hangs on subsystem `node`, whose frames have accelerations. is_enough(subsystem, frame, its
  /// acceleration, G): whether A of the frame stands for what hangs on it. `springs`: of an implicit step.
  template <class Bodies, class Data, class IsEnough>
  [[gnu::always_inline]] void go_outward(const Bodies& bodies, const Node& node, const IsEnough& is_enough,
                                         bool springs, const Data& ws, MotionSum<Scalar>& sum)
  {
    for (Index i = node.index + 1; i < node.subtree_end;) {
      const Node& next = ws.tree().node(i);
      const auto& part = bodies.part(i);
      if (part.is_free) {  // stays where it is
        i = next.subtree_end;
        continue;
      }
      TriplePair<Scalar> y = acceleration(next.inlet);
      y.linear += cross(y.angular, part.place());
      bool whole;
      if (part.is_single()) [[likely]] {
        const TriplePair<Scalar> S = part.column(0, 0);
        const Scalar back = dot(part.gain(0), y);
        const TriplePair<Scalar> a{y.linear - S.linear * back, y.angular - S.angular * back};
        a_[at(next.frame)] = a;
        whole = is_enough(next, next.frame, a, sum.G);
        w_[at(next.frame)] = wrench_of_frame(next.frame, a, whole, ws, sum.G);
        moved_[at(n_moved_++)] = i;
        if (bodies.has_more(i, ws)) {
          qdd_[0] = -back;
          add_more(bodies, next, y, springs, ws, sum);
        }
      } else {
        for (int d = 0; d < part.n_i; ++d) { qdd(d) = -dot(part.gain(d), y); }
        whole = move(bodies, next, y, is_enough, springs, ws, sum);
      }
      i = whole ? next.subtree_end : i + 1;
    }
  }

  /// A subsystem with guidance acceleration y and qdd(); whether all its frames are whole.
  template <class Bodies, class Data, class IsEnough>
  [[gnu::noinline]] bool move(const Bodies& bodies, const Node& node, const TriplePair<Scalar>& y,
                              const IsEnough& is_enough, bool springs, const Data& ws, MotionSum<Scalar>& sum)
  {
    const auto& part = bodies.part(node.index);
    bool whole = true;
    for (int k = 0; k < part.n_frames; ++k) {
      TriplePair<Scalar> a = y;
      for (int d = 0; d < part.n_i; ++d) { a += part.column(k, d) * qdd(d); }
      a_[at(node.frame + k)] = a;
      whole &= is_enough(node, node.frame + k, a, sum.G);
    }
    for (int k = 0; k < part.n_frames; ++k) {
      const Index frame = node.frame + k;
      w_[at(frame)] = wrench_of_frame(frame, acceleration(frame), whole, ws, sum.G);
    }
    moved_[at(n_moved_++)] = node.index;
    if (bodies.has_more(node.index, ws)) { add_more(bodies, node, y, springs, ws, sum); }
    return whole;
  }

  /// To wrench() of the frames that had accelerations from the start, what those beyond take.
  template <class Bodies, class Data>
  [[gnu::always_inline]] void come_back(const Bodies& bodies, const Data& ws)
  {
    while (n_moved_ > 0) {
      const Index i = moved_[at(--n_moved_)];
      const Node& node = ws.tree().node(i);
      const auto& part = bodies.part(i);
      const bool has_more = bodies.has_more(i, ws);
      TriplePair<Scalar> w = wrench(node.frame);
      if (part.is_single()) [[likely]] {
        Scalar load = dot(part.column(0, 0), w);
        if (has_more) { load += load_[at(node.v)]; }
        w -= part.gain(0) * load;
      } else {
        w = wrench_of_frames(node, part, has_more);
      }
      if (has_more) { w += at_inlet_[at(i)]; }
      w.angular += cross(part.place(), w.linear);
      w_[at(node.inlet)] += w;
    }
  }

private:
  [[gnu::always_inline]] static TriplePair<Scalar> none()
  {
    const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
    return {zero, zero};
  }

  /// What a subsystem has on its inlet, and what turns within.
  template <class Bodies, class Data>
  [[gnu::noinline]] void add_more(const Bodies& bodies, const Node& node, const TriplePair<Scalar>& y, bool springs,
                                  const Data& ws, MotionSum<Scalar>& sum)
  {
    const auto& part = bodies.part(node.index);
    TriplePair<Scalar> of_inlet = none();
    Scalar* const load = load_.data() + node.v;
    for (int d = 0; d < part.n_i; ++d) { load[d] = Scalar(0); }
    if (const auto& body = ws.tree().inlet_mass(node.index); body.present) {
      of_inlet = BodyAccelerated<Scalar>(body, *part.R, none().linear, y).wrench(body, sum.G);
    }
    bodies.for_each_rotor(node.index, [&](const auto& rotor, const Scalar* ratio) {
      const bool on_inlet = rotor.frame < 0;
      const Index carrier = node.frame + std::max(rotor.frame, 0);
      Triple<Scalar> axis = none().linear, omega = axis;
      if (rotor.coupled) {
        omega = on_inlet ? y.angular : a_[at(carrier)].angular;
        axis = combined(on_inlet ? *part.R : ws.frame(carrier).R, rotor.axis);
        sum.turning += rotor.inertia * dot(omega, omega);
      }
      const Scalar moment = spin(part.n_i, rotor.inertia, dot(axis, omega), ratio, load, sum.G);
      (on_inlet ? of_inlet : w_[at(carrier)]).angular += axis * moment;
    });
    if (springs) {
      bodies.for_each_spring(node.index, [&](const Scalar& inertia, const Scalar* ratio) {
        spin(part.n_i, inertia, Scalar(0), ratio, load, sum.G);
      });
    }
    at_inlet_[at(node.index)] = of_inlet;
  }

  /// What the frames of a subsystem hand on.
  template <class Part>
  [[gnu::noinline]] TriplePair<Scalar> wrench_of_frames(const Node& node, const Part& part, bool has_more) const
  {
    TriplePair<Scalar> w = wrench(node.frame);
    for (int k = 1; k < part.n_frames; ++k) { w += wrench(node.frame + k); }
    for (int d = 0; d < part.n_i; ++d) {
      Scalar load = has_more ? load_[at(node.v + d)] : Scalar(0);
      for (int k = 0; k < part.n_frames; ++k) { load += dot(part.column(k, d), wrench(node.frame + k)); }
      w -= part.gain(d) * load;
    }
    return w;
  }

  /// Of a frame's bodies, or of the whole that it carries.
  template <class Data>
  [[gnu::always_inline]] static TriplePair<Scalar> wrench_of_frame(Index frame, const TriplePair<Scalar>& a, bool whole,
                                                                   const Data& ws, Scalar& G)
  {
    const auto& f = ws.frame(frame);
    if (!whole) {
      const auto& body = ws.tree().frame_mass(frame);
      if (!body.present) { return none(); }
      return BodyAccelerated<Scalar>(body, f.R, Triple<Scalar>::settled(f.r.data()), a).wrench(body, G);
    }
    if (const auto* axes = ws.axes().of(frame)) [[unlikely]] {
      const TriplePair<Scalar> own = turned(*axes, false, a), w = times(f.inertia().A, own);
      G += dot(own, w);
      return turned(*axes, true, w);
    }
    const TriplePair<Scalar> w = times(f.inertia().A, a);
    G += dot(a, w);
    return w;
  }

  /// What turns at rate + ratio q̈: its moment; to `load` what the velocities see of it.
  [[gnu::always_inline]] Scalar spin(int n, const Scalar& inertia, Scalar rate, const Scalar* ratio, Scalar* load,
                                     Scalar& G)
  {
    for (int d = 0; d < n; ++d) { rate += qdd(d) * ratio[d]; }
    const Scalar moment = rate * inertia;
    G += rate * moment;
    for (int d = 0; d < n; ++d) { load[d] += moment * ratio[d]; }
    return moment;
  }

  Array<Scalar> qdd_;                   // of one subsystem
  Array<Scalar> load_;                  // of velocities: what turns within
  Array<TriplePair<Scalar>> a_, w_;     // of frames
  Array<TriplePair<Scalar>> at_inlet_;  // of subsystems: what their inlets' bodies and rotors take
  Array<Index> moved_;                  // subsystems
  Index n_moved_ = 0;
};

}  // namespace iim::detail
