// The step inward of a subsystem with internal velocities, in matrix form (Update::printed, projected), part by part:
// what the tree beyond it looks like from its coupling point, (14)–(17).
#pragma once

#include <iim/numerics/spd.hpp>
#include <iim/pass/articulated_inertia.hpp>
#include <iim/pass/carried.hpp>
#include <iim/pass/free_limb.hpp>
#include <iim/pass/internal_inertia.hpp>
#include <iim/pass/kinematics.hpp>
#include <iim/pass/mended_compound.hpp>
#include <iim/pass/mended_root.hpp>
#include <iim/pass/roundings.hpp>
#include <iim/pass/weak_pivot.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>
#include <iim/workspace.hpp>

#include <algorithm>
#include <array>
#include <cstddef>

namespace iim::detail {

/// M̄_R q̈_i + h = 0, for an inlet that stays.
template <class S>
struct JointEquation {
  using VectorI = Eigen::Matrix<typename S::Scalar, S::n_i, 1>;
  using MatrixI = Eigen::Matrix<typename S::Scalar, S::n_i, S::n_i>;
  MatrixI D;                  ///< M̄_R
  MatrixI D_inv;              ///< read back from the workspace it would wait for the store (inward loop 3 %)
  VectorI h;                  ///< h_q
  VectorI h_unloaded;         ///< without the load
  VectorI scale, scale_of_A;  ///< of the roundings of D's diagonal; by those of A alone
  VectorI loss;               ///< Sᵀ loss, if there is any (roundings.hpp)
};

/// Parts of the step, to be called in the order in which they stand here. They are inlined, and what they share stays
/// in registers: called, a motor-arm's step takes 6 % longer.
template <Scene scene, class S, class Workspace>
class JointStep {
public:
  using Scalar = typename S::Scalar;

  JointStep(const Node& node, const S& s, NodeState<S>& state, Workspace& ws, Diagnosis& diagnosis,
            JointEquation<S>& joint)
      : node_(node), s_(s), state_(state), ws_(ws), diagnosis_(diagnosis), joint_(joint)
  {
  }

  /// U = Σ A_k S_k, D = M̄_R = Σ S_kᵀ A_k S_k, (16), (17), and bias forces h_g, h_q, over the frames.
  [[gnu::always_inline]] void sum_frames()
  {
#pragma GCC unroll 8
    for (int d = 0; d < n_i; ++d) { joint_.h(d) = joint_.scale(d) = Scalar(0); }
#pragma GCC unroll 2
    for (int k = 0; k < n_frames; ++k) { sum_frame(k); }
    if constexpr (in_registers) {
      for (int k = 0; k < n_frames; ++k) { keep(carried_[static_cast<std::size_t>(k)], ws_.frame(node_.frame + k)); }
    }
#pragma GCC unroll 8
    for (int d = 0; d < n_i; ++d) {
      U_[d] = U_k_[0][d];
#pragma GCC unroll 2
      for (std::size_t k = 1; k < n_frames; ++k) { U_[d] += U_k_[k][d]; }
    }
    joint_.scale_of_A = joint_.scale;
  }

  /// To these rotors, the springs of an implicit step, and the load.
  [[gnu::always_inline]] void add_within()
  {
    if constexpr (n_rotors > 0) {
      take_rotors<scene>(node_, s_, state_, ws_, spun_, U_, joint_.D, joint_.scale, hg_, joint_.h);
    }
    if constexpr (scene.implicit) { take_springs<S>(state_, joint_.D, joint_.scale); }
    joint_.h_unloaded = joint_.h;
#pragma GCC unroll 8
    for (int d = 0; d < n_i; ++d) { joint_.h(d) -= ws_.load()(node_.v + d); }
  }

