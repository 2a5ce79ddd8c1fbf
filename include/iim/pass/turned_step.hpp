// A subsystem's step inward in axes of its own (parallel_axes.hpp).
#pragma once

#include <iim/pass/articulated_inertia.hpp>
#include <iim/pass/parallel_axes.hpp>
#include <iim/subsystem.hpp>
#include <iim/workspace.hpp>

namespace iim::detail {

/// What a subsystem with one frame reads and writes in its step, whatever its type: one with at most one velocity, or a
/// free one.
template <class Scalar>
struct StepData {
  Matrix3<Scalar>& R;
  Vector3<Scalar>& r;
  Vector3<Scalar>& c;
  Scalar* S;
  Scalar* U;
  Scalar* W;
  int n_i;
  int n_results;  ///< columns of U and rows of W that the step writes

  template <class Type>
  explicit StepData(NodeMemory<Type>& state)
      : R(state.R), r(state.r), c(state.c), S(state.S_k[0].data()), U(state.U.data()), W(state.W.data()),
        n_i(Type::n_i), n_results(Type::is_free ? 0 : n_i)
  {
  }
};
template <class Type>
StepData(NodeMemory<Type>&) -> StepData<typename Type::Scalar>;

/// Around the step of a subsystem while any axes are turned: what it reads turns into its own, what it has handed on
/// turns into those of its inlet, and all but A and h returns to the world's.
template <class Workspace>
class TurnedStep {
  using Scalar = typename Workspace::Scalar;
  using Data = StepData<Scalar>;

public:
  /// receiver: the frame that takes what the step hands on, the inlet or FreeAxis::receiver.
  [[gnu::noinline]] void enter(Index f, Index inlet, Index receiver, const Data& data, Workspace& ws)
  {
    own_ = ws.axes().of(f);
    there_ = ws.axes().of(inlet);
    if (own_) {
      FrameState<Scalar>& frame = ws.frame(f);
      std::copy_n(data.S, 6 * data.n_i, S_.data());
      R_inlet_ = data.R;
      r_ = data.r;
      c_ = data.c;
      R_ = frame.R;
      r_frame_ = frame.r;
      omega_ = frame.omega;
      bias_ = frame.bias;
      const TransposedRotation<Scalar> into(*own_);
      turn_each(into, data.S, 2 * data.n_i);
      turn_each(into, data.R.data(), 3);
      turn_each(into, data.r.data(), 1);
      turn_each(into, data.c.data(), 1);
      turn_each(into, frame.R.data(), 3);
      turn_each(into, frame.r.data(), 1);
      turn_each(into, frame.omega.data(), 1);
      turn_each(into, frame.bias.data(), 2);
      if (inlet >= 0) {
        omega_inlet_ = ws.frame(inlet).omega;
        turn_each(into, ws.frame(inlet).omega.data(), 1);
      }
    }
    if (inlet >= 0 && own_ != there_) {
      FrameState<Scalar>& to = ws.frame(receiver);
      had_ = to.arrived;
      FrameInertia<Scalar>& there = to.inertia();
      lost_ = to.loses;
      if (had_) { before_ = there; }
      if constexpr (is_several<Scalar>) {  // what is handed on is added to what is there
        const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
        there.A.set_zero();
        there.h.setZero();
        there.size = {zero, zero};
        to.loses = false;
      } else {
        to.arrived = false;
      }
    }
  }

  [[gnu::noinline]] void leave(Index f, Index inlet, Index receiver, const Data& data, Workspace& ws) const
  {
    if (own_) {
      FrameState<Scalar>& frame = ws.frame(f);
      std::copy_n(S_.data(), 6 * data.n_i, data.S);
      data.R = R_inlet_;
      data.r = r_;
      data.c = c_;
      frame.R = R_;
      frame.r = r_frame_;
      frame.omega = omega_;
      frame.bias = bias_;
      turn_triples(*own_, true, data.U, 2 * data.n_results);
      turn_triples(*own_, true, data.W, 2 * data.n_results);
      if (inlet >= 0) { ws.frame(inlet).omega = omega_inlet_; }
    }
    if (inlet >= 0 && own_ != there_) { hand_over(ws.frame(receiver)); }
  }

  /// From the step's axes to the world's.
  void turn_to_world(Scalar* triples, int count) const
  {
    if (own_) { turn_triples(*own_, true, triples, count); }
  }

  /// What has been handed on beside A and h: from the step's axes to the inlet's.
  void turn_to_inlet(Scalar* triples, int count) const
  {
    if (own_ == there_) { return; }
    if (own_) { turn_triples(*own_, true, triples, count); }
    if (there_) { turn_triples(*there_, false, triples, count); }
  }

private:
  /// What has come to the inlet, in its axes, to what was there.
  void hand_over(FrameState<Scalar>& inlet) const
  {
    if (!is_several<Scalar> && !inlet.arrived) {  // a free base hands on nothing
      inlet.arrived = had_;
      return;
    }
    Matrix3<Scalar> E = Matrix3<Scalar>::Identity();
    if (own_) { E = *own_; }
    if (there_) { turn_triples(*there_, false, E.data(), 3); }
    FrameInertia<Scalar>& there = inlet.inertia();
    const SpatialInertia<Scalar> came = there.A;
    const Columns<Scalar> axes(E);
    turn_each(axes, there.h.data(), 2);
    Matrix3<Scalar> squares;
    for (int k = 0; k < 9; ++k) { squares.data()[k] = E.data()[k] * E.data()[k]; }
    there.A = {turned_block(E, came.M), turned_block(E, came.H), turned_block(E, came.J)};
    there.size = {combined(squares, there.size.linear), combined(squares, there.size.angular)};
    if (inlet.loses) { there.loss = {combined(E, there.loss.linear), combined(E, there.loss.angular)}; }
    if (!had_) { return; }
    there.A += before_.A;
    add(there.h, before_.h);
    there.size = {max(before_.size.linear, there.size.linear), max(before_.size.angular, there.size.angular)};
    if (inlet.loses && lost_) { there.loss += before_.loss; }
    if (!inlet.loses && lost_) { there.loss = before_.loss; }
    inlet.loses |= lost_;
  }

  const Matrix3<Scalar>* own_;    // null: the world's
  const Matrix3<Scalar>* there_;  // of the inlet

  // In the world's axes, while the step is taken.
  Matrix6<Scalar> S_;
  Vector6<Scalar> bias_;
  Matrix3<Scalar> R_inlet_, R_;
  Vector3<Scalar> r_, c_, r_frame_, omega_, omega_inlet_;

  FrameInertia<Scalar> before_;  // what the inlet had
  bool had_, lost_;
};

}  // namespace iim::detail
