// What the equations of motion leave of accelerations x that loads τ are said to give, as accelerations:
//
//     δx = M⁻¹ (τ − M x),        M x by the balance of each joint at the accelerations of all bodies, M⁻¹ by W and C
//
// and what the roundings of these sums may be in it.
//
// Where limbs begin with a plane, two parallel joints or more (parallel_axes.hpp), that lies obliquely, all of this is
// in axes of the plane: what is held across it, a load's weight, has no share in what acts in it then. (Seven joints in
// a plane under 10², 10⁴, 10⁶ times a link: q̈₀ 16, 6, 9 ε at most, in the world's axes 5400, 10⁵, 4·10⁷. Nine, of
// which six are, under 10³, 10⁶, 10⁹: 240, 1000, 10⁶; 1500, 3·10⁵, 10⁸. Passes of such arms take up to twice as long.)
#pragma once

#include <iim/body.hpp>
#include <iim/node_state.hpp>
#include <iim/numerics/array.hpp>
#include <iim/numerics/triple.hpp>
#include <iim/pass/bodies_beyond.hpp>
#include <iim/pass/free_axis.hpp>
#include <iim/pass/joint_lines.hpp>
#include <iim/pass/parallel_axes.hpp>
#include <iim/pass/part_in_axes.hpp>
#include <iim/pass/roundings.hpp>
#include <iim/scalar.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>
#include <iim/tree_data.hpp>

#include <algorithm>
#include <cstddef>

namespace iim::detail {

/// Whether a subsystem hangs on a free body, or on what is fixed to one.
template <class Data>
bool is_on_free(const Node& node, Data& ws)
{
  for (Index i = node.parent; i >= 0; i = ws.tree().node(i).parent) {
    const auto& part = ws.bodies_beyond().part(i);
    if (part.is_free || part.n_i > 0) { return part.is_free; }
  }
  return false;
}

/// Room for it, and the sums. Workspace: its part that depends on Scalar and update alone.
template <class Scalar>
class MotionResidual {
  using Pair = TriplePair<Scalar>;
  using Part = typename BodiesBeyond<Scalar>::Part;

public:
  /// most: velocities of a subsystem.
  [[gnu::cold]] void allocate(Index subsystem_frames, Index velocities, Index most)
  {
    for (auto* const of_frames : {&accelerations_, &forces_, &moves_}) {
      of_frames->resize(at(subsystem_frames), none());
    }
    along_.resize(at(subsystem_frames), Scalar(0));
    sizes_.resize(at(subsystem_frames));
    for (Array<Scalar>* const of_velocities : {&load_, &x_, &change_, &unseen_}) {
      of_velocities->resize(at(velocities), Scalar(0));
    }
    scaled_.resize(at(most), Scalar(0));
    terms_.resize(at(most), Scalar(0));
  }

  /// Once, if it is for what heavy bodies do: whose axes are turned.
  [[gnu::cold]] void find_planes(const TreeData<Scalar>& tree, const Array<TypeFacts<Scalar>>& facts)
  {
    axes_ = ParallelAxes<Scalar>::of_planes(tree, facts);
  }

  Scalar& load(Index v) { return load_[at(v)]; }                  ///< τ
  const Scalar& x(Index v) const { return x_[at(v)]; }            ///< acceleration
  const Scalar& change(Index v) const { return change_[at(v)]; }  ///< δx
  /// Times ε: how large roundings in δx may be, as far as W y and the terms of h tell.
  const Scalar& unseen(Index v) const { return unseen_[at(v)]; }

