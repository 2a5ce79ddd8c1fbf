// O(n) forward dynamics of a tree of subsystems, Sect. 2.3: three loops.
//
// In axes parallel to the world with own origins the recursions (14)–(19) read, with i's inlet on a frame of p,
//
//     y_i  = X(r_i) V̇_inlet + (c_i; 0)                        guidance acceleration, c_i = ω × (ω × r_i)
//     U = Σ_k A_k S_k,   D = M̄_R = Σ_k S_kᵀ A_k S_k,   W = D⁻¹ Uᵀ                                    (17)
//     A' = Σ_k P_kᵀ A_k P_k + …,  P_k = 1 − S_k W             what p sees of i: T*ᵀ M̄* T before the shift  (14), (16)
//     p' = h_g − Wᵀ h_q                                                                              (15)
//     q̈_i = −D⁻¹ h_q − W y_i                                                                         (18)
//     V̇_k = y_i + S_k q̈_i + bias_k                                                                   (19)
//
// with A_k, h_k inertia and bias wrench of what frame k carries, bodies and children; h_g = Σ_k (A_k bias_k + h_k),
// h_q = Σ_k S_kᵀ (A_k bias_k + h_k) + internal forces. Gravity is the world accelerating upward.
#pragma once

#include <iim/errors.hpp>
#include <iim/inputs.hpp>
#include <iim/pass/inward.hpp>
#include <iim/pass/kinematics.hpp>
#include <iim/receipt.hpp>
#include <iim/scalar.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>
#include <iim/workspace.hpp>

#include <cassert>
#include <cstddef>
#include <type_traits>

namespace iim {

namespace detail {

/// Of the pass what depends on Scalar and update alone, and the steps of single subsystems.
template <Scene scene, class Data>
class PassSteps {
public:
  using Scalar = typename Data::Scalar;

  PassSteps(Data& ws, const Scalar& step) : ws_(ws), step_(step)
  {
    ws_.begin_use(scene.implicit);
    if constexpr (is_several<Scalar>) { ws_.places().begin(ws_.tree(), ws_.frames()); }
    begin();
  }

  /// h̄ −= B̄ u: motor torques on the velocities, contact wrenches on the frames.
  template <class InputScalar, class U>
  void apply(const InputBlocks<InputScalar>& inputs, const U& u)
  {
    inputs.for_each_active([&](const auto& input, Index column) {
      if (!detail::all_finite(u.segment(column, input.size))) {
        diagnosis_.fail(Status::invalid_state, input.subsystem);
      }
      if (input.kind != InputKind::motor) {
        const FrameState<Scalar>& f = ws_.frame(input.frame);
        Vector6<Scalar> wrench = input_wrench(input, f, 0) * u(column);
        for (Index j = 1; j < input.size; ++j) { wrench += input_wrench(input, f, j) * u(column + j); }
        apply(input.frame, wrench);
        return;
      }
      const Index rows = input.velocities;
      for (Index j = 0; j < input.size; ++j) {
        ws_.load().segment(input.v, rows) += ws_.Bbar().segment(input.bbar + j * rows, rows) * u(column + j);
      }
    });
  }

  Diagnosis& diagnosis() { return diagnosis_; }
  Acceleration<Scalar> acceleration() const { return {ws_.qdd(), diagnosis_.status, diagnosis_.subsystem}; }

protected:
  /// A wrench on a frame, at its coupling point.
  void apply(Index frame, Vector6<Scalar> wrench)
  {
    FrameState<Scalar>& f = ws_.frame(frame);
    if constexpr (refines<Data>) { ws_.second_look().note_applied(frame, wrench); }
    if (const auto* axes = ws_.axes().of(frame)) { turn_triples(*axes, false, wrench.data(), 2); }
    if constexpr (Data::update == Update::square_root) {
      const RootRow<Scalar> z = put_on_rows(ws_.frame_body(frame), f.R, f.bodies_at(), wrench);
      for (int k = 0; k < ws_.frame_body(frame).rows; ++k) { ws_.root(frame).own.at(rhs, k) += z(k); }
    } else {
      if constexpr (is_several<Scalar>) { ws_.places().keep(frame, ws_.tree(), ws_.frames()); }
      arrive<scene.velocity>(frame, ws_);
    }
    f.inertia().h -= wrench;
  }

