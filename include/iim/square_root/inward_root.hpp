// The inward loop of the O(n) pass for one subsystem in square-root form: square_root.hpp.
#pragma once

#include <iim/numerics/registers.hpp>
#include <iim/pass/internal_inertia.hpp>
#include <iim/pass/kinematics.hpp>
#include <iim/scalar.hpp>
#include <iim/spatial.hpp>
#include <iim/square_root/free_root.hpp>
#include <iim/square_root/inlet_root.hpp>
#include <iim/square_root/root_rows.hpp>
#include <iim/square_root/square_root.hpp>
#include <iim/subsystem.hpp>
#include <iim/workspace.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <type_traits>

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
  constexpr int room = RootInertia<Scalar>::Rows::most * S::n_frames + (keeps_v ? 0 : n_within);
  constexpr std::size_t padded = Reflection<Scalar, 7 + n_i>::padded;
  using VectorI = Eigen::Matrix<Scalar, n_i, 1>;

  // [N | z | v] over the frames, copied with v beside it if it has several columns; and applied forces.
  constexpr bool has_known = has_bias<scene, S>(0) || has_bias<scene, S>(3);
  std::conditional_t<keeps_v, RootRows<Scalar, 1>, RootRows<Scalar, room, 7 + n_i>> own_rows;
  auto& rows = [&]() -> auto& {
    if constexpr (keeps_v) {
      return ws.rows(node.frame);
    } else {
      return own_rows;
    }
  }();
  LeftWithin<Scalar, keeps_v ? n_within : 0> left;  // rows of what lies within, if they are not among the others
  RowTape<Scalar>* const tape = ws.tape(node.index);
  TriplePair<Scalar> hg;
  VectorI hq, scale;
  [[maybe_unused]] VectorI reduced_from = VectorI::Zero();
  [[maybe_unused]] Scalar along_h(0);  // S h
