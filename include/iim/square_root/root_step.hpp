// The step inward of a subsystem with internal velocities in square-root form (square_root.hpp), part by part.
#pragma once

#include <iim/numerics/registers.hpp>
#include <iim/pass/internal_inertia.hpp>
#include <iim/pass/kinematics.hpp>
#include <iim/scalar.hpp>
#include <iim/spatial.hpp>
#include <iim/square_root/inlet_root.hpp>
#include <iim/square_root/root_rows.hpp>
#include <iim/square_root/square_root.hpp>
#include <iim/subsystem.hpp>
#include <iim/workspace.hpp>

#include <array>
#include <cmath>
#include <cstddef>
#include <type_traits>

namespace iim::detail {

/// What the step works on, which is not in registers: [N | z | v] of all that moves with q_i, and T q̈_i = z₁ − N₁ y.
template <Scene scene, class S, class Workspace>
struct RootEquation {
  using Scalar = typename S::Scalar;
  static constexpr int n_i = S::n_i;
  static constexpr bool keeps_v = one_column<S, Workspace>;
  static constexpr int n_within = rotor_count<S>() + (scene.implicit ? spring_count<S>() : 0);
  static_assert(n_within <= RootInertia<Scalar>::most_within);
  static constexpr int room = RootInertia<Scalar>::Rows::most * S::n_frames + (keeps_v ? 0 : n_within);
  static constexpr std::size_t padded = Reflection<Scalar, 7 + n_i>::padded;
  using VectorI = Eigen::Matrix<Scalar, n_i, 1>;

  /// Of all frames, rotors and springs, with v beside them, if it has several columns.
  std::conditional_t<keeps_v, RootRows<Scalar, 1>, RootRows<Scalar, room, 7 + n_i>> rows;
  LeftWithin<Scalar, keeps_v ? n_within : 0> left;  ///< rows of rotors and springs, if they are not among these
  VectorI h;                                        ///< h_q
  VectorI scale;                                    ///< Σ |v| as if nothing had cancelled
  VectorI reduced_from = VectorI::Zero();
  std::array<std::array<Scalar, padded>, static_cast<std::size_t>(n_i)> top;  ///< [N₁ | z₁ | T]
  Reflection<Scalar, 8> reflection;                                           ///< of one column whose rows keep v
};

/// Parts of the step, to be called in the order in which they stand here: rows of all frames, rotors and springs;
/// eliminated; stacked on the parent. They are inlined, and what they share stays in registers.
template <Scene scene, class S, class Workspace>
class RootStep {
public:
  using Scalar = typename S::Scalar;

  [[gnu::always_inline]] RootStep(const Node& node, const S& s, NodeState<S>& state, Workspace& ws,
                                  Diagnosis& diagnosis, RootEquation<scene, S, Workspace>& joint)
      : node_(node), s_(s), state_(state), ws_(ws), diagnosis_(diagnosis), tape_(ws.tape(node.index)), joint_(joint),
        rows_(rows_of(node, ws, joint)), own_load_(ws.load()(node.v))
  {
  }

  /// [N | z | v] and h over the frames, and applied forces.
  [[gnu::always_inline]] void sum_frames()
  {
#pragma GCC unroll 8
    for (int d = 0; d < n_i; ++d) {
      joint_.h(d) = -ws_.load()(node_.v + d);
      joint_.scale(d) = Scalar(0);
    }
    for (int k = 0; k < S::n_frames; ++k) {
      if constexpr (!keeps_v) { copy_rows(k); }
      const TriplePair<Scalar> h(ws_.frame(node_.frame + k).inertia().h.data());
#pragma GCC unroll 8
      for (int d = 0; d < n_i; ++d) {
        joint_.h(d) += column_dot<pattern>(state_.S_k[static_cast<std::size_t>(k)], d, h);
      }
      if (k == 0) {
        hg_ = h;
      } else {
        hg_ += h;
      }
    }
    if constexpr (keeps_v) {
      const RootInertia<Scalar>& N_0 = ws_.root(node_.frame);
      joint_.scale(0) = N_0.scale;
      joint_.h(0) += N_0.h_along;
      along_h_ = column_dot<pattern>(state_.S_k[0], 0, hg_) + N_0.h_along;
      hg_ += TriplePair<Scalar>(N_0.h.data());
    }
  }