  void begin()
  {
    diagnosis_ = Diagnosis{};
    if constexpr (refines<Data>) { ws_.second_look().clear(); }
    ws_.load().setZero();
    if (!(step_ >= Scalar(0)) || !detail::is_finite(step_)) { diagnosis_.fail(Status::invalid_state, -1); }
  }

  /// Whether the pass must start over, since a small pivot needs inertias that have been overwritten: those of frames
  /// that share memory (SharedPlaces). asked: what OneByOne said before the pass.
  bool begins_again([[maybe_unused]] bool asked)
  {
    if constexpr (is_several<Scalar>) {
      if (ws_.places().mends_lack(ws_.tree(), ws_.frames())) [[unlikely]] {
        if (!asked) { OneByOne<Scalar>::withdraw(); }
        begin();
        return true;
      }
    }
    return false;
  }

  // Inlined: called, it costs the pass of an arm 1 %.
  template <class S>
  [[gnu::always_inline]] void accelerate(const Node& node, const NodeMemory<S>& state)
  {
    if constexpr (follows_free_axis<S, Data>) {
      if (const FreeLimb<Scalar>* const limb = ws_.free_limb(node.index)) [[unlikely]] {
        accelerate_apart<S>(*limb, node, state);
        return;
      }
    }
    TriplePair<Scalar> y;
    // Of q̈, against the inlet's rate along the same motion.
    constexpr bool shares = shares_motion<S, Data>;
    [[maybe_unused]] Scalar undone[shares && S::n_i > 1 ? S::n_i : 1];
    [[maybe_unused]] Scalar slip(0);
    if constexpr (shares) {
      for (Scalar& of_velocity : undone) { of_velocity = Scalar(0); }
    }
    if (node.inlet >= 0) {
      y = guidance(node, state, undone, slip);
      if constexpr (scene.velocity) { y.linear += Triple<Scalar>::settled(state.c.data()); }
    } else {
      const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
      y = {zero, zero};
      if constexpr (scene.gravity) {
        const Vector3<Scalar>& g = ws_.tree().gravity();
        y.linear = Triple<Scalar>(-g(0), -g(1), -g(2));
      }
    }
    detail::Velocities<S> qdd;
#pragma GCC unroll 8
    for (int d = 0; d < S::n_i; ++d) {
      qdd(d) = -state.psi(d) - follow(node, state, d, y);
      if constexpr (shares) {
        ws_.qdd()(node.v + d) = qdd(d) - undone[d];
      } else {
        ws_.qdd()(node.v + d) = qdd(d);
      }
      if constexpr (one_column<S, Data>) { qdd(d) += slip; }
    }
#pragma GCC unroll 2
    for (int k = 0; k < S::n_frames; ++k) {
      FrameState<Scalar>& f = ws_.frame(node.frame + k);
      TriplePair<Scalar> Vdot = y;
      if constexpr (has_bias<scene, S>(0)) { Vdot.linear += Triple<Scalar>::settled(f.bias.data()); }
      if constexpr (has_bias<scene, S>(3)) { Vdot.angular += Triple<Scalar>::settled(f.bias.data() + 3); }
      if constexpr (one_column<S, Data>) {
        Vdot.put(ws_.root(node.frame).rest.data());
        ws_.root(node.frame).rate = qdd(0);
      }
      if constexpr (is_free<S>() && Data::update == Update::square_root) {
        const RootInertia<Scalar>& N_k = ws_.root(node.frame);
        f.Vdot = N_k.rest;
        if (N_k.keeps_v) {
          for (int i = 0; i < 6; ++i) { f.Vdot(i) += N_k.S(i) * N_k.rate; }
        }
        continue;
      }
      if constexpr (is_free<S>()) { continue; }  // is there since its step inward
      const auto& S_k = state.S_k[static_cast<std::size_t>(k)];
#pragma GCC unroll 8
      for (int d = 0; d < S::n_i; ++d) {
        const Scalar* const column = S_k.data() + 6 * d;
        if constexpr (S::pattern.linear) { Vdot.linear += Triple<Scalar>::settled(column) * qdd(d); }
        if constexpr (S::pattern.angular) { Vdot.angular += Triple<Scalar>::settled(column + 3) * qdd(d); }
      }
      Vdot.put(f.Vdot.data());
    }
  }