  /// x = 0.
  void stand_still()
  {
    std::fill(x_.begin(), x_.end(), Scalar(0));
    std::fill(accelerations_.begin(), accelerations_.end(), none());
  }
  /// δx. velocity, gravity, springs: of the scene. apply(f): f(frame, wrench) for what is applied to frames. judged:
  /// `unseen` as well, which takes four times as long again.
  template <bool judged = true, class Data, class Apply>
  void compute(bool velocity, bool gravity, bool springs, Data& ws, Apply&& apply)
  {
    for (Index f = 0; f < ws.tree().n_frames(); ++f) {
      const FrameState<Scalar>& frame = ws.frame(f);
      const Matrix3<Scalar>* const axes = axes_of(f, ws);
      const Pair wrench =
          axes != nullptr
              ? turned_body_wrench(velocity, ws.tree().frame_mass(f), *axes, frame, accelerations_[at(f)])
              : body_wrench(velocity, ws.tree().frame_mass(f), frame.R, Triple<Scalar>::settled(frame.r.data()),
                            Triple<Scalar>::settled(frame.omega.data()), accelerations_[at(f)]);
      forces_[at(f)] = wrench;
      moves_[at(f)] = none();
      if constexpr (judged) { sizes_[at(f)] = Sizes(wrench); }
    }
    apply([&](Index frame, const Vector6<Scalar>& wrench) {
      const Pair applied = from_world(axes_of(frame, ws), Pair(wrench.data()));
      forces_[at(frame)] -= applied;
      if constexpr (judged) { sizes_[at(frame)] += Sizes(applied); }
    });
    for (const FreeAxis<Scalar>& axis : ws.free_axes()) {
      if (keeps_apart<Data>(axis)) { along(axis) = dot(axis_of(axis, ws), forces_[at(axis.frame)]); }
    }
    const auto is_single = [&](Index i) {
      const Node& node = ws.tree().node(i);
      return !judged && ws.bodies_beyond().part(i).is_single() && axes_of(node.frame, ws) == nullptr &&
             axes_of(node.inlet, ws) == nullptr;
    };
    for (Index i = ws.tree().size(); i-- > 0;) {
      const Node& node = ws.tree().node(i);
      if (is_single(i)) [[likely]] {
        balance<false, true>(node, velocity, gravity, springs, ws);
      } else {
        balance<judged, false>(node, velocity, gravity, springs, ws);
      }
    }
    for (const Node& node : ws.tree().nodes()) {
      if (is_single(node.index)) [[likely]] {
        follow<false, true>(node, ws);
      } else {
        follow<judged, false>(node, ws);
      }
    }
  }
  /// Before all others at a state.
  template <class Data>
  void choose_axes(Data& ws)
  {
    axes_.choose([&ws](Index f) -> const Matrix3<Scalar>& { return ws.frame(f).R; });
  }
  /// Accelerations x, and those of all frames, from the workspace, and back to it.
  template <class Data>
  void take(Data& ws)
  {
    for (Index v = 0; v < ws.tree().n_v(); ++v) { x_[at(v)] = ws.qdd()(v); }
    for (Index f = 0; f < ws.tree().n_frames(); ++f) {
      accelerations_[at(f)] = from_world(axes_of(f, ws), Pair(ws.frame(f).Vdot.data()));
    }
  }
  template <class Data>
  void put(Data& ws) const
  {
    for (Index v = 0; v < ws.tree().n_v(); ++v) { ws.qdd()(v) = x_[at(v)]; }
    for (Index f = 0; f < ws.tree().n_frames(); ++f) {
      to_world(axes_of(f, ws), accelerations_[at(f)]).put(ws.frame(f).Vdot.data());
    }
  }
  /// x += δx.
  void add_change()
  {
    for (std::size_t v = 0; v < x_.size(); ++v) { x_[v] += change_[v]; }
    for (std::size_t f = 0; f < moves_.size(); ++f) { accelerations_[f] += moves_[f]; }
  }

private:
  /// How large the numbers are that sums are of.
  struct Sizes {
    Scalar force = Scalar(0), moment = Scalar(0);
    Scalar acceleration = Scalar(0);  ///< on the way to a frame

    Sizes() = default;
    explicit Sizes(const Pair& wrench) : force(largest_of(wrench.linear)), moment(largest_of(wrench.angular)) {}
    Sizes& operator+=(const Sizes& other)
    {
      force += other.force;
      moment += other.moment;
      return *this;
    }
  };