  /// Bodies alone first: what they keep then has A'S = 0 up to roundings of its own, and no share of a small rotor in
  /// it.
  [[gnu::always_inline]] void eliminate_bodies()
  {
    if constexpr (keeps_v) {
      moves_ = find_reflection<false>(rows_, along_S, joint_.reflection, tape_, rows_.count);
      if (moves_) {
        const auto& x = joint_.reflection.top;  // by numbers: g++ loads what it has just stored otherwise (3 % more)
        above_ = {{{x[0], x[1], x[2]}, {x[3], x[4], x[5]}}, x[rhs], x[along_S]};
      }
      if (tape_ != nullptr) [[unlikely]] { tape_->tops = rows_.count; }
      body_v_ = above_.v;
    }
  }

  /// Rows of rotors, and of the springs of an implicit step.
  [[gnu::always_inline]] void add_within()
  {
    if constexpr (rotor_count<S>() > 0) {
      for (const auto& rotor : s_.rotors()) { add_rotor(rotor); }
    }
    if constexpr (scene.implicit) {
      for (const auto& spring : state_.springs) {
        const Scalar root = root_of(spring.inertia);
        const Scalar z = root > Scalar(0) ? -spring.force / root : Scalar(0);
        const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
        put_within({zero, zero}, z, root * spring.ratio.transpose(), root * spring.ratio(0), Scalar(0));
      }
    }
  }

  /// T, and C = T⁻¹; NaN where it is singular.
  [[gnu::always_inline]] void eliminate_all()
  {
    Eigen::Matrix<Scalar, n_i, n_i>& C = state_.MbarR_inv_root;
    bool regular;
    if constexpr (keeps_v) {
      regular = eliminate_within();
    } else {
      if (tape_ != nullptr) [[unlikely]] { tape_->tops = rows_.count; }
      regular = eliminate<n_i>(rows_, joint_.scale, joint_.reduced_from, joint_.top, C, tape_);
    }
    if (!regular) {
      diagnosis_.fail(Status::not_positive_definite, node_.index);
      C.setConstant(not_a_number<Scalar>());
      rows_.count = 0;  // no row is left
      joint_.left.count = 0;
      moves_ = false;
    }
  }

  /// D = TᵀT, D⁻¹ = C Cᵀ, U = N₁ᵀT, W = C N₁, ψ = D⁻¹ h_q − C z₁: NodeState. h_g − Wᵀ h_q is left of the wrench.
  [[gnu::always_inline]] void put_results()
  {
    const Eigen::Matrix<Scalar, n_i, n_i>& C = state_.MbarR_inv_root;
#pragma GCC unroll 8
    for (int d = 0; d < n_i; ++d) {
#pragma GCC unroll 8
      for (int e = 0; e <= d; ++e) {
        Scalar D = t(0, d) * t(0, e), D_inv = C(d, 0) * C(e, 0);
#pragma GCC unroll 8
        for (int k = 1; k < n_i; ++k) {
          D += t(k, d) * t(k, e);
          D_inv += C(d, k) * C(e, k);
        }
        state_.MbarR(d, e) = state_.MbarR(e, d) = D;
        state_.MbarR_inv(d, e) = state_.MbarR_inv(e, d) = D_inv;
      }
      TriplePair<Scalar> U = top_row(0) * t(0, d), W = top_row(0) * C(d, 0);
#pragma GCC unroll 8
      for (int k = 1; k < n_i; ++k) {
        U += top_row(k) * t(k, d);
        W += top_row(k) * C(d, k);
      }
      U.put(state_.U.data() + 6 * d);
      if constexpr (n_i == 1) {
        W.put(state_.W.data());
      } else {
#pragma GCC unroll 8
        for (int j = 0; j < 6; ++j) { state_.W(d, j) = W(j); }
      }
      hg_ -= W * joint_.h(d);
    }
    state_.psi = product(state_.MbarR_inv, joint_.h);
#pragma GCC unroll 8
    for (int d = 0; d < n_i; ++d) {
#pragma GCC unroll 8
      for (int k = 0; k < n_i; ++k) { state_.psi(d) -= C(d, k) * z(k); }
    }
  }

