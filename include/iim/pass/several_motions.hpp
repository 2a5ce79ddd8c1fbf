// Up to eight accelerations of a frame side by side (motion_products.hpp), followed through what hangs on it as
// single_motion.hpp follows one: sums of the products of each two on the way outward, wrenches on the way back. Numbers
// of a subsystem stay until the next as deep in the tree is reached, so that their room is as deep as the sums go.
#pragma once

#include <iim/body.hpp>
#include <iim/numerics/array.hpp>
#include <iim/numerics/registers.hpp>
#include <iim/pass/free_axis.hpp>
#include <iim/pass/joint_lines.hpp>
#include <iim/pass/motion_products.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>
#include <iim/tree_data.hpp>

#include <cstddef>

namespace iim::detail {

/// Room for it.
template <class Scalar>
class SeveralMotions {
  using Lane = EightLanes<Scalar>;

public:
  [[gnu::cold]] void allocate(Index depths, Index most_frames, Index most_velocities)
  {
    frames_ = most_frames;
    velocities_ = most_velocities;
    a_.resize(at(depths * frames_));
    w_.resize(at(depths * frames_));
    at_inlet_.resize(at(depths));
    load_.resize(at(depths * velocities_));
    qdd_.resize(at(velocities_));
    path_.resize(at(depths));
  }

  /// G += what hangs on subsystem `node`, whose first frame has the accelerations a. is_enough(subsystem, depth from
  /// there, frame, its accelerations, G): whether A of the frame stands for what hangs on it. `springs`: of an implicit
  /// step. wrench: of what is on the frame itself; null if the wrenches are not wanted.
  template <class Bodies, class Data, class Sum, class IsEnough>
  [[gnu::always_inline]] void add_beyond(const Bodies& bodies, const Node& node, const Motions<Lane>& a,
                                         const IsEnough& is_enough, bool springs, const Data& ws, Sum& G,
                                         Motions<Lane>* wrench)
  {
    has_wrench_ = wrench != nullptr;
    copy(a, a_of(0, 0));
    if (has_wrench_) { copy(*wrench, w_of(0, 0)); }
    deepest_ = 0;
    add_beyond(0, node, bodies, is_enough, springs, ws, G);
    if (has_wrench_) { copy(w_of(0, 0), *wrench); }
  }

  /// The same of a free subsystem, a = apart + S·rates along its axis: limbs along that do not feel the latter, but for
  /// what rotors and springs within hold.
  template <class Bodies, class Data, class Sum, class IsEnough>
  [[gnu::always_inline]] void add_beyond_free(const Bodies& bodies, const Node& node, const Motions<Lane>& a,
                                              const Motions<Lane>& apart, const Lane& rates, const IsEnough& is_enough,
                                              bool springs, const Data& ws, Sum& G)
  {
    apart_ = &apart;
    rates_ = &rates;
    add_beyond(bodies, node, a, is_enough, springs, ws, G, nullptr);
    apart_ = nullptr;
  }

  /// The same of subsystem `node` itself and what hangs on it, its inlet at rest, q̈ the columns of C. wrench: on the
  /// inlet.
  template <class Bodies, class Data, int n, class Sum, class IsEnough>
  [[gnu::always_inline]] void add_of_velocities(const Bodies& bodies, const Node& node,
                                                const Eigen::Matrix<Scalar, n, n>& C, const IsEnough& is_enough,
                                                bool springs, const Data& ws, Sum& G, Motions<Lane>& wrench)
  {
    has_wrench_ = true;
    for (int d = 0; d < n; ++d) {
      side_by_side<Lane, Scalar, n>([&](int k) __attribute__((always_inline)) { return C(d, k); }, qdd_[at(d)]);
    }
    Motions<Lane> y;
    for (Lane& x : y) { clear<Scalar>(x); }
    const auto never = [](auto&&...) { return false; };
    move_frames(node, 1, y, bodies, never, ws, G);
    if (bodies.has_more(node.index, ws)) { add_more(node, 1, y, bodies, springs, ws, G); }
    add_beyond(1, node, bodies, is_enough, springs, ws, G);
    copy(w_of(1, 0), wrench);
    for (int k = 1; k < bodies.part(node.index).n_frames; ++k) { add(w_of(1, k), wrench); }
    if (bodies.has_more(node.index, ws)) { add(at_inlet_[1], wrench); }
  }

private:
  Motions<Lane>& a_of(Index depth, Index frame) { return a_[at(depth * frames_ + frame)]; }
  Motions<Lane>& w_of(Index depth, Index frame) { return w_[at(depth * frames_ + frame)]; }
  static void add(const Motions<Lane>& x, Motions<Lane>& sum)
  {
#pragma GCC unroll 8
    for (std::size_t i = 0; i < 6; ++i) { sum[i] += x[i]; }
  }