  /// Axes of what is on a frame; null: the world's. (A free frame's part has these.)
  template <class Data>
  const Matrix3<Scalar>* axes_of(Index f, Data& ws) const
  {
    if (f < 0 || !axes_.turned() || ws.bodies_beyond().part(ws.tree().owner(f)).is_free) [[likely]] { return nullptr; }
    return axes_.of(f);
  }
  template <bool single, class Data>
  auto see(const Node& node, Data& ws) const
  {
    const Part& part = ws.bodies_beyond().part(node.index);
    if constexpr (single) {
      return PartAsItIs<Scalar>{part};
    } else {
      return PartInAxes<Scalar>(part, axes_of(node.frame, ws), axes_of(node.inlet, ws));
    }
  }

  /// What the equations of motion leave at a subsystem, those beyond it done: forces of all bodies to its inlet, h =
  /// Bu − h − M q̈ of its velocities; and M⁻¹ of it on the way inward, `move` being the wrench that h makes there.
  /// single: of one velocity and one frame, which compilers then know (a quarter less of all this).
  template <bool judged, bool single, class Data>
  void balance(const Node& node, bool velocity, bool gravity, bool springs, Data& ws)
  {
    const auto seen = see<single>(node, ws);
    const Part& part = seen.part();
    const int n = single ? 1 : part.n_i, n_frames = single ? 1 : part.n_frames;
    const Triple<Scalar> zero = none().linear;
    Pair y = none(), to_inlet = y, wrench_to_inlet = y;
    Triple<Scalar> omega = zero;  // of the inlet
    if (node.inlet >= 0) {
      y = accelerations_[at(node.inlet)];
      if constexpr (!single) { y = seen.from_inlet(y); }
      y = shifted(part.place(), y);
      if (velocity) {
        omega = Triple<Scalar>::settled(ws.frame(node.inlet).omega.data());
        if constexpr (!single) { omega = from_world(seen.own, Pair(zero, omega)).angular; }
        y.linear += cross(omega, cross(omega, part.place()));
      }
    } else if (gravity) {
      const Vector3<Scalar>& g = ws.tree().gravity();
      y.linear = Triple<Scalar>(-g(0), -g(1), -g(2));
      if constexpr (!single) { y = from_world(seen.own, y); }
    }
    Scalar* const h = change_.data() + node.v;
    for (int d = 0; d < n; ++d) { h[d] = load_[at(node.v + d)]; }
    if (part.has_within) {
      const Matrix3<Scalar>* own = nullptr;
      if constexpr (!single) { own = seen.own; }
      balance_within(node, own, y, omega, judged, velocity, springs, ws, to_inlet);
    }
    to_inlet += body_wrench(velocity, ws.tree().inlet_mass(node.index), *part.R, zero, omega, y);
    const FreeLimb<Scalar>* const limb = ws.free_limb(node.index);
    Scalar of_limb(0);  // along the axis, what is on the inlet
    if (limb != nullptr) { of_limb = h[0] + dot(part.column(0, 0), to_inlet); }
    Sizes sizes;
    Scalar* const terms = terms_.data();  // by size: what h is of so far, and what frames add
    if constexpr (judged) {
      sizes = Sizes(to_inlet);
      for (int d = 0; d < n; ++d) { terms[d] = magnitude(h[d]); }
    }
    for (int k = 0; k < n_frames; ++k) {
      const Sizes& of_frame = sizes_[at(node.frame + k)];
      if constexpr (judged) { sizes += of_frame; }
      Pair all = forces_[at(node.frame + k)];
      to_inlet += all;
      const Pair& move = moves_[at(node.frame + k)];
      wrench_to_inlet += move;
      all += move;
      const auto* const coaxial = ws.bodies_beyond().coaxial(node, springs, ws);
      for (int d = 0; d < n; ++d) {
        const Pair S = part.column(k, d);
        h[d] -= coaxial ? coaxial->load(load_.data(), ws.tree()) + along_own(node, velocity, ws) : dot(S, all);
        if constexpr (judged) {
          terms[d] += largest_of(S.linear) * of_frame.force + largest_of(S.angular) * of_frame.moment;
        }
      }
    }
    if (limb != nullptr) { of_limb = in_sense(limb->sense, Scalar(of_limb - limb->slip * h[0])); }
    // What passes through a free body, or a joint on one, does not act on it: it moves so that nothing does.
    const bool hangs_free = judged && (part.is_free || is_on_free(node, ws));
    Scalar* const scaled = scaled_.data();
    for (int e = 0; e < n; ++e) { scaled[e] = product_of(part.C + e * n, h, n); }
    if (part.is_free) { balance_along_axis(node, ws, scaled); }
    for (int d = 0; d < n; ++d) {
      const Pair W = part.gain(d);
      if constexpr (judged) {
        Scalar& unseen = unseen_[at(node.v + d)];
        unseen = largest_of(W) * largest_of(y);
        for (int e = 0; e < n && !hangs_free; ++e) {
          Scalar inverse(0);  // entry of M̄_R⁻¹
          for (int c = 0; c < n; ++c) { inverse += part.C[c * n + d] * part.C[c * n + e]; }
          unseen += magnitude(inverse) * terms[e];
        }
      }
      wrench_to_inlet += W * h[d];
      h[d] = Scalar(0);
      for (int e = 0; e < n; ++e) { h[d] += part.C[e * n + d] * scaled[e]; }
    }
    if (node.inlet < 0 || part.is_free) { return; }
    to_inlet = moved(part.place(), to_inlet);
    wrench_to_inlet = moved(part.place(), wrench_to_inlet);
    if constexpr (!single) {
      to_inlet = seen.to_inlet(to_inlet);
      wrench_to_inlet = seen.to_inlet(wrench_to_inlet);
    }
    forces_[at(node.inlet)] += to_inlet;
    moves_[at(node.inlet)] += wrench_to_inlet;
    if (ws.bodies_beyond().part(node.parent).is_free) { add_along_axis(node, of_limb, to_inlet, wrench_to_inlet, ws); }
    if constexpr (judged) {
      sizes.moment += largest_of(part.place()) * sizes.force;
      sizes_[at(node.inlet)] += sizes;
    }
  }

