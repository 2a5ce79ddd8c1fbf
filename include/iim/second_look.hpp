// Results that small pivots went into, looked at again: whether they hold, and q̈ made better.
//
// A pivot D with roundings ε·scale (roundings.hpp) is a difference of which no digit may be left. How wrong it is, the
// scale alone does not tell but within a factor of a hundred; but what the equations of motion leave of the
// accelerations x that loads τ are said to give, does:
//
//     δx = M⁻¹ (τ − M x),        M x by the balance of each joint at the accelerations of all bodies, M⁻¹ by W and C
//
// For loads of ±1 on all joints, and on free bodies as well, δx is what M⁻¹ is wrong by. For h it is an iterative
// refinement of q̈, which takes away most of the roundings that it has of the forces by which a load is held.
//
// Only where a pivot is below 2¹³ ε of its scale. In double that takes loads of 10⁹ times a robot's weight; other
// states pay 1 % of the pass at most. (Float, seven links, loads of 10³ to 10⁷ kg, 32000 states: 19646 come back, none
// off by more than 0.4 %. With a pivot below 192 ε of its scale as zero 16541 did, of which 311 were off by more than
// 1 %.)
#pragma once

#include <iim/array.hpp>
#include <iim/bodies_beyond.hpp>
#include <iim/body.hpp>
#include <iim/node_state.hpp>
#include <iim/parallel_axes.hpp>
#include <iim/scalar.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>
#include <iim/tree_data.hpp>
#include <iim/triple.hpp>
#include <iim/update.hpp>

#include <algorithm>
#include <cstddef>

namespace iim::detail {

/// Whether |x| < limit.
template <class Scalar>
bool is_below(const Scalar& x, const Scalar& limit)
{
  return ScalarTraits<Scalar>::is_positive(limit - x) && ScalarTraits<Scalar>::is_positive(limit + x);
}

/// Whether passes do so: in matrix form, of one state. (Of several, a small pivot has them computed one by one.)
template <class Data>
inline constexpr bool looks_again = Data::update != Update::square_root && !bodies_first<typename Data::Scalar>;

/// Which pivots were small in a pass, what was applied to the frames, and room for the second look.
template <class Scalar>
class SecondLook {
  using Pair = TriplePair<Scalar>;

public:
  [[gnu::cold]] void allocate(Index subsystems, Index frames, Index velocities)
  {
    const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
    small_.reserve(at(subsystems));
    touched_.reserve(at(frames));
    is_touched_.resize(at(frames), false);
    for (Array<Pair>* const of_frames : {&applied_, &forces_, &accelerations_, &moves_}) {
      of_frames->resize(at(frames), {zero, zero});
    }
    for (Array<Scalar>* const of_velocities : {&load_, &qdd_, &change_, &scaled_}) {
      of_velocities->resize(at(velocities), Scalar(0));
    }
  }
  /// Before a pass.
  void clear()
  {
    small_.clear();
    for (const Index frame : touched_) { is_touched_[at(frame)] = false; }
    touched_.clear();
  }
  bool is_needed() const { return !small_.empty(); }

  void note_small_pivot(Index subsystem) { small_.push_back(subsystem); }
  /// wrench: about the frame's coupling point, world axes.
  void note_applied(Index frame, const Vector6<Scalar>& wrench)
  {
    if (is_touched_[at(frame)]) {
      applied_[at(frame)] += Pair(wrench.data());
    } else {
      applied_[at(frame)] = Pair(wrench.data());
      is_touched_[at(frame)] = true;
      touched_.push_back(frame);
    }
  }