  /// q̈ is NaN after a failure.
  void check_finite()
  {
    if (diagnosis_.status == Status::ok) {
      if (!detail::all_finite(ws_.qdd())) {
        diagnosis_.fail(Status::not_finite, -1);  // it spreads to the root, wherever it began
      } else if (holds()) {
        return;
      }
    }
    ws_.qdd().setConstant(not_a_number<Scalar>());
  }

  Data& ws_;
  Scalar step_;
  Diagnosis diagnosis_;

private:
  /// A limb's first joint along a free base's axis. What the base moves by along S it undoes, but for what rotors
  /// within hold. (Within `accelerate` it costs the pass of all other robots 1 to 2 %.)
  template <class S>
  [[gnu::noinline]] void accelerate_apart(const FreeLimb<Scalar>& limb, const Node& node, const NodeMemory<S>& state)
  {
    FrameState<Scalar>& f = ws_.frame(node.frame);
    const FreeAxis<Scalar>& axis = ws_.free_axis_of(limb);
    const Scalar rate = in_sense(limb.sense, axis.rate);
    TriplePair<Scalar> y = shifted(state.r, axis.rest);
    if constexpr (scene.velocity) { y.linear += triple(state.c); }
    const Scalar rest = Scalar(0) - state.psi(0) - dot(gain(state, 0), y), qdd = rest + limb.slip * rate;
    ws_.qdd()(node.v) = rest - limb.undone * rate;
    if constexpr (has_bias<scene, S>(0)) { y.linear += Triple<Scalar>(f.bias.data()); }
    if constexpr (has_bias<scene, S>(3)) { y.angular += Triple<Scalar>(f.bias.data() + 3); }
    y += TriplePair<Scalar>(state.S_k[0].data()) * qdd;
    y.put(f.Vdot.data());
  }

  /// X(r) V̇ of the inlet, without what the joint undoes of it.
  template <class S>
  [[gnu::always_inline]] TriplePair<Scalar> guidance(const Node& node, const NodeMemory<S>& state,
                                                     [[maybe_unused]] Scalar* undone,
                                                     [[maybe_unused]] Scalar& slip) const
  {
    if constexpr (Data::update == Update::square_root) {
      const RootInertia<Scalar>& inlet = ws_.root(node.inlet);
      if (inlet.keeps_v) {
        const SharedAxis<Scalar>& shared = ws_.shared_axis(node.index);
        TriplePair<Scalar> y = shifted(state.r, inlet.rest);
        y += TriplePair<Scalar>(shared.difference.data()) * inlet.rate;
        if constexpr (shares_motion<S, Data>) {
          for (int d = 0; d < S::n_i; ++d) { undone[d] = shared.undone(d) * inlet.rate; }
        }
        slip = shared.slip * inlet.rate;
        return y;
      }
    }
    return shifted(state.r, ws_.frame(node.inlet).Vdot);
  }