#pragma GCC unroll 8
  for (int d = 0; d < n_i; ++d) {
    hq(d) = -ws.load()(node.v + d);
    scale(d) = Scalar(0);
  }
  for (int k = 0; k < S::n_frames; ++k) {
    const auto& S_k = state.S_k[static_cast<std::size_t>(k)];
    const FrameState<Scalar>& f = ws.frame(node.frame + k);
    if constexpr (!keeps_v) {
      const auto& rows_k = ws.rows(node.frame + k);
      const Eigen::Index begin = rows.end();
      if constexpr (S::n_frames > 1) {
        if (tape != nullptr) [[unlikely]] { ws.frame_tape(node.frame + k)->move(0, begin, rows_k.count); }
      }
      for (Eigen::Index r = 0; r < rows_k.count; r += rows.lanes) {
        auto n = columns_at<7>(rows_k, r);
        for (int d = 0; d < n_i; ++d) {
          auto along = no_rows<Scalar>(), size = along;
#pragma GCC unroll 8
          for (int i = pattern.linear ? 0 : 3; i < (pattern.angular ? 6 : 3); ++i) {
            const auto part = n[static_cast<std::size_t>(i)] * S_k(i, d);
            along += part;
            size += without_signs<Scalar>(part);
          }
          put_rows<Scalar>(along, rows.at(7 + d, begin + r));
          scale(d) += sum_of_rows<Scalar>(size);
        }
        if constexpr (has_known) {
#pragma GCC unroll 8
          for (int i = 0; i < 6; ++i) { n[rhs] -= n[static_cast<std::size_t>(i)] * f.bias(i); }
        }
        for (int c = 0; c < 7; ++c) { put_rows<Scalar>(n[static_cast<std::size_t>(c)], rows.at(c, begin + r)); }
      }
      rows.count = begin + rows_k.count;
      const RootInertia<Scalar>& N_k = ws.root(node.frame + k);
      for (int d = 0; d < n_i && N_k.is_reduced; ++d) {
        for (int i = 0; i < 6; ++i) { reduced_from(d) += N_k.reduced_from(i) * abs(S_k(i, d)); }
      }
    }
    const TriplePair<Scalar> h(f.inertia().h.data());
#pragma GCC unroll 8
    for (int d = 0; d < n_i; ++d) { hq(d) += column_dot<pattern>(S_k, d, h); }
    if (k == 0) {
      hg = h;
    } else {
      hg += h;
    }
  }
  if constexpr (keeps_v) {
    const RootInertia<Scalar>& N_0 = ws.root(node.frame);
    scale(0) = N_0.scale;
    hq(0) += N_0.h_along;
    along_h = column_dot<pattern>(state.S_k[0], 0, hg) + N_0.h_along;
    hg += TriplePair<Scalar>(N_0.h.data());
  }
  // Bodies alone first: what they keep then has A'S = 0 up to roundings of its own, and no share of a small rotor in
  // it.
  std::array<std::array<Scalar, padded>, static_cast<std::size_t>(n_i)> top;  // [N₁ | z₁ | T]
  [[maybe_unused]] Reflection<Scalar, 8> reflection;
  [[maybe_unused]] SingleRow<Scalar> above = SingleRow<Scalar>::zero();
  [[maybe_unused]] bool moves = false;
  if constexpr (keeps_v) {
    moves = find_reflection<false>(rows, along_S, reflection, tape, rows.count);
    if (moves) {
      const auto& x = reflection.top;  // by numbers: g++ loads what it has just stored otherwise (3 % more)
      above = {{{x[0], x[1], x[2]}, {x[3], x[4], x[5]}}, x[rhs], x[along_S]};
    }
    if (tape != nullptr) [[unlikely]] { tape->tops = rows.count; }
  }
  [[maybe_unused]] const Scalar body_v = above.v;
  Scalar slip(0);                         // 1 − W S; times T² at first, Σ v (v − n S) over what lies within
  Scalar undone(1);                       // W S
  Scalar within_S(0);                     // Σ v n S over what lies within
  Scalar own_load = ws.load()(node.v);    // S h' on the inlet
  [[maybe_unused]] Scalar own_moment(0);  // of it the rotors', which a large load would take the digits of
  [[maybe_unused]] int n_put = 0;
  [[maybe_unused]] const TriplePair<Scalar> none = SingleRow<Scalar>::zero().n;
  [[maybe_unused]] const auto put_within = [&](const TriplePair<Scalar>& n, const Scalar& z, const VectorI& ratio,
                                               const Scalar& against_S, const Scalar& with_S) {
    slip += ratio(0) * against_S;
    within_S += ratio(0) * with_S;
#pragma GCC unroll 8
    for (int d = 0; d < n_i; ++d) { scale(d) += abs(ratio(d)); }
    if constexpr (keeps_v) {  // part by part: a copy of the whole waits for its parts (pass of the biped 3 % more)
      SingleRow<Scalar>& row = left.row[static_cast<std::size_t>(left.count++)];
      row.n.linear = n.linear;
      row.n.angular = n.angular;
      row.z = z;
      row.v = ratio(0);
    } else {
      const Eigen::Index at = rows.count;
      rows.open(1);
      rows.put_row(at, SingleRow<Scalar>{n, z, ratio(0)});
      for (int d = 1; d < n_i; ++d) { *rows.at(7 + d, at) = ratio(d); }
    }
    ++n_put;
  };
  if constexpr (rotor_count<S>() > 0) {
    for (const auto& rotor : s.rotors()) {
      SpunRotor<S> spun = spin_rotor<scene, S>(node, rotor, state, ws);
      if (spun.J > Scalar(0)) {
        const Scalar root = sqrt(spun.J);
        Scalar known = spun.bias;
        if constexpr (keeps_v && has_known) {  // what is subtracted from all rows below, the inlet's rotors do not have
          known -= dot(spun.a, Triple<Scalar>::settled(ws.frame(node.frame).bias.data() + 3));
        }
        Scalar against_S = rotor.ratio(0), with_S(0);
        if constexpr (keeps_v) {
          with_S = dot(spun.a, Triple<Scalar>::settled(state.S_k[0].data() + 3));
          if (rotor.frame < 0) { against_S -= with_S; }
        }
        put_within({none.linear, spun.a * root}, -root * known, root * spun.e, root * against_S, root * with_S);
      }
      if constexpr (scene.velocity) {
        const BodyRoot<Scalar>& carrier = ws.inlet_body(node.index);
        if (rotor.frame < 0 && node.inlet >= 0 && carrier.rows > 3) {
          Vector3<Scalar> moment(spun.moment(0), spun.moment(1), spun.moment(2));
          left.turning += triple(moment_of_rows(carrier, ws.inlet_axes(node, state), moment));
          spun.moment = triple(moment);
        }
        add_gyroscopic(spun, rotor, state, hg, hq);
        if constexpr (keeps_v) {
          if (rotor.frame < 0) { own_moment += dot(spun.moment, Triple<Scalar>::settled(state.S_k[0].data() + 3)); }
        }
      }
    }
  }
  if constexpr (scene.implicit) {
    for (const auto& spring : state.springs) {
      const Scalar root = sqrt(spring.inertia);
      const Scalar z = root > Scalar(0) ? -spring.force / root : Scalar(0);
      put_within(none, z, root * spring.ratio.transpose(), root * spring.ratio(0), Scalar(0));
    }
  }

  // Whether A'S = 0 for what the bodies keep: of one frame, with nothing within but in rows of its own.
  const bool freed = keeps_v ? moves : S::n_frames == 1 && n_put == 0;
  Eigen::Matrix<Scalar, n_i, n_i>& C = state.MbarR_inv_root;
  bool regular;
  if constexpr (keeps_v) {
    for (int k = 0; k < left.count; ++k) {
      rotate_along(above, left.row[static_cast<std::size_t>(k)], tape, rows.count, rows.count + 1 + k);
    }
    C(0, 0) = Scalar(1) / above.v;
    if (n_put > 0) {
      undone = (body_v * C(0, 0)) * (body_v * C(0, 0)) + (within_S * C(0, 0)) * C(0, 0);
      slip = (slip * C(0, 0)) * C(0, 0);
      own_load = undone * own_load + slip * along_h;
    }
    own_load += own_moment;
    const Scalar negligible = Scalar(64) * Eigen::NumTraits<Scalar>::epsilon() * scale(0);
    regular = ScalarTraits<Scalar>::is_positive(abs(above.v) - negligible);
    const RootInertia<Scalar>& N_0 = ws.root(node.frame);
    if (N_0.is_reduced) [[unlikely]] {
      regular = regular && stands_out(above.v, dot_of_sizes(TriplePair<Scalar>(N_0.reduced_from.data()),
                                                            TriplePair<Scalar>(state.S_k[0].data())));
    }
  } else {
    if (tape != nullptr) [[unlikely]] { tape->tops = rows.count; }
    regular = eliminate<n_i>(rows, scale, reduced_from, top, C, tape);
  }
  if (!regular) {
    diagnosis.fail(Status::not_positive_definite, node.index);
    C.setConstant(not_a_number<Scalar>());
    rows.count = 0;  // no row is left
    left.count = 0;
    moves = false;
  }
  const auto t = [&](int k, int d) __attribute__((always_inline)) -> const Scalar& {
    if constexpr (keeps_v) {
      return above.v;
    } else {
      return top[static_cast<std::size_t>(k)][static_cast<std::size_t>(7 + d)];
    }
  };
  const auto top_row = [&](int k) __attribute__((always_inline)) {
    if constexpr (keeps_v) {
      return above.n;
    } else {
      return TriplePair<Scalar>(top[static_cast<std::size_t>(k)].data());
    }
  };
  const auto z = [&](int k) __attribute__((always_inline)) {
    if constexpr (!keeps_v) {
      return top[static_cast<std::size_t>(k)][rhs];
    } else if constexpr (has_known) {
      return above.z - dot(above.n, TriplePair<Scalar>::settled(ws.frame(node.frame).bias.data()));
    } else {
      return above.z;
    }
  };
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
    TriplePair<Scalar> U = top_row(0) * t(0, d), W = top_row(0) * C(d, 0);