  /// What hangs on `node`, which is `from` deep.
  template <class Bodies, class Data, class Sum, class IsEnough>
  [[gnu::always_inline]] void add_beyond(Index from, const Node& node, const Bodies& bodies, const IsEnough& is_enough,
                                         bool springs, const Data& ws, Sum& G)
  {
    for (Index i = node.index + 1; i < node.subtree_end;) {
      const Node& next = ws.tree().node(i);
      const Index depth = from + ws.tree().depth(i) - ws.tree().depth(node.index);
      come_back(depth, bodies, ws);
      const bool whole = bodies.part(i).is_free || move(next, depth, bodies, is_enough, springs, ws, G);
      i = whole ? next.subtree_end : i + 1;
    }
    come_back(from + 1, bodies, ws);
  }

  /// Whether the frames of a subsystem are whole.
  template <class Bodies, class Data, class Sum, class IsEnough>
  [[gnu::always_inline]] bool move(const Node& node, Index depth, const Bodies& bodies, const IsEnough& is_enough,
                                   bool springs, const Data& ws, Sum& G)
  {
    const auto& part = bodies.part(node.index);
    const int n = part.n_i;
    const FreeLimb<Scalar>* const limb = depth == 1 && apart_ != nullptr ? ws.free_limb(node.index) : nullptr;
    Motions<Lane> y;
    copy(limb != nullptr ? *apart_ : a_of(depth - 1, node.inlet - ws.tree().node(node.parent).frame), y);
    move_twist(*part.r, y);
    for (int d = 0; d < n; ++d) {
      const Scalar* const W = part.W + d;
      qdd_[at(d)] =
          -(y[0] * W[0] + y[1] * W[n] + y[2] * W[2 * n] + y[3] * W[3 * n] + y[4] * W[4 * n] + y[5] * W[5 * n]);
    }
    Lane rates;
    clear<Scalar>(rates);
    if (limb != nullptr) [[unlikely]] {
      rates = *rates_;
      if (limb->sense == Sense::opposite) { rates *= Scalar(-1); }
      qdd_[0] += rates * limb->slip;
    }
    const bool whole = move_frames(node, depth, y, bodies, is_enough, ws, G);
    if (bodies.has_more(node.index, ws)) {
      if (limb != nullptr) [[unlikely]] {
        qdd_[0] -= rates;
#pragma GCC unroll 8
        for (std::size_t i = 0; i < 6; ++i) { y[i] += rates * part.S[i]; }
      }
      add_more(node, depth, y, bodies, springs, ws, G);
    }
    return whole;
  }

  /// The frames, with guidance accelerations y and qdd_.
  template <class Bodies, class Data, class Sum, class IsEnough>
  [[gnu::always_inline]] bool move_frames(const Node& node, Index depth, const Motions<Lane>& y, const Bodies& bodies,
                                          const IsEnough& is_enough, const Data& ws, Sum& G)
  {
    const auto& part = bodies.part(node.index);
    const int n = part.n_i;
    const Scalar* S = part.S;
    bool whole = true;
    for (int k = 0; k < part.n_frames; ++k) {
      Motions<Lane> a;
      copy(y, a);
      for (int d = 0; d < n; ++d, S += 6) {
#pragma GCC unroll 8
        for (std::size_t i = 0; i < 6; ++i) { a[i] += qdd_[at(d)] * S[i]; }
      }
      copy(a, a_of(depth, k));
      whole &= is_enough(depth, node.frame + k, a_of(depth, k), G);
    }
    for (int k = 0; k < part.n_frames; ++k) {
      const Index frame = node.frame + k;
      const auto& f = ws.frame(frame);
      if (whole) {
        add_inertia(f.inertia().A, ws.axes().of(frame), a_of(depth, k), G, w_of(depth, k));
      } else {
        add_body(ws.tree().frame_mass(frame), f.R, f.r, a_of(depth, k), G, w_of(depth, k));
      }
    }
    path_[at(depth)] = node.index;
    deepest_ = depth;
    return whole;
  }