  /// M̄_R⁻¹, mended where pivots are small.
  [[gnu::always_inline]] void invert()
  {
    weak_ = loses(joint_.D, joint_.scale);
    if constexpr (small == Mended::pivot) {
      if (weak_) [[unlikely]] { mend_pivot(); }
    }
    for (int k = 0; k < n_frames; ++k) { losing_ |= ws_.frame(node_.frame + k).loses; }
    if (losing_ || weak_) [[unlikely]] {
      joint_.loss = along_loss(&ws_.frame(node_.frame), state_);
      for (int d = 0; d < n_i; ++d) { joint_.scale(d) += joint_.loss(d) * joint_.loss(d); }
    }
    bool positive = invert_spd<Scalar, n_i>(joint_.D, joint_.scale, state_.MbarR_inv_root, joint_.D_inv, mended_);
    if constexpr (small == Mended::root) {
      if (is_weak(state_.MbarR_inv_root, joint_.scale_of_A, Scalar(2), Scalar(0)) && diagnosis_.status == Status::ok &&
          !has_inertia_within<scene.implicit, S>(state_, SpunRotors<S>(spun_))) [[unlikely]] {
        mended_ =
            mend<pattern>(node_, state_.S_k[0], size_[0], ws_.is_implicit(), ws_,
                          Reduction<Scalar, n_i>{state_.MbarR_inv_root, joint_.D_inv, W_, carried_[0].A, positive});
        weak_ = weak_ && !mended_;
      }
    }
    if constexpr (small == Mended::compound) {
      if (is_weak(state_.MbarR_inv_root, joint_.scale_of_A, Scalar(8), Scalar(0)) && diagnosis_.status == Status::ok &&
          ws_.axes().of(node_.frame) == nullptr) [[unlikely]] {  // what is beyond stands in the world's axes
        mended_ = mend_compound<Scalar, n_i>(node_, joint_.D, joint_.scale, ws_.is_implicit(), ws_, positive,
                                             state_.MbarR_inv_root, joint_.D_inv, V_, W_);
        weak_ = weak_ && !mended_;
      }
    }
    if (!positive) [[unlikely]] { note_small_pivot(node_, ws_, diagnosis_); }
  }

  /// To the largest M̄_R⁻¹ of a motion that the pass has met: free_inward.hpp.
  [[gnu::always_inline]] void note_inverse([[maybe_unused]] Scalar& largest_inverse) const
  {
    if constexpr (mends_several<Workspace> && n_frames == 1) {
      if constexpr (has_unit_column<S>()) {
        largest_inverse = std::max(largest_inverse, joint_.D_inv(0, 0));
      } else if (!ws_.free_axes().empty()) {  // by how the frame moves, whatever the coordinate's unit is
        for (int d = 0; d < n_i; ++d) {
          const TriplePair<Scalar> column = column_of<pattern>(state_.S_k[0], d);
          largest_inverse = std::max(largest_inverse, Scalar(joint_.D_inv(d, d) * dot(column, column)));
        }
      }
    }
  }

  /// W = M̄_R⁻¹ Uᵀ, (17), ψ = M̄_R⁻¹ h_q; for who looks at them: NodeState.
  [[gnu::always_inline]] void put_results()
  {
    if constexpr (!is_several<Scalar>) { state_.MbarR = joint_.D; }
    state_.MbarR_inv = joint_.D_inv;
    state_.psi = product(joint_.D_inv, joint_.h);
    if constexpr (!is_several<Scalar>) {  // which nothing needs: several states 1 to 3 % less
#pragma GCC unroll 8
      for (int d = 0; d < n_i; ++d) { U_[d].put(&state_.U(0, d)); }
    }
#pragma GCC unroll 8
    for (int d = 0; d < n_i; ++d) {
      if (!(small_make_W && mended_)) [[likely]] {
        W_[d] = U_[0] * joint_.D_inv(d, 0);
#pragma GCC unroll 8
        for (int e = 1; e < n_i; ++e) { W_[d] += U_[e] * joint_.D_inv(d, e); }
      }
      if constexpr (n_i == 1) {
        W_[0].put(state_.W.data());
      } else {
#pragma GCC unroll 8
        for (int j = 0; j < 6; ++j) { state_.W(d, j) = W_[d](j); }
      }
    }
  }