#pragma GCC unroll 8
    for (int k = 1; k < n_i; ++k) {
      U += top_row(k) * t(k, d);
      W += top_row(k) * C(d, k);
    }
    U.put(state.U.data() + 6 * d);
    if constexpr (n_i == 1) {
      W.put(state.W.data());
    } else {
#pragma GCC unroll 8
      for (int j = 0; j < 6; ++j) { state.W(d, j) = W(j); }
    }
    hg -= W * hq(d);
  }
  state.psi = product(state.MbarR_inv, hq);
#pragma GCC unroll 8
  for (int d = 0; d < n_i; ++d) {
#pragma GCC unroll 8
    for (int k = 0; k < n_i; ++k) { state.psi(d) -= C(d, k) * z(k); }
  }
  if (node.inlet < 0) { return; }
  share_axis<S>(node, state, slip, ws, undone);
  put_wrench<S>(node, state, hg, own_load, ws);
  if constexpr (keeps_v && has_known) { left.known = TriplePair<Scalar>::settled(ws.frame(node.frame).bias.data()); }
  const RootInertia<Scalar>& inlet = ws.root(node.inlet);
  Eigen::Index count = rows.count, hole = keeps_v && moves ? reflection.pivot : -1, from = 0;
  const Eigen::Index within_from = count + n_i;
  constexpr std::size_t columns = keeps_v ? 8 : 7;
  RootRows<Scalar, 6> compressed;
  bool is_compressed = false;
  const auto rest = [&](Eigen::Index r) __attribute__((always_inline)) {
    if (is_compressed) [[unlikely]] { return columns_at<columns>(compressed, r); }
    if constexpr (keeps_v) {
      if (moves) [[likely]] { return reflected(rows, reflection, r); }
    }
    return columns_at<columns>(rows, r);
  };
  const bool light = heaviest<S>(node, ws) > Scalar(inlet.outweighed) * ws.frame_body(node.inlet).root_mass;
  if (light || ws.rows(node.inlet).end() + count > (inlet.is_free ? inlet.loose_on_free : inlet.loose)) {
    from = within_from + n_put;
    count = compress_left<room>(rest, count, hole, freed ? 6 - n_i : 6, compressed, tape, from);
    hole = -1;
    is_compressed = true;
  }
  stack_on_inlet<scene>(node, state, rest, count, hole, true, ws, left, tape, from, within_from);
}