  /// Rotors, and springs of an implicit step: to h, and to the inlet or the frame that carries them. own: the frame's
  /// axes; y, omega: of the inlet, in these.
  template <class Data>
  [[gnu::noinline]] void balance_within(const Node& node, const Matrix3<Scalar>* own, const Pair& y,
                                        const Triple<Scalar>& omega, bool judged, bool velocity, bool springs, Data& ws,
                                        Pair& to_inlet)
  {
    const auto& part = ws.bodies_beyond().part(node.index);
    Scalar* const h = change_.data() + node.v;
    const Scalar* const x = x_.data() + node.v;
    const auto resist = [&](const Scalar& force, const Scalar* ratio) {
      for (int d = 0; d < part.n_i; ++d) { h[d] -= ratio[d] * force; }
    };
    const Triple<Scalar> zero = none().linear;
    ws.bodies_beyond().for_each_rotor(node.index, [&](const auto& rotor, const Scalar* ratio) {
      const bool on_inlet = rotor.frame < 0;
      const Index frame = node.frame + std::max(rotor.frame, 0);
      const FrameState<Scalar>& f = ws.frame(frame);
      Triple<Scalar> axis = zero;
      if (rotor.coupled) {
        axis = from_world(own, Pair(zero, combined(on_inlet ? *part.R : f.R, triple(rotor.axis)))).angular;
      }
      const Triple<Scalar> turning = on_inlet ? y.angular : accelerations_[at(frame)].angular;
      const Scalar force = rotor.inertia * (dot(axis, turning) + product_of(ratio, x, part.n_i));
      resist(force, ratio);
      Triple<Scalar> moment = axis * force;
      if (velocity) {
        const Triple<Scalar> w = on_inlet ? omega : from_world(own, Pair(zero, triple(f.omega))).angular;
        moment += cross(w, axis) * (rotor.inertia * (dot(axis, w) + product_of(ratio, part.qd, part.n_i)));
      }
      if (on_inlet) {
        to_inlet.angular += moment;
      } else {
        const Pair turns(zero, moment);
        forces_[at(frame)] += turns;
        if (judged) { sizes_[at(frame)] += Sizes(turns); }
      }
    });
    if (springs) {
      ws.bodies_beyond().for_each_spring(node.index, [&](const Scalar& inertia, const Scalar* ratio) {
        resist(inertia * product_of(ratio, x, part.n_i), ratio);
      });
    }
  }