  /// The rows that are left, and the wrench, to the inlet.
  [[gnu::always_inline]] void pass_on()
  {
    share_axis<S>(node_, state_, slip_, ws_, undone_);
    put_wrench<S>(node_, state_, hg_, own_load_, ws_);
    if constexpr (keeps_v && has_known) {
      joint_.left.known = TriplePair<Scalar>::settled(ws_.frame(node_.frame).bias.data());
    }
    // Whether A'S = 0 for what the bodies keep: of one frame, with nothing within but in rows of its own.
    const bool freed = keeps_v ? moves_ : S::n_frames == 1 && n_put_ == 0;
    const RootInertia<Scalar>& inlet = ws_.root(node_.inlet);
    Eigen::Index count = rows_.count, hole = keeps_v && moves_ ? joint_.reflection.pivot : -1, from = 0;
    const Eigen::Index within_from = count + n_i;
    constexpr std::size_t columns = keeps_v ? 8 : 7;
    RootRows<Scalar, 6> compressed;
    bool is_compressed = false;
    const auto rest = [&](Eigen::Index r) __attribute__((always_inline)) {
      if (is_compressed) [[unlikely]] { return columns_at<columns>(compressed, r); }
      if constexpr (keeps_v) {
        if (moves_) [[likely]] { return reflected(rows_, joint_.reflection, r); }
      }
      return columns_at<columns>(rows_, r);
    };
    const bool light = heaviest<S>(node_, ws_) > Scalar(inlet.outweighed) * ws_.frame_body(node_.inlet).root_mass;
    if (light || ws_.rows(node_.inlet).end() + count > (inlet.is_free ? inlet.loose_on_free : inlet.loose)) {
      from = within_from + n_put_;
      count = compress_left<RootEquation<scene, S, Workspace>::room>(rest, count, hole, freed ? 6 - n_i : 6, compressed,
                                                                     tape_, from);
      hole = -1;
      is_compressed = true;
    }
    stack_on_inlet<scene>(node_, state_, rest, count, hole, true, ws_, joint_.left, tape_, from, within_from);
  }

private:
  static constexpr MotionPattern pattern = S::pattern;
  static constexpr int n_i = S::n_i;
  static constexpr bool keeps_v = one_column<S, Workspace>;
  static constexpr bool has_known = has_bias<scene, S>(0) || has_bias<scene, S>(3);
  using VectorI = Eigen::Matrix<Scalar, n_i, 1>;

  [[gnu::always_inline]] static Scalar root_of(const Scalar& x)
  {
    using std::sqrt;
    return sqrt(x);
  }

  [[gnu::always_inline]] static auto& rows_of(const Node& node, Workspace& ws, RootEquation<scene, S, Workspace>& joint)
  {
    if constexpr (keeps_v) {
      return ws.rows(node.frame);
    } else {
      return joint.rows;
    }
  }

  /// Rows of frame k, with v of each beside them and all that is known subtracted from z.
  [[gnu::always_inline]] void copy_rows(int k)
  {
    using std::abs;
    const auto& S_k = state_.S_k[static_cast<std::size_t>(k)];
    const FrameState<Scalar>& f = ws_.frame(node_.frame + k);
    const auto& rows_k = ws_.rows(node_.frame + k);
    const Eigen::Index begin = joint_.rows.end();
    if constexpr (S::n_frames > 1) {
      if (tape_ != nullptr) [[unlikely]] { ws_.frame_tape(node_.frame + k)->move(0, begin, rows_k.count); }
    }
    for (Eigen::Index r = 0; r < rows_k.count; r += rows_k.lanes) {
      auto n = columns_at<7>(rows_k, r);
      for (int d = 0; d < n_i; ++d) {
        auto along = no_rows<Scalar>(), size = along;
#pragma GCC unroll 8
        for (int i = pattern.linear ? 0 : 3; i < (pattern.angular ? 6 : 3); ++i) {
          const auto part = n[static_cast<std::size_t>(i)] * S_k(i, d);
          along += part;
          size += without_signs<Scalar>(part);
        }
        put_rows<Scalar>(along, joint_.rows.at(7 + d, begin + r));
        joint_.scale(d) += sum_of_rows<Scalar>(size);
      }
      if constexpr (has_known) {
#pragma GCC unroll 8
        for (int i = 0; i < 6; ++i) { n[rhs] -= n[static_cast<std::size_t>(i)] * f.bias(i); }
      }
      for (int c = 0; c < 7; ++c) { put_rows<Scalar>(n[static_cast<std::size_t>(c)], joint_.rows.at(c, begin + r)); }
    }
    joint_.rows.count = begin + rows_k.count;
    const RootInertia<Scalar>& N_k = ws_.root(node_.frame + k);
    for (int d = 0; d < n_i && N_k.is_reduced; ++d) {
      for (int i = 0; i < 6; ++i) { joint_.reduced_from(d) += N_k.reduced_from(i) * abs(S_k(i, d)); }
    }
  }