  /// After the inward loop. A subsystem whose M̄_R is not right; −1 if all are.
  template <class Data>
  [[gnu::cold, gnu::noinline]] Index wrong_pivot(bool springs, Data& ws)
  {
    const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
    for (const std::size_t period : {1, 2, 3}) {
      for (std::size_t v = 0; v < load_.size(); ++v) {
        load_[v] = Scalar(v / period % 2 == 0 ? 1 : -1);
        qdd_[v] = Scalar(0);
      }
      if (period < 3) {  // what a free body is moved by, nothing else may move as much
        for (const Node& node : ws.tree().nodes()) {
          const auto& part = ws.bodies_beyond().part(node.index);
          for (int d = 0; part.is_free && d < part.n_i; ++d) { load_[at(node.v + d)] = Scalar(0); }
        }
      }
      for (Pair& acceleration : accelerations_) { acceleration = {zero, zero}; }
      change<false>(false, springs, false, ws);
      add_change();
      change<false>(false, springs, false, ws);
      if (!is_small(256)) { return worst(springs, ws); }
    }
    return -1;
  }

  /// After the outward loop: q̈ += δq̈, and V̇ with it, twice. False if the first δq̈ is not small, or the second not much
  /// smaller. gravity, springs: of the scene, as is velocity.
  template <bool velocity, class Data>
  [[gnu::cold, gnu::noinline]] bool refine(bool gravity, bool springs, Data& ws)
  {
    for (std::size_t v = 0; v < load_.size(); ++v) {
      load_[v] = ws.load()(static_cast<Index>(v));
      qdd_[v] = ws.qdd()(static_cast<Index>(v));
    }
    for (Index f = 0; f < ws.tree().n_frames(); ++f) { accelerations_[at(f)] = Pair(ws.frame(f).Vdot.data()); }
    for (const int smaller : {16, 256}) {
      change<velocity>(gravity, springs, true, ws);
      if (!is_small(smaller)) { return false; }
      add_change();
    }
    for (std::size_t v = 0; v < qdd_.size(); ++v) { ws.qdd()(static_cast<Index>(v)) = qdd_[v]; }
    for (Index f = 0; f < ws.tree().n_frames(); ++f) { accelerations_[at(f)].put(ws.frame(f).Vdot.data()); }
    return true;
  }

  /// The first of the small pivots.
  Index first() const { return small_.front(); }

private:
  /// The first subsystem whose sum over what it moves is far from M̄_R; else the first of the small pivots.
  template <class Data>
  Index worst(bool springs, Data& ws)
  {
    for (const Index i : small_) {
      for (int d = 0; d < ws.bodies_beyond().part(i).n_i; ++d) {
        const Scalar off = ws.bodies_beyond().unit_of(ws.tree().node(i), d, springs, ws) - Scalar(1);
        if (!is_below(off, Scalar(1.0 / 64))) { return i; }
      }
    }
    return first();
  }

  /// Of the motion qdd_, accelerations_ under load_: δq̈, and δV̇ as moves_.
  template <bool velocity, class Data>
  void change(bool gravity, bool springs, bool applied, Data& ws)
  {
    const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
    for (Index f = 0; f < ws.tree().n_frames(); ++f) {
      const FrameState<Scalar>& frame = ws.frame(f);
      forces_[at(f)] =
          body_wrench<velocity>(ws.tree().frame_mass(f), frame.R, frame.r, triple(frame.omega), accelerations_[at(f)]);
      moves_[at(f)] = {zero, zero};
    }
    unseen_ = Scalar(0);
    if (applied) {
      for (const Index frame : touched_) { forces_[at(frame)] -= applied_[at(frame)]; }
    }
    for (Index i = ws.tree().size(); i-- > 0;) { balance<velocity>(ws.tree().node(i), gravity, springs, ws); }
    for (const Node& node : ws.tree().nodes()) { follow(node, ws); }
  }
  void add_change()
  {
    for (std::size_t v = 0; v < qdd_.size(); ++v) { qdd_[v] += change_[v]; }
    for (std::size_t f = 0; f < moves_.size(); ++f) { accelerations_[f] += moves_[f]; }
  }
  /// Whether δq̈ is less than q̈ / smaller, or than what the roundings of W y alone make.
  bool is_small(int smaller) const
  {
    Scalar all = unseen_;
    for (const Scalar& x : qdd_) { all = larger(all, Scalar(magnitude(x) / Scalar(smaller))); }
    for (const Scalar& x : change_) {
      if (!is_below(x, all) && !(is_finite(x) && x == Scalar(0))) { return false; }
    }
    return true;
  }
  static Scalar magnitude(const Scalar& x) { return ScalarTraits<Scalar>::is_positive(x) ? x : Scalar(-x); }
  static Scalar larger(const Scalar& a, const Scalar& b) { return ScalarTraits<Scalar>::is_positive(b - a) ? b : a; }
  static Scalar largest(const Pair& x)
  {
    Scalar all(0);
    for (int i = 0; i < 6; ++i) { all = larger(all, magnitude(x(i))); }
    return all;
  }