  /// A' = A − U W, (14), and h' = h_g − Wᵀ h_q, to the frame that takes what is handed on.
  [[gnu::always_inline]] void pass_on(Index receiver)
  {
    [[maybe_unused]] SpatialInertia<Scalar> reduced;
    if constexpr (small == Mended::pivot) {
      if (mended_) [[unlikely]] { reduce_mended(reduced); }
    }
    SpatialInertia<Scalar> A = passed_on(0, reduced);  // made: g++ copies through memory what is assigned to
    for (std::size_t k = 1; k < n_frames; ++k) { A += passed_on(k, reduced); }
    const bool all_passed_on = small == Mended::compound && mended_;  // with what is within
    if constexpr (n_rotors > 0) { hand_on_rotors<Workspace::update, S>(spun_, W_, all_passed_on, A, size_[0]); }
    if constexpr (scene.implicit && Workspace::update == Update::projected) {
      if (!all_passed_on) [[likely]] { hand_on_springs<S>(state_, W_, A); }
    }
    if constexpr (Workspace::update == Update::printed) { subtract_product(U_, W_, A); }
    if constexpr (small == Mended::compound) {
      if (mended_) [[unlikely]] { subtract_product(V_, V_, A); }
    }
    add_inlet_bodies<scene>(node_, state_, ws_, A, hg_);
#pragma GCC unroll 8
    for (int d = 0; d < n_i; ++d) { hg_ -= W_[d] * joint_.h(d); }
    if constexpr (turns_about_axis<S>()) {
      FreeLimb<Scalar>* const limb = ws_.free_limb(node_.index);
      if (limb != nullptr) [[unlikely]] {
        set_limb<scene>(node_, s_, state_, SpunRotors<S>(spun_), TriplePair<Scalar>(U_k_[0][0]),
                        Scalar(joint_.h_unloaded(0)), ws_, *limb);
      }
    }
    FrameState<Scalar>& inlet = ws_.frame(receiver);
    hand_on<scene>(A, hg_, state_.c, state_.r, inlet);
    for (const TriplePair<Scalar>& largest_of_frame : size_) { pass_size(largest_of_frame, state_.r, inlet); }
    if (losing_ || weak_) [[unlikely]] {
      pass_loss(&ws_.frame(node_.frame), state_, VectorI(joint_.scale_of_A), VectorI(joint_.loss), weak_, inlet);
    }
  }

private:
  static constexpr MotionPattern pattern = S::pattern;
  static constexpr int n_i = S::n_i;
  static constexpr int n_frames = S::n_frames;
  static constexpr int n_rotors = rotor_count<S>();
  static constexpr Mended small = mended_as<S, Workspace>();  ///< pivots
  static constexpr bool small_make_W = small == Mended::root || small == Mended::compound;
  static constexpr bool in_registers = !is_several<Scalar>;
  using VectorI = Eigen::Matrix<Scalar, n_i, 1>;
  using Columns = SixColumns<Scalar, n_i>;

  [[gnu::always_inline]] const SpatialInertia<Scalar>& A_of(std::size_t k) const
  {
    if constexpr (in_registers) {
      return carried_[k].A;
    } else {
      return ws_.frame(node_.frame + static_cast<Index>(k)).inertia().A;
    }
  }

  [[gnu::always_inline]] void sum_frame(int k)
  {
    const auto at = static_cast<std::size_t>(k);
    FrameState<Scalar>& f = ws_.frame(node_.frame + k);
    if constexpr (in_registers) {
      own_bodies<S, scene.velocity>(ws_.tree().frame_mass(node_.frame + k), f, carried_[at]);
    }
    if constexpr (has_own_twist<S>() && in_registers) {
      TriplePair<Scalar>& U_0 = U_k_[0][0];
      U_0 = own_column(state_, f);
      joint_.D(0, 0) = state_.own.D;
      if (f.arrived) {
        Columns U_arrived;
        inertia_times<pattern>(f.inertia().A, state_.S_k[0], U_arrived);
        add_joint_inertia<pattern>(state_.S_k[0], U_arrived, false, joint_.D);
        U_0 += U_arrived[0];
      }
      add_arrived(f, carried_[at]);
    } else {
      if constexpr (in_registers) { add_arrived(f, carried_[at]); }
      inertia_times<pattern>(A_of(at), state_.S_k[at], U_k_[at]);
      add_joint_inertia<pattern>(state_.S_k[at], U_k_[at], k == 0, joint_.D);
    }
    size_[at] = largest(f, A_of(at));
    add_scale<pattern>(size_[at], state_.S_k[at], joint_.scale);
    const TriplePair<Scalar> h =
        in_registers ? carried_[in_registers ? at : 0].h : TriplePair<Scalar>(f.inertia().h.data());
    const TriplePair<Scalar> p = bias_wrench<scene, S>(A_of(at), h, f);
#pragma GCC unroll 8
    for (int d = 0; d < n_i; ++d) { joint_.h(d) += column_dot<pattern>(state_.S_k[at], d, p); }
    if (k == 0) {
      hg_ = p;
    } else {
      hg_ += p;
    }
  }

