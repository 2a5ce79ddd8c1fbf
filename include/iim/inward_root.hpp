// The inward loop of the O(n) pass for one subsystem in square-root form: square_root.hpp.
#pragma once

#include <iim/free_root.hpp>
#include <iim/inlet_root.hpp>
#include <iim/internal_inertia.hpp>
#include <iim/kinematics.hpp>
#include <iim/registers.hpp>
#include <iim/root_rows.hpp>
#include <iim/spatial.hpp>
#include <iim/square_root.hpp>
#include <iim/subsystem.hpp>
#include <iim/workspace.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>

namespace iim::detail {

/// Rows of all frames, rotors and springs; eliminated; stacked on the parent.
template <Scene scene, class S, class Workspace>
void joint_inward(const Node& node, const S& s, NodeState<S>& state, Workspace& ws, Diagnosis& diagnosis)
{
  using std::abs;
  using std::sqrt;
  using Scalar = typename S::Scalar;
  constexpr MotionPattern pattern = S::pattern;
  constexpr int n_i = S::n_i;
  constexpr bool keeps_v = one_column<S, Workspace>;
  constexpr int n_within = rotor_count<S>() + (scene.implicit ? spring_count<S>() : 0);
  static_assert(n_within <= RootInertia<Scalar>::most_within);
  constexpr int room = RootInertia<Scalar>::most * S::n_frames + n_within;
  constexpr int most = room + abreast;
  using VectorI = Eigen::Matrix<Scalar, n_i, 1>;

  // [N | z | v] over the frames, copied with v beside it if it has several columns; and applied forces.
  constexpr bool has_known = has_bias<scene, S>(0) || has_bias<scene, S>(3);
  std::array<RootRow<Scalar>, keeps_v ? 1 : most> own_rows;
  [[maybe_unused]] std::array<VectorI, keeps_v ? 1 : most> v;
  RootRow<Scalar>* const rows = keeps_v ? ws.root(node.frame).row.data() : own_rows.data();
  int count = 0;
  RowTape<Scalar>* const tape = ws.tape(node.index);
  Vector6<Scalar> hg;
  VectorI hq, scale;
  [[maybe_unused]] Scalar along_h(0);  // S h
#pragma GCC unroll 8
  for (int d = 0; d < n_i; ++d) {
    hq(d) = -ws.load()(node.v + d);
    scale(d) = Scalar(0);
  }
  for (int k = 0; k < S::n_frames; ++k) {
    const auto& S_k = state.S_k[static_cast<std::size_t>(k)];
    const FrameState<Scalar>& f = ws.frame(node.frame + k);
    const RootInertia<Scalar>& N_k = ws.root(node.frame + k);
    if constexpr (keeps_v) { count = N_k.rows; }
    if constexpr (S::n_frames > 1) {
      if (tape != nullptr) [[unlikely]] { ws.frame_tape(node.frame + k)->move(0, count, N_k.rows); }
    }
    for (int r = 0; r < N_k.rows && !keeps_v; ++r, ++count) {
      RootRow<Scalar>& n = rows[count];
      n = N_k.row[static_cast<std::size_t>(r)];
      for (int d = 0; d < n_i; ++d) {
        v[static_cast<std::size_t>(count)](d) = column_dot<pattern>(S_k, d, n(0), n(1), n(2), n(3), n(4), n(5));
        for (int i = pattern.linear ? 0 : 3; i < (pattern.angular ? 6 : 3); ++i) { scale(d) += abs(S_k(i, d) * n(i)); }
      }
      if constexpr (has_known) { n(rhs) = without_known(n, f.bias); }
    }
#pragma GCC unroll 8
    for (int d = 0; d < n_i; ++d) { hq(d) += column_dot<pattern>(S_k, d, f.h); }
    if (k == 0) {
      hg = f.h;
    } else {
      add(hg, f.h);
    }
  }
  if constexpr (keeps_v) {
    const RootInertia<Scalar>& N_0 = ws.root(node.frame);
    scale(0) = N_0.scale;
    hq(0) += N_0.h_along;
    along_h = column_dot<pattern>(state.S_k[0], 0, ws.frame(node.frame).h) + N_0.h_along;
    add(hg, N_0.h);
  }
  // Bodies alone first: what they keep then has A'S = 0 up to roundings of its own, and no share of a small rotor in it.
  if constexpr (keeps_v) {
    if (count == 0) { rows[count++].setZero(); }
    eliminate_along(rows, count, tape);
  }
  const int bodies = count;
  [[maybe_unused]] const Scalar body_v = keeps_v ? Scalar(rows[0](along_S)) : Scalar(0);
  [[maybe_unused]] int n_put = 0;
  Vector3<Scalar> turning(Scalar(0), Scalar(0), Scalar(0));
  Scalar slip(0);                      // 1 − W S; times T² at first, Σ v (v − n S) over what lies within
  Scalar undone(1);                    // W S
  Scalar within_S(0);                  // Σ v n S over what lies within
  Scalar own_load = ws.load()(node.v);     // S h' on the inlet
  [[maybe_unused]] Scalar own_moment(0);  // of it the rotors', which a large load would take the digits of
  [[maybe_unused]] const auto put_within = [&](const VectorI& ratio, const Scalar& against_S, const Scalar& with_S) {
    slip += ratio(0) * against_S;
    within_S += ratio(0) * with_S;
#pragma GCC unroll 8
    for (int d = 0; d < n_i; ++d) { scale(d) += abs(ratio(d)); }
    if constexpr (keeps_v) {
      rows[count](along_S) = ratio(0);
    } else {
      v[static_cast<std::size_t>(count)] = ratio;
    }
    ++count;
    ++n_put;
  };
  if constexpr (rotor_count<S>() > 0) {
    for (const auto& rotor : s.rotors()) {
      SpunRotor<S> spun = spin_rotor<scene, S>(node, rotor, state, ws);
      if (spun.J > Scalar(0)) {
        const Scalar root = sqrt(spun.J);
        const Scalar zero(0);
        Scalar known = spun.bias;
        if constexpr (keeps_v && has_known) {  // what is subtracted from all rows below, the inlet's rotors do not have
#pragma GCC unroll 8
          for (int j = 0; j < 3; ++j) { known -= spun.a(j) * ws.frame(node.frame).bias(j + 3); }
        }
        rows[count] << zero, zero, zero, root * spun.a(0), root * spun.a(1), root * spun.a(2), -root * known, zero;
        Scalar against_S = rotor.ratio(0), with_S(0);
        if constexpr (keeps_v) {
          for (int j = 0; j < 3; ++j) { with_S += spun.a(j) * state.S_k[0](j + 3); }
          if (rotor.frame < 0) { against_S -= with_S; }
        }
        put_within(root * spun.e, root * against_S, root * with_S);
      }
      if constexpr (scene.velocity) {
        const BodyRoot<Scalar>& carrier = ws.inlet_body(node.index);
        if (rotor.frame < 0 && node.inlet >= 0 && carrier.rows > 3) {
          Vector3<Scalar> moment(spun.moment(0), spun.moment(1), spun.moment(2));
          turning += moment_of_rows(carrier, state.R, moment);
          spun.moment = triple(moment);
        }
        add_gyroscopic(spun, rotor, state, hg, hq);
        for (int j = 0; j < 3 && keeps_v && rotor.frame < 0; ++j) { own_moment += spun.moment(j) * state.S_k[0](j + 3); }
      }
    }
  }
  if constexpr (scene.implicit) {
    for (const auto& spring : state.springs) {
      rows[count].setZero();
      const Scalar root = sqrt(spring.inertia);
      if (root > Scalar(0)) { rows[count](rhs) = -spring.force / root; }
      put_within(root * spring.ratio.transpose(), root * spring.ratio(0), Scalar(0));
    }
  }

  // One frame and nothing within: A'S = 0.
  const bool annihilated = S::n_frames == 1 && n_put == 0;
  Eigen::Matrix<Scalar, n_i, n_i>& C = state.MbarR_inv_root;
  bool regular;
  if constexpr (keeps_v) {
    if constexpr (n_within == 1) {
      if (n_put > 0) { rotate_along(rows, bodies, tape); }
    } else if constexpr (n_within > 1) {
      std::array<RootRow<Scalar>, 1 + n_within + abreast> few;
      n_put = std::min(n_put, n_within);  // as it is, for compilers to see
      few[0] = rows[0];
      std::copy(rows + bodies, rows + bodies + n_put, few.begin() + 1);
      if (tape != nullptr) [[unlikely]] { tape->rows_at(0, bodies); }
      if (n_put > 0) { eliminate_along(few.data(), 1 + n_put, tape); }
      rows[0] = few[0];
      std::copy(few.begin() + 1, few.begin() + 1 + n_put, rows + bodies);
    }
    v[0](0) = rows[0](along_S);
    C(0, 0) = Scalar(1) / v[0](0);
    if (n_put > 0) {
      undone = (body_v * C(0, 0)) * (body_v * C(0, 0)) + (within_S * C(0, 0)) * C(0, 0);
      slip = (slip * C(0, 0)) * C(0, 0);
      own_load = undone * own_load + slip * along_h;
    }
    own_load += own_moment;
    const Scalar negligible = Scalar(64) * Eigen::NumTraits<Scalar>::epsilon() * scale(0);
    regular = ScalarTraits<Scalar>::is_positive(abs(v[0](0)) - negligible);
  } else {
    regular = eliminate<n_i, Scalar, most>(v, own_rows, count, scale, C, tape);
  }
  if (!regular) {
    diagnosis.fail(Status::not_positive_definite, node.index);
    C.setConstant(std::numeric_limits<Scalar>::quiet_NaN());
    count = n_i;  // no row is left
  }
  const auto t = [&](int k, int d) -> const Scalar& { return v[static_cast<std::size_t>(k)](d); };
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
      state.MbarR(d, e) = state.MbarR(e, d) = D;
      state.MbarR_inv(d, e) = state.MbarR_inv(e, d) = D_inv;
    }
    RootRow<Scalar> U = rows[0] * t(0, d), W = rows[0] * C(d, 0);
#pragma GCC unroll 8
    for (int k = 1; k < n_i; ++k) {
      U += rows[k] * t(k, d);
      W += rows[k] * C(d, k);
    }
#pragma GCC unroll 8
    for (int j = 0; j < 6; ++j) {
      state.U(j, d) = U(j);
      state.W(d, j) = W(j);
    }
  }
  // Not put into the row: a row is slow to load after one of its numbers was stored.
  const auto z = [&](int k) __attribute__((always_inline)) {
    if constexpr (keeps_v && has_known) { return without_known(rows[k], ws.frame(node.frame).bias); }
    return rows[k](rhs);
  };
  state.psi = product(state.MbarR_inv, hq);