  /// What the equations of motion leave at a subsystem, those beyond it done: forces of all bodies to its inlet, h =
  /// Bu − h − M q̈ of its velocities; and M⁻¹ of it on the way inward, `move` being the wrench that h makes there.
  template <bool velocity, class Data>
  void balance(const Node& node, bool gravity, bool springs, Data& ws)
  {
    const auto& part = ws.bodies_beyond().part(node.index);
    const int n = part.n_i;
    const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
    Pair y(zero, zero), to_inlet(zero, zero), wrench_to_inlet(zero, zero);
    Triple<Scalar> omega = zero;  // of the inlet
    if (node.inlet >= 0) {
      y = shifted(*part.r, accelerations_[at(node.inlet)]);
      if constexpr (velocity) {
        omega = triple(ws.frame(node.inlet).omega);
        y.linear += cross(omega, cross(omega, triple(*part.r)));
      }
    } else if (gravity) {
      const Vector3<Scalar>& g = ws.tree().gravity();
      y.linear = Triple<Scalar>(-g(0), -g(1), -g(2));
    }
    const auto rate_of = [&](const Scalar* ratio, const Scalar* rates) {
      Scalar rate(0);
      for (int d = 0; d < n; ++d) { rate += ratio[d] * rates[d]; }
      return rate;
    };
    Scalar* const h = change_.data() + node.v;
    const Scalar* const qdd = qdd_.data() + node.v;
    for (int d = 0; d < n; ++d) { h[d] = load_[at(node.v + d)]; }
    const auto resist = [&](const Scalar& force, const Scalar* ratio) {
      for (int d = 0; d < n; ++d) { h[d] -= ratio[d] * force; }
    };
    ws.bodies_beyond().for_each_rotor(node.index, [&](const auto& rotor, const Scalar* ratio) {
      const bool on_inlet = rotor.frame < 0;
      const Index frame = node.frame + std::max(rotor.frame, 0);
      const FrameState<Scalar>& f = ws.frame(frame);
      Triple<Scalar> axis = zero;
      if (rotor.coupled) { axis = combined(on_inlet ? *part.R : f.R, triple(rotor.axis)); }
      const Triple<Scalar> turning = on_inlet ? y.angular : accelerations_[at(frame)].angular;
      const Scalar force = rotor.inertia * (dot(axis, turning) + rate_of(ratio, qdd));
      resist(force, ratio);
      Triple<Scalar> moment = axis * force;
      if constexpr (velocity) {
        const Triple<Scalar> w = on_inlet ? omega : triple(f.omega);
        moment += cross(w, axis) * (rotor.inertia * (dot(axis, w) + rate_of(ratio, part.qd)));
      }
      if (on_inlet) {
        to_inlet.angular += moment;
      } else {
        forces_[at(frame)].angular += moment;
      }
    });
    if (springs) {
      ws.bodies_beyond().for_each_spring(node.index, [&](const Scalar& inertia, const Scalar* ratio) {
        resist(inertia * rate_of(ratio, qdd), ratio);
      });
    }
    to_inlet += body_wrench<velocity>(ws.tree().inlet_mass(node.index), *part.R,
                                      Vector3<Scalar>(zero(0), zero(1), zero(2)), omega, y);
    for (int k = 0; k < part.n_frames; ++k) {
      Pair all = forces_[at(node.frame + k)];
      to_inlet += all;
      wrench_to_inlet += moves_[at(node.frame + k)];
      all += moves_[at(node.frame + k)];
      for (int d = 0; d < n; ++d) { h[d] -= dot(Pair(part.S + 6 * (k * n + d)), all); }
    }
    Scalar* const scaled = scaled_.data();
    for (int e = 0; e < n; ++e) { scaled[e] = rate_of(part.C + e * n, h); }
    const Scalar roundings = Scalar(16) * Eigen::NumTraits<Scalar>::epsilon();
    for (int d = 0; d < n; ++d) {
      const Pair W = gain(part, d);
      unseen_ = larger(unseen_, Scalar(roundings * largest(W) * largest(y)));
      wrench_to_inlet += W * h[d];
      h[d] = Scalar(0);
      for (int e = 0; e < n; ++e) { h[d] += part.C[e * n + d] * scaled[e]; }
    }
    if (node.inlet < 0 || part.is_free) { return; }
    forces_[at(node.inlet)] += moved(*part.r, to_inlet);
    moves_[at(node.inlet)] += moved(*part.r, wrench_to_inlet);
  }