  [[gnu::always_inline]] void mend_pivot()
  {
    const auto pivot = mended_pivot(node_, state_, joint_.D(0, 0), joint_.scale(0), joint_.h(0), scene.velocity,
                                    ws_.is_implicit(), ws_);
    mended_ = ScalarTraits<Scalar>::is_positive(pivot.D);
    if (!mended_) { return; }
    TriplePair<Scalar> all = U_k_[0][0] = pivot.U;
    Scalar moved = pivot.D;
    add_inertia_within<scene.implicit, S>(state_, SpunRotors<S>(spun_), all, moved);
    U_[0] = all;
    joint_.D(0, 0) = moved;
    joint_.h(0) += pivot.more_h;
    weak_ = false;
  }

  /// A' of a mended pivot.
  [[gnu::always_inline]] void reduce_mended(SpatialInertia<Scalar>& reduced)
  {
    const bool has_own = has_inertia_within<scene.implicit, S>(state_, SpunRotors<S>(spun_));
    SpatialInertia<Scalar> from;  // apart, so that A stays in registers where no pivot is mended
    copy(A_of(0), from);
    reduce(from, column_of<pattern>(state_.S_k[0], 0), TriplePair<Scalar>(U_k_[0][0]), TriplePair<Scalar>(W_[0]),
           has_own, reduced);
    if constexpr (in_registers) { copy(reduced, carried_[0].A); }
    if (!has_own) {  // A S = 0 from here on: `projected` leaves it as it is
      const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
      U_k_[0][0] = {zero, zero};
    }
  }

  /// What the parent sees of frame k, before the shift to its own point.
  [[gnu::always_inline]] SpatialInertia<Scalar> passed_on(std::size_t k, const SpatialInertia<Scalar>& reduced) const
  {
    const SpatialInertia<Scalar>& A_k = !in_registers && small == Mended::pivot && mended_ ? reduced : A_of(k);
    if constexpr (small_make_W) {
      return mended_ ? A_k : projected<pattern>(A_k, state_.S_k[k], U_k_[k], W_);
    } else if constexpr (Workspace::update == Update::projected) {
      return projected<pattern>(A_k, state_.S_k[k], U_k_[k], W_);
    } else {
      return A_k;
    }
  }

  const Node& node_;
  const S& s_;
  NodeState<S>& state_;
  Workspace& ws_;
  Diagnosis& diagnosis_;

  std::array<Carried<Scalar>, in_registers ? n_frames : 1> carried_;
  std::array<Columns, n_frames> U_k_;              ///< of what the frames carry
  std::array<TriplePair<Scalar>, n_frames> size_;  ///< of the inertia that pivots stand in (roundings.hpp)
  SpunRotors<S> spun_;  ///< as copies to functions that are not inlined: for them all here would lie in memory
  Columns U_, W_;
  Columns V_;  ///< of a compound that is mended
  TriplePair<Scalar> hg_;
  JointEquation<S>& joint_;
  bool weak_ = false, losing_ = false, mended_ = false;
};

template <Scene scene, class S, class Workspace>
[[gnu::always_inline]] inline void matrix_inward(const Node& node, Index receiver, const S& s, NodeState<S>& state,
                                                 Workspace& ws, Diagnosis& diagnosis,
                                                 typename S::Scalar& largest_inverse)
{
  JointEquation<S> joint;  // apart: with members whose address is taken, g++ keeps the whole of a step in memory
  JointStep<scene, S, Workspace> step(node, s, state, ws, diagnosis, joint);
  step.sum_frames();
  step.add_within();
  step.invert();
  step.note_inverse(largest_inverse);
  step.put_results();
  if (node.inlet >= 0) { step.pass_on(receiver); }
}

}  // namespace iim::detail