  static Scalar product_of(const Scalar* a, const Scalar* b, int n)
  {
    Scalar sum(0);
    for (int d = 0; d < n; ++d) { sum += a[d] * b[d]; }
    return sum;
  }

  /// What passes through a child about the same axis has its load along S, but for roundings (weak_pivot.hpp): of the
  /// rest.
  template <class Data>
  [[gnu::noinline]] Scalar along_own(const Node& node, bool velocity, Data& ws)
  {
    const Part& part = ws.bodies_beyond().part(node.index);
    const FrameState<Scalar>& f = ws.frame(node.frame);
    const Pair U{combined(f.R, part.own->linear), combined(f.R, part.own->angular)};
    const Pair Vdot = to_world(axes_of(node.frame, ws), accelerations_[at(node.frame)]);
    return along_column(ws.tree().frame_mass(node.frame), f, part.column(0, 0), U, Vdot, velocity);
  }

  /// S of a free frame's axis about its coupling point, in world axes.
  template <class Data>
  static Pair axis_of(const FreeAxis<Scalar>& axis, Data& ws)
  {
    const auto& part = ws.bodies_beyond().part(axis.child);
    const Pair S = part.column(0, 0);
    return {S.linear - cross(S.angular, part.place()), S.angular};
  }
  /// In square-root form it does not: see outweigh_free.
  template <class Data>
  static bool keeps_apart(const FreeAxis<Scalar>& axis)
  {
    return Data::update != Update::square_root && axis.child >= 0;
  }
  Scalar& along(const FreeAxis<Scalar>& axis) { return along_[at(axis.frame)]; }

  /// What a subsystem leaves on a free frame, along its axis S: `forces` and `moves`, or of_limb of a limb along that.
  template <class Data>
  [[gnu::noinline]] void add_along_axis(const Node& node, const Scalar& of_limb, const Pair& forces, const Pair& moves,
                                        Data& ws)
  {
    const FreeAxis<Scalar>& axis = *ws.free_axis(node.inlet);
    if (!keeps_apart<Data>(axis)) { return; }
    if (ws.free_limb(node.index) != nullptr) {
      along(axis) += of_limb;
    } else {
      const Pair S = axis_of(axis, ws);
      along(axis) += dot(S, forces) + dot(S, moves);
    }
  }
  /// What is along S of a free frame moves it by one column of C, S·last, and is known better than by what is left of
  /// all forces.
  template <class Data>
  [[gnu::noinline]] void balance_along_axis(const Node& node, Data& ws, Scalar* scaled)
  {
    const FreeAxis<Scalar>& axis = *ws.free_axis(node.frame);
    if (!keeps_apart<Data>(axis)) { return; }
    const auto& part = ws.bodies_beyond().part(node.index);
    Pair all = forces_[at(node.frame)];
    all += moves_[at(node.frame)];
    Scalar e = Scalar(0) - along(axis) * axis.last - dot(Pair(axis.E.data() + 30), all);
    for (int d = 0; d < 6; ++d) { e += part.C[30 + d] * load_[at(node.v + d)]; }
    scaled[5] = e;
  }