  /// W y of velocity d. With three numbers in a register steps wait more than they compute: there it is W X(r) V̇ of the
  /// inlet and W c, where W X(r) waits for nothing (pass of an arm and of chains 6 % less, of the biped 2 %).
  template <class S>
  [[gnu::always_inline]] Scalar follow(const Node& node, const NodeMemory<S>& state, int d,
                                       const TriplePair<Scalar>& y) const
  {
    TriplePair<Scalar> W = gain(state, d);
    if constexpr (three_in_register<Scalar> && Data::update != Update::square_root) {
      if (node.inlet >= 0) {
        Scalar known(0);
        if constexpr (scene.velocity) { known = dot(W.linear, Triple<Scalar>::settled(state.c.data())); }
        W.angular += cross(Triple<Scalar>::settled(state.r.data()), W.linear);
        return known + dot(W, TriplePair<Scalar>(ws_.frame(node.inlet).Vdot.data()));
      }
    }
    return dot(W, y);
  }

  /// Row d of W.
  template <class S>
  [[gnu::always_inline]] static TriplePair<Scalar> gain(const NodeMemory<S>& state, int d)
  {
    const auto& W = state.W;
    if constexpr (S::n_i == 1) { return TriplePair<Scalar>::settled(W.data()); }
    return {Triple<Scalar>(W(d, 0), W(d, 1), W(d, 2)), Triple<Scalar>(W(d, 3), W(d, 4), W(d, 5))};
  }

  /// shift_twist, in registers. Six numbers in memory g++ wrote one by one and read together in some programs, which
  /// had to wait (8 % of an arm, 11 % of a chain of 20 with one motor).
  [[gnu::always_inline]] static TriplePair<Scalar> shifted(const Vector3<Scalar>& r, const Vector6<Scalar>& V)
  {
    const TriplePair<Scalar> at(V.data());
    return {at.linear + cross(at.angular, Triple<Scalar>::settled(r.data())), at.angular};
  }

  /// Of q̈, where small pivots went into it.
  bool holds()
  {
    if constexpr (refines_root<Data>) {
      if constexpr (scene.implicit) { return true; }  // springs are in the rows, not in load()
      if (ws_.second_look().has_heavy()) [[unlikely]] {
        ws_.second_look().refine_root(scene.velocity, scene.gravity, ws_);
      }
    } else if constexpr (refines<Data>) {
      if (ws_.second_look().is_needed_for_acceleration()) [[unlikely]] {
        if (!ws_.second_look().refine(scene.velocity, scene.gravity, scene.implicit, ws_)) {
          diagnosis_.fail(Status::not_positive_definite, ws_.second_look().first());
          return false;
        }
        if (!detail::all_finite(ws_.qdd())) {
          diagnosis_.fail(Status::not_finite, -1);
          return false;
        }
      }
    }
    return true;
  }
};

/// The three loops.
template <Scene scene, class Workspace>
class ForwardPass : public PassSteps<scene, typename Workspace::Data> {
  using Data = typename Workspace::Data;
  using Steps = PassSteps<scene, Data>;

public:
  using Scalar = typename Workspace::Scalar;

  explicit ForwardPass(Workspace& ws, const Scalar& step = Scalar(0)) : Steps(ws, step) {}

  /// Whether q and q̇ have the tree's sizes. If not, nothing else of the pass is to be called but its receipt.
  template <class Q, class V>
  bool fits(const Q& q, const V& qd)
  {
    static_assert(std::is_same_v<typename Q::Scalar, Scalar> && std::is_same_v<typename V::Scalar, Scalar>,
                  "q and qd must have the Scalar of the tree: q.cast<Scalar>()");
    const bool q_fits = q.size() == ws_.tree().n_q(), qd_fits = !scene.velocity || qd.size() == ws_.tree().n_v();
    assert(q_fits && "q must have n_q entries");
    assert(qd_fits && "qd must have n_v entries");
    return q_fits && qd_fits ? true : refuse();
  }
  /// Whether the inputs and u have.
  template <class InputScalar, class U>
  bool takes(const InputBlocks<InputScalar>& inputs, const U& u)
  {
    static_assert(std::is_same_v<typename U::Scalar, Scalar>, "u must have the Scalar of the tree: u.cast<Scalar>()");
    const bool is_same = inputs.tree().id() == ws_.tree().id(), u_fits = u.size() == inputs.columns();
    assert(is_same && "the inputs are those of another tree than the workspace's");
    assert(u_fits && "u must have one entry per active column");
    return is_same && u_fits ? true : refuse();
  }