/// A frame of a subsystem without velocities.
template <Scene scene, class S, class Workspace>
void fixed_root_inward(const Node& node, const NodeState<S>& state, int k, Workspace& ws)
{
  using Scalar = typename S::Scalar;
  const LeftWithin<Scalar, 0> left;
  begin_rows(node.frame + k, ws);
  RowTape<Scalar>* const tape = ws.frame_tape(node.frame + k);
  const auto& rows = ws.rows(node.frame + k);
  Eigen::Index count = rows.count, from = 0;
  RootRows<Scalar, 6> compressed;
  bool is_compressed = false;
  const auto n = [&](Eigen::Index r) __attribute__((always_inline)) {
    return is_compressed ? columns_at<7>(compressed, r) : columns_at<7>(rows, r);
  };
  if (ws.rows(node.inlet).end() + count > RootInertia<Scalar>::loose) {
    from = count;
    count = compress_left<RootInertia<Scalar>::Rows::most>(n, count, -1, 6, compressed, tape, from);
    is_compressed = true;
  }
  stack_on_inlet<scene>(node, state, n, count, -1, k == 0, ws, left, tape, from, 0);
  const RootInertia<Scalar>& N = ws.root(node.frame + k);
  if (N.is_reduced) [[unlikely]] { add_reduced_from(node.inlet, N.reduced_from, state.r, ws); }
}

template <Scene scene, class S, class Workspace>
void square_root_inward(const Node& node, const S& s, NodeState<S>& state, Workspace& ws, Diagnosis& diagnosis)
{
  if constexpr (is_free<S>()) {
    begin_rows(node.frame, ws);
    free_root_inward<scene, S>(node, state, ws, diagnosis);
    if (node.inlet >= 0) { share_axis<S>(node, state, typename S::Scalar(0), ws); }
  } else {
    using std::abs;
    using std::max;
    using Scalar = typename S::Scalar;
    for (int k = 0; k < S::n_frames; ++k) { begin_rows(node.frame + k, ws); }
    if constexpr (one_column<S, Workspace>) {  // of an inlet with one column: SharedAxis
      if (node.inlet >= 0 && !ws.root(node.inlet).keeps_v) {
        add_reduced_from(node.inlet, size_of_rows(node, 1, ws), state.r, ws);
      }
    } else {
      if (node.inlet >= 0) { add_reduced_from(node.inlet, size_of_rows(node, S::n_frames, ws), state.r, ws); }
    }
    const bool bare = node.inlet >= 0 && ws.frame_body(node.inlet).rows == 0 && ws.root(node.inlet).keeps_v;
    RootRow<Scalar> size;
    if (bare) [[unlikely]] { size = size_of_rows(node, S::n_frames, ws); }
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
  for (int k = 0; k < S::n_frames; ++k) { ws.rows(node.frame + k).count = 0; }
}

}  // namespace iim::detail