#pragma GCC unroll 8
  for (int d = 0; d < n_i; ++d) {
#pragma GCC unroll 8
    for (int k = 0; k < n_i; ++k) { state.psi(d) -= C(d, k) * z(k); }
  }
  if (node.inlet < 0) { return; }
#pragma GCC unroll 8
  for (int j = 0; j < 6; ++j) {
#pragma GCC unroll 8
    for (int d = 0; d < n_i; ++d) { hg(j) -= state.W(d, j) * hq(d); }
  }
  share_axis<S>(node, state, slip, ws, undone);
  put_wrench<S>(node, state, hg, own_load, ws);
  const RootRow<Scalar>* left = rows + n_i;
  int left_rows = count - n_i;
  std::array<RootRow<Scalar>, 6 + n_within> compressed;
  const RootInertia<Scalar>& inlet = ws.root(node.inlet);
  const bool light = heaviest<S>(node, ws) > Scalar(inlet.outweighed) * ws.frame_body(node.inlet).root_mass;
  if (light || inlet.rows + left_rows > inlet.loose) {
    std::array<int, 6> pivot;
    const int apart = keeps_v ? std::min(n_put, left_rows) : 0;  // rotors and springs stay as they are
    const int rank = keeps_v || annihilated ? 6 - n_i : 6;
    const int others = left_rows - apart;
    if (tape != nullptr) [[unlikely]] { tape->rows_at(n_i, n_i + 1); }
    left_rows = in_one_function<Scalar>([&] { return compress<6, room>(left, others, compressed.data(), pivot, rank, tape); });
    if constexpr (n_within > 0) { std::copy(rows + count - apart, rows + count, compressed.begin() + left_rows); }
    if (tape != nullptr) [[unlikely]] { tape->move(count - apart, n_i + left_rows, apart); }
    left_rows += apart;
    left = compressed.data();
  }
  const Vector6<Scalar> known = keeps_v && has_known ? ws.frame(node.frame).bias : Vector6<Scalar>(Vector6<Scalar>::Zero());
  in_one_function<Scalar>([&] {
    stack_on_inlet<scene>(node, state, left, left_rows, true, ws, tape, n_i, keeps_v ? std::min(n_put, left_rows) : 0, known,
                          turning);
  });
}