  /// The first two loops. load(): what is applied between them.
  template <class Q, class V, class Load>
  void out_and_in(const Q& q, const V& qd, Load&& load)
  {
    const bool asked = OneByOne<Scalar>::is_asked();
    do {
      kinematics(q, qd);
      load();
      inertia();
    } while (this->begins_again(asked));
  }

  /// From the base outward again: accelerations, (18) and (19). also(node, its memory): what else goes outward. Each of
  /// the two waits for its step before, and the other runs meanwhile.
  template <class Also>
  void accelerations(Also&& also)
  {
    const Workspace& ws = workspace();
    ws.tree().outward([&]<class S>(const Node& node, const S&) {
      const NodeState<S>& state = ws.template node<S>(node);
      this->accelerate(node, state);
      also(node, state);
    });
    this->check_finite();  // only now: an overflow anywhere above has reached q̈
  }
  void accelerations()
  {
    const Workspace& ws = workspace();
    ws.tree().outward_abreast(
        [&]<class S>(const Node& node, const S&) { this->accelerate(node, ws.template node<S>(node)); });
    this->check_finite();
  }

  ForwardDynamics<Workspace> receipt() const
  {
    return {static_cast<const Workspace&>(ws_), scene, step_, diagnosis_.status, diagnosis_.subsystem};
  }

private:
  using Steps::diagnosis_;
  using Steps::step_;
  using Steps::ws_;

  Workspace& workspace() { return static_cast<Workspace&>(ws_); }

  template <class Q, class V>
  void kinematics(const Q& q, const V& qd)
  {
    detail::kinematics<scene>(q, qd, workspace(), diagnosis_, step_);
    if constexpr (Workspace::update != Update::square_root) {
      if (!ws_.axes().empty()) {
        ws_.axes().choose([&](Index f) -> const Matrix3<Scalar>& { return ws_.frame(f).R; });
      }
    }
  }

  /// From the tips inward: what the tree beyond each coupling point looks like from there, (14)–(17).
  void inertia()
  {
    Workspace& ws = workspace();
    if constexpr (Workspace::update == Update::square_root) {
      for (const FreeAxis<Scalar>& axis : ws.free_axes()) { set_free_axis(axis, ws_); }
      ws.clear_tapes();
      ws.clear_rows();
    }
    Scalar largest_inverse(0);
    const auto step = [&]<class S>(const Node& node, const S& s) {
      inward<scene_inward<S>(scene)>(node, s, ws.template node<S>(node), static_cast<Data&>(ws), diagnosis_,
                                     largest_inverse);
    };
    // In square-root form, and of several states, frames share places, which are given for depth-first order. (Rows'
    // steps are too long for the next to begin meanwhile: measured 1 % slower.)
    if constexpr (std::is_floating_point_v<Scalar> && Workspace::update != Update::square_root) {
      ws.tree().inward_abreast(step);
    } else {
      ws.tree().inward(step);
    }
    if constexpr (looks_again<Data>) {
      if (ws.second_look().is_needed() && diagnosis_.status == Status::ok) [[unlikely]] {
        const Index wrong = ws.second_look().wrong_pivot(scene.implicit, static_cast<Data&>(ws));
        if (wrong >= 0) { diagnosis_.fail(Status::not_positive_definite, wrong); }
      }
    }
  }

  bool refuse()
  {
    diagnosis_.fail(Status::mismatch, -1);
    this->check_finite();
    return false;
  }
};

}  // namespace detail

}  // namespace iim