  template <class RotorType>
  [[gnu::always_inline]] void add_rotor(const RotorType& rotor)
  {
    SpunRotor<S> spun = spin_rotor<scene, S>(node_, rotor, state_, ws_);
    if (spun.J > Scalar(0)) {
      const Scalar root = root_of(spun.J);
      Scalar known = spun.bias;
      if constexpr (keeps_v && has_known) {  // what is subtracted from all rows below, the inlet's rotors do not have
        known -= dot(spun.a, Triple<Scalar>::settled(ws_.frame(node_.frame).bias.data() + 3));
      }
      Scalar against_S = rotor.ratio(0), with_S(0);
      if constexpr (keeps_v) {
        with_S = dot(spun.a, Triple<Scalar>::settled(state_.S_k[0].data() + 3));
        if (rotor.frame < 0) { against_S -= with_S; }
      }
      const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
      put_within({zero, spun.a * root}, -root * known, root * spun.e, root * against_S, root * with_S);
    }
    if constexpr (scene.velocity) {
      const BodyRoot<Scalar>& carrier = ws_.inlet_body(node_.index);
      if (rotor.frame < 0 && node_.inlet >= 0 && carrier.rows > 3) {
        Vector3<Scalar> moment(spun.moment(0), spun.moment(1), spun.moment(2));
        joint_.left.turning += triple(moment_of_rows(carrier, ws_.inlet_axes(node_, state_), moment));
        spun.moment = triple(moment);
      }
      add_gyroscopic(spun, rotor, state_, hg_, joint_.h);
      if constexpr (keeps_v) {
        if (rotor.frame < 0) { own_moment_ += dot(spun.moment, Triple<Scalar>::settled(state_.S_k[0].data() + 3)); }
      }
    }
  }

  /// The row of a rotor or spring.
  [[gnu::always_inline]] void put_within(const TriplePair<Scalar>& n, const Scalar& z, const VectorI& ratio,
                                         const Scalar& against_S, const Scalar& with_S)
  {
    using std::abs;
    slip_ += ratio(0) * against_S;
    within_S_ += ratio(0) * with_S;
#pragma GCC unroll 8
    for (int d = 0; d < n_i; ++d) { joint_.scale(d) += abs(ratio(d)); }
    if constexpr (keeps_v) {  // part by part: a copy of the whole waits for its parts (pass of the biped 3 % more)
      SingleRow<Scalar>& row = joint_.left.row[static_cast<std::size_t>(joint_.left.count++)];
      row.n.linear = n.linear;
      row.n.angular = n.angular;
      row.z = z;
      row.v = ratio(0);
    } else {
      const Eigen::Index at = joint_.rows.count;
      joint_.rows.open(1);
      joint_.rows.put_row(at, SingleRow<Scalar>{n, z, ratio(0)});
      for (int d = 1; d < n_i; ++d) { *joint_.rows.at(7 + d, at) = ratio(d); }
    }
    ++n_put_;
  }

  /// Of one column, after its bodies: whether T is regular.
  [[gnu::always_inline]] bool eliminate_within()
  {
    using std::abs;
    if (tape_ != nullptr) [[unlikely]] { sum_within(*tape_); }
    for (int k = 0; k < joint_.left.count; ++k) {
      rotate_along(above_, joint_.left.row[static_cast<std::size_t>(k)], tape_, rows_.count, rows_.count + 1 + k);
    }
    Scalar& C = state_.MbarR_inv_root(0, 0);
    C = Scalar(1) / above_.v;
    if (n_put_ > 0) {
      if (tape_ != nullptr) [[unlikely]] {
        tape_->of_bodies = (body_v_ * C) * (body_v_ * C);
        tape_->of_rotors *= C * C;
      }
      undone_ = (body_v_ * C) * (body_v_ * C) + (within_S_ * C) * C;
      slip_ = (slip_ * C) * C;
      own_load_ = undone_ * own_load_ + slip_ * along_h_;
    }
    own_load_ += own_moment_;
    const Scalar negligible = Scalar(64) * Eigen::NumTraits<Scalar>::epsilon() * joint_.scale(0);
    const bool regular = ScalarTraits<Scalar>::is_positive(abs(above_.v) - negligible);
    const RootInertia<Scalar>& N_0 = ws_.root(node_.frame);
    if (N_0.is_reduced) [[unlikely]] {
      return regular && stands_out(above_.v, dot_of_sizes(TriplePair<Scalar>(N_0.reduced_from.data()),
                                                          TriplePair<Scalar>(state_.S_k[0].data())));
    }
    return regular;
  }