  /// What a subsystem has on its inlet, and what turns within.
  template <class Bodies, class Data, class Sum>
  [[gnu::noinline]] void add_more(const Node& node, Index depth, const Motions<Lane>& y, const Bodies& bodies,
                                  bool springs, const Data& ws, Sum& G)
  {
    const auto& part = bodies.part(node.index);
    Motions<Lane>& of_inlet = at_inlet_[at(depth)];
    Lane* const load = load_.data() + depth * velocities_;
    for (int d = 0; d < part.n_i; ++d) { clear<Scalar>(load[d]); }
    const Vector3<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
    add_body(ws.tree().inlet_mass(node.index), *part.R, zero, y, G, of_inlet);
    // To moment what the carrier turns by, from it what the spin takes. (Registers that are returned are not the same
    // for all processors: g++ warns.)
    const auto spin = [&](const Scalar& inertia, const Scalar* ratio, Lane& moment) {
      Lane rate = moment;
      for (int d = 0; d < part.n_i; ++d) { rate += qdd_[at(d)] * ratio[d]; }
      moment = rate * inertia;
      add_products<Lane, 1>({rate}, {moment}, G);
      for (int d = 0; d < part.n_i; ++d) { load[d] += moment * ratio[d]; }
    };
    bodies.for_each_rotor(node.index, [&](const auto& rotor, const Scalar* ratio) {
      const bool on_inlet = rotor.frame < 0;
      const Motions<Lane>& carrier = on_inlet ? y : a_of(depth, rotor.frame);
      Vector3<Scalar> axis = zero;
      if (rotor.coupled) { axis = times(on_inlet ? *part.R : ws.frame(node.frame + rotor.frame).R, rotor.axis); }
      Lane moment = carrier[3] * axis(0) + carrier[4] * axis(1) + carrier[5] * axis(2);
      spin(rotor.inertia, ratio, moment);
      Motions<Lane>& w = on_inlet ? of_inlet : w_of(depth, rotor.frame);
      for (int i = 0; i < 3; ++i) { w[at(i + 3)] += moment * axis(i); }
    });
    if (springs) {
      bodies.for_each_spring(node.index, [&](const Scalar& inertia, const Scalar* ratio) {
        Lane moment;
        clear<Scalar>(moment);
        spin(inertia, ratio, moment);
      });
    }
  }

  /// What subsystems from `depth` on, of which nothing more is to come, hand on.
  template <class Bodies, class Data>
  [[gnu::noinline]] void come_back(Index depth, const Bodies& bodies, const Data& ws)
  {
    for (; deepest_ >= depth; --deepest_) {
      if (!has_wrench_) { continue; }
      const Node& node = ws.tree().node(path_[at(deepest_)]);
      const auto& part = bodies.part(node.index);
      const int n = part.n_i;
      const bool has_more = bodies.has_more(node.index, ws);
      Motions<Lane> w;
      copy(w_of(deepest_, 0), w);
      for (int k = 1; k < part.n_frames; ++k) { add(w_of(deepest_, k), w); }
      if (has_more) { add(at_inlet_[at(deepest_)], w); }
      for (int d = 0; d < n; ++d) {
        Lane load;
        clear<Scalar>(load);
        if (has_more) { load = load_[at(deepest_ * velocities_ + d)]; }
        for (int k = 0; k < part.n_frames; ++k) {
          const Motions<Lane>& of_frame = w_of(deepest_, k);
          const Scalar* const S = part.S + 6 * (k * n + d);
#pragma GCC unroll 8
          for (std::size_t i = 0; i < 6; ++i) { load += of_frame[i] * S[i]; }
        }
#pragma GCC unroll 8
        for (int i = 0; i < 6; ++i) { w[at(i)] -= load * part.W[i * n + d]; }
      }
      move_wrench(*part.r, w);
      add(w, w_of(deepest_ - 1, node.inlet - ws.tree().node(node.parent).frame));
    }
  }

  Array<Motions<Lane>> a_, w_;  // of the frames of one subsystem at each depth
  Array<Motions<Lane>> at_inlet_;
  Array<Lane> load_;  // of its velocities: what turns within
  Array<Lane> qdd_;   // of one subsystem's velocities
  Array<Index> path_;
  Index frames_ = 1, velocities_ = 0, deepest_ = 0;
  bool has_wrench_ = false;
  const Motions<Lane>* apart_ = nullptr;  // else while sums are a free subsystem's
  const Lane* rates_ = nullptr;
};

}  // namespace iim::detail