template <Scene scene, class S, class Workspace>
void square_root_inward(const Node& node, const S& s, NodeState<S>& state, Workspace& ws, Diagnosis& diagnosis)
{
  if constexpr (is_free<S>()) {
    free_root_inward<scene, S>(node, state, ws, diagnosis);
    if (node.inlet >= 0) { share_axis<S>(node, state, typename S::Scalar(0), ws); }
  } else {
    using std::abs;
    using std::max;
    using Scalar = typename S::Scalar;
    const bool bare = node.inlet >= 0 && ws.frame_body(node.inlet).rows == 0 && ws.root(node.inlet).keeps_v;
    RootRow<Scalar> size;
    if (bare) [[unlikely]] { size = size_of_rows(node, S::n_frames, ws); }
    // This, stack_on_inlet and compress each: the pass of the biped takes 6.2 µs instead of 10.0 where registers hold two
    // numbers, 3.55 instead of 3.7 where they hold four.
    in_one_function<Scalar>([&] { joint_inward<scene>(node, s, state, ws, diagnosis); });
    if (bare) [[unlikely]] {
      Scalar weakness(1);
      if constexpr (one_column<S, Workspace>) {
        weakness = max(weakness, Scalar(ws.root(node.frame).scale * abs(state.MbarR_inv_root(0, 0))));
      }
      add_scale_of_rows(node, size, weakness, ws);
    }
    if constexpr (one_column<S, Workspace>) {
      if (node.inlet >= 0 && coincide(node, state, ws)) [[unlikely]] { add_scale_of_roundings<S>(node, state, ws); }
    }
  }
}

}  // namespace iim::detail