  /// δx of a subsystem, and δV̇ of its frames.
  template <bool judged, bool single, class Data>
  void follow(const Node& node, Data& ws)
  {
    const auto seen = see<single>(node, ws);
    const Part& part = seen.part();
    const int n = single ? 1 : part.n_i, n_frames = single ? 1 : part.n_frames;
    Pair y = none();
    Scalar size(0);
    if (node.inlet >= 0) {
      y = moves_[at(node.inlet)];
      if constexpr (!single) { y = seen.from_inlet(y); }
      y = shifted(part.place(), y);
      if constexpr (judged) { size = sizes_[at(node.inlet)].acceleration; }
    }
    // A free body within a tree stands still while its inlet moves: q̈ is a difference of which nothing may be left.
    const Scalar uncertain = Scalar(part.is_free ? 16 : 1) * size;
    if (part.is_free) { size = Scalar(0); }
    Scalar* const change = change_.data() + node.v;
    for (int d = 0; d < n; ++d) {
      const Pair W = part.gain(d);
      change[d] -= dot(W, y);
      if constexpr (judged) { unseen_[at(node.v + d)] += largest_of(W) * uncertain; }
    }
    for (int k = 0; k < n_frames; ++k) {
      Pair move = y;
      for (int d = 0; d < n; ++d) { move += part.column(k, d) * change[d]; }
      moves_[at(node.frame + k)] = move;
      if constexpr (judged) {
        Scalar of_frame = larger(size, largest_of(accelerations_[at(node.frame + k)]));
        for (int d = 0; d < n; ++d) {
          Scalar rate = magnitude(x_[at(node.v + d)]);
          if (part.is_free) { rate += unseen_[at(node.v + d)]; }
          of_frame = larger(of_frame, Scalar(largest_of(part.column(k, d)) * rate));
        }
        sizes_[at(node.frame + k)].acceleration = of_frame;
      }
    }
  }

  static Pair none()
  {
    const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
    return {zero, zero};
  }
  /// A twist about the point r away.
  static Pair shifted(const Triple<Scalar>& r, const Pair& V) { return {V.linear + cross(V.angular, r), V.angular}; }
  /// A wrench from there.
  static Pair moved(const Triple<Scalar>& r, const Pair& w) { return {w.linear, w.angular + cross(r, w.linear)}; }

  /// On the body of a frame that has the acceleration V̇ at its coupling point: about that point.
  static Pair body_wrench(bool velocity, const FrameMass<Scalar>& body, const Matrix3<Scalar>& R,
                          const Triple<Scalar>& r, const Triple<Scalar>& omega, const Pair& Vdot)
  {
    if (!body.present) { return none(); }
    BodyAccelerated<Scalar> moved(body, R, r, Vdot);
    if (velocity) { moved.add_centripetal(body, omega); }
    return moved.wrench(body);
  }
  /// The same in other axes, those of `accelerations`.
  [[gnu::noinline]] static Pair turned_body_wrench(bool velocity, const FrameMass<Scalar>& body,
                                                   const Matrix3<Scalar>& axes, const FrameState<Scalar>& frame,
                                                   const Pair& Vdot)
  {
    Matrix3<Scalar> R = frame.R;
    turn_each(TransposedRotation<Scalar>(axes), R.data(), 3);
    const Pair r_omega = from_world(&axes, Pair(triple(frame.r), triple(frame.omega)));
    return body_wrench(velocity, body, R, r_omega.linear, r_omega.angular, Vdot);
  }

  ParallelAxes<Scalar> axes_;
  Array<Scalar> load_, x_, change_, unseen_;    // of velocities
  Array<Pair> accelerations_, forces_, moves_;  // of frames
  Array<Scalar> along_;                         // of free ones: Sᵀ of what is on them
  Array<Sizes> sizes_;
  Array<Scalar> scaled_, terms_;  // of one subsystem
};

}  // namespace iim::detail