  /// δq̈ of a subsystem, and δV̇ of its frames.
  template <class Data>
  void follow(const Node& node, Data& ws)
  {
    const auto& part = ws.bodies_beyond().part(node.index);
    const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
    Pair y(zero, zero);
    if (node.inlet >= 0) { y = shifted(*part.r, moves_[at(node.inlet)]); }
    Scalar* const change = change_.data() + node.v;
    for (int d = 0; d < part.n_i; ++d) { change[d] -= dot(gain(part, d), y); }
    for (int k = 0; k < part.n_frames; ++k) {
      Pair& move = moves_[at(node.frame + k)];
      move = y;
      for (int d = 0; d < part.n_i; ++d) { move += Pair(part.S + 6 * (k * part.n_i + d)) * change[d]; }
    }
  }

  /// Row d of W.
  template <class Part>
  static Pair gain(const Part& part, int d)
  {
    const Scalar* const W = part.W + d;
    const int n = part.n_i;
    return {{W[0], W[n], W[2 * n]}, {W[3 * n], W[4 * n], W[5 * n]}};
  }
  /// A twist about the point r away.
  static Pair shifted(const Vector3<Scalar>& r, const Pair& V)
  {
    return {V.linear + cross(V.angular, triple(r)), V.angular};
  }
  /// A wrench from there.
  static Pair moved(const Vector3<Scalar>& r, const Pair& w)
  {
    return {w.linear, w.angular + cross(triple(r), w.linear)};
  }

  /// On the body of a frame that has the acceleration V̇ at its coupling point: about that point.
  template <bool velocity>
  static Pair body_wrench(const FrameMass<Scalar>& body, const Matrix3<Scalar>& R, const Vector3<Scalar>& r,
                          const Triple<Scalar>& omega, const Pair& Vdot)
  {
    const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
    if (!body.present) { return {zero, zero}; }
    const TransposedRotation<Scalar> back(R);
    const Triple<Scalar> centre = combined(R, triple(body.com)) + triple(r);
    Triple<Scalar> a = Vdot.linear + cross(Vdot.angular, centre);
    Triple<Scalar> moment = combined(body.central_inertia, back * Vdot.angular);
    if constexpr (velocity) {
      const Triple<Scalar> own = back * omega;
      a += cross(omega, cross(omega, centre));
      moment += cross(own, combined(body.central_inertia, own));
    }
    const Triple<Scalar> force = a * body.mass;
    return {force, combined(R, moment) + cross(centre, force)};
  }

  static std::size_t at(Index i) { return static_cast<std::size_t>(i); }

  Array<Index> small_;    // subsystems
  Array<Index> touched_;  // frames that something is applied to
  Array<bool> is_touched_;
  Array<Pair> applied_, forces_, accelerations_, moves_;  // of frames
  Array<Scalar> load_, qdd_, change_, scaled_;
  Scalar unseen_ = Scalar(0);  // what q̈ may be from roundings of W y alone, as in an arm that hangs still
};

}  // namespace iim::detail