  /// Σ J e a over the rotors. Of no rotors, and no springs if the step is not implicit, the bodies take all.
  [[gnu::always_inline]] void sum_within(RowTape<Scalar>& tape) const
  {
    tape.of_bodies = Scalar(1);
    tape.of_rotors.setZero();
    for (int k = 0; k < joint_.left.count; ++k) {
      const SingleRow<Scalar>& row = joint_.left.row[static_cast<std::size_t>(k)];
      for (int i = 0; i < 3; ++i) { tape.of_rotors(i) += row.n.angular(i) * row.v; }
    }
  }

  [[gnu::always_inline]] const Scalar& t([[maybe_unused]] int k, [[maybe_unused]] int d) const
  {
    if constexpr (keeps_v) {
      return above_.v;
    } else {
      return joint_.top[static_cast<std::size_t>(k)][static_cast<std::size_t>(7 + d)];
    }
  }
  /// Row k of N₁.
  [[gnu::always_inline]] TriplePair<Scalar> top_row([[maybe_unused]] int k) const
  {
    if constexpr (keeps_v) {
      return above_.n;
    } else {
      return TriplePair<Scalar>(joint_.top[static_cast<std::size_t>(k)].data());
    }
  }
  /// z₁.
  [[gnu::always_inline]] Scalar z([[maybe_unused]] int k) const
  {
    if constexpr (!keeps_v) {
      return joint_.top[static_cast<std::size_t>(k)][rhs];
    } else if constexpr (has_known) {
      return above_.z - dot(above_.n, TriplePair<Scalar>::settled(ws_.frame(node_.frame).bias.data()));
    } else {
      return above_.z;
    }
  }

  const Node& node_;
  const S& s_;
  NodeState<S>& state_;
  Workspace& ws_;
  Diagnosis& diagnosis_;
  RowTape<Scalar>* const tape_;

  RootEquation<scene, S, Workspace>& joint_;
  std::conditional_t<keeps_v, typename RootInertia<Scalar>::Rows, decltype(RootEquation<scene, S, Workspace>::rows)>&
      rows_;
  TriplePair<Scalar> hg_;
  int n_put_ = 0;  ///< rows of rotors and springs

  // Of one column whose rows keep v:
  SingleRow<Scalar> above_ = SingleRow<Scalar>::zero();  ///< [N₁ | z₁ | T]
  Scalar body_v_{0};                                     ///< T of the bodies alone
  Scalar slip_{0};        ///< 1 − W S; times T² at first, Σ v (v − n S) over what lies within
  Scalar undone_{1};      ///< W S
  Scalar within_S_{0};    ///< Σ v n S over what lies within
  Scalar along_h_{0};     ///< S h
  Scalar own_load_;       ///< S h' on the inlet
  Scalar own_moment_{0};  ///< of it the rotors', which a large load would take the digits of
  bool moves_ = false;    ///< T of the bodies is not 0
};

template <Scene scene, class S, class Workspace>
[[gnu::always_inline]] inline void root_inward(const Node& node, const S& s, NodeState<S>& state, Workspace& ws,
                                               Diagnosis& diagnosis)
{
  RootEquation<scene, S, Workspace> joint;  // apart, as of JointStep
  RootStep<scene, S, Workspace> step(node, s, state, ws, diagnosis, joint);
  step.sum_frames();
  step.eliminate_bodies();
  step.add_within();
  step.eliminate_all();
  step.put_results();
  if (node.inlet >= 0) { step.pass_on(); }
}

}  // namespace iim::detail
