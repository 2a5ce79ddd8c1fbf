// What a subsystem leaves on the frame that it hangs on, in square-root form: its share of that frame's S, its wrench
// and its rows (square_root.hpp).
#pragma once

#include <iim/node_state.hpp>
#include <iim/numerics/registers.hpp>
#include <iim/numerics/spd.hpp>
#include <iim/pass/kinematics.hpp>
#include <iim/spatial.hpp>
#include <iim/square_root/root_compress.hpp>
#include <iim/square_root/root_rows.hpp>
#include <iim/square_root/square_root.hpp>
#include <iim/subsystem.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace iim::detail {

/// The shares of S_i in a motion that its columns span.
template <class Scalar, int n>
[[gnu::noinline]] void set_shares(const Eigen::Matrix<Scalar, 6, n>& S_i, const Vector6<Scalar>& motion,
                                  Vector6<Scalar>& shares)
{
  Eigen::Matrix<Scalar, n, n> product, C, inverse;
  Eigen::Matrix<Scalar, n, 1> along, scale;
  for (int d = 0; d < n; ++d) {
    along(d) = Scalar(0);
    for (int k = 0; k < 6; ++k) { along(d) += S_i(k, d) * motion(k); }
    for (int e = 0; e < n; ++e) {
      product(d, e) = Scalar(0);
      for (int k = 0; k < 6; ++k) { product(d, e) += S_i(k, d) * S_i(k, e); }
    }
    scale(d) = product(d, d);
  }
  invert_spd<Scalar, n>(product, scale, C, inverse);
  for (int d = 0; d < n; ++d) {
    shares(d) = Scalar(0);
    for (int e = 0; e < n; ++e) { shares(d) += inverse(d, e) * along(e); }
  }
}

/// S of the inlet against S_i. undone, slip: W S_i and 1 − W S_i.
template <class S, class Workspace>
void share_axis(const Node& node, const NodeState<S>& state, [[maybe_unused]] const auto& slip, Workspace& ws,
                [[maybe_unused]] const typename S::Scalar& undone = typename S::Scalar(1))
{
  using Scalar = typename S::Scalar;
  const RootInertia<Scalar>& inlet = ws.root(node.inlet);
  if (!inlet.keeps_v) { return; }
  SharedAxis<Scalar>& shared = ws.shared_axis(node.index);
  const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
  TriplePair<Scalar> difference{zero, zero};
  shared.share = shared.slip = Scalar(0);
  const TriplePair<Scalar> of_inlet(inlet.S.data());
  if constexpr (one_column<S, Workspace>) {
    if (shared.sense != Sense::none) {
      difference.put(shared.difference.data());
      shared.share = in_sense(shared.sense, Scalar(1));
      shared.undone(0) = in_sense(shared.sense, undone);
      shared.slip = in_sense(shared.sense, Scalar(slip));
      return;
    }
  }
  difference = {of_inlet.linear + cross(of_inlet.angular, Triple<Scalar>(state.r.data())), of_inlet.angular};
  if constexpr (has_inlet_twists<S>()) {
    if (shared.sense != Sense::none) [[unlikely]] {
      Vector6<Scalar> whole;
      difference.put(whole.data());
      set_shares(state.S_k[0], whole, shared.undone);
      difference = {zero, zero};
    }
  }
  if constexpr (one_column<S, Workspace>) {
    const TriplePair<Scalar> own(state.S_k[0].data());
    const auto along_own = [&](const TriplePair<Scalar>& x) __attribute__((always_inline)) {
      if constexpr (S::pattern.angular) {
        return dot(x.angular, own.angular);
      } else {
        return dot(x.linear, own.linear);
      }
    };
    const Scalar square = along_own(own);
    const Scalar unit = ScalarTraits<Scalar>::is_positive(square) ? Scalar(Scalar(1) / square) : Scalar(0);
    // First a whole share, which subtracts without a rounding if the axes are close, then what is left of it.
    const Scalar cosine = along_own(of_inlet) * unit, half(0.5);
    const Scalar whole(cosine > half ? 1 : cosine < -half ? -1 : 0);
    difference -= own * whole;
    const Scalar rest = along_own(difference) * unit;
    difference -= own * rest;
    shared.share = whole + rest;
    shared.undone(0) = shared.share * undone;
    shared.slip = shared.share * slip;
  }
  difference.put(shared.difference.data());
}

/// Whether S of a subsystem and of its inlet are about one line, where a body of six rows does not keep the latter's v
/// from being roundings.
template <class S, class Workspace>
[[gnu::always_inline]] inline bool coincide(const Node& node, const NodeState<S>& state, const Workspace& ws)
{
  using std::abs;
  using Scalar = typename S::Scalar;
  const RootInertia<Scalar>& inlet = ws.root(node.inlet);
  if (ws.frame_body(node.inlet).rows == BodyRoot<Scalar>::most_rows || !inlet.keeps_v) [[likely]] { return false; }
  const auto sum = [](const auto& x, int k) { return Scalar((abs(x(k)) + abs(x(k + 1))) + abs(x(k + 2))); };
  const Vector6<Scalar>& T = ws.shared_axis(node.index).difference;
  const Scalar small(1e-3), turning = sum(inlet.S, 3);  // per unit of the inlet's coordinate
  return !(sum(T, 3) > small * turning) && !(sum(T, 0) > small * (sum(state.r, 0) * turning + sum(inlet.S, 0)));
}

/// Of axes that coincide the difference is roundings of what it is taken from, and so is v of the rows that are handed
/// on: to the scale an eighth of Σ |n| · |what it is taken from|, so that v below 8 ε of this counts as zero. What is
/// exactly zero has no roundings.
template <class S, class Workspace>
[[gnu::noinline, gnu::cold]] void add_scale_of_roundings(const Node& node, const NodeState<S>& state, Workspace& ws)
{
  using std::abs;
  using Scalar = typename S::Scalar;
  RootInertia<Scalar>& inlet = ws.root(node.inlet);
  const Vector6<Scalar>&T = ws.shared_axis(node.index).difference, &own = state.S_k[0], &inlet_S = inlet.S;
  const bool moves = (abs(T(0)) + abs(T(1))) + abs(T(2)) > Scalar(0),
             turns = (abs(T(3)) + abs(T(4))) + abs(T(5)) > Scalar(0);
  const RootRow<Scalar> size = size_of_columns(ws.rows(node.frame));
  Scalar scale(0);
  for (int k = 0; k < 3; ++k) {
    const int i = (k + 1) % 3, j = (k + 2) % 3;
    const Scalar arms = abs(inlet_S(i + 3) * state.r(j)) + abs(inlet_S(j + 3) * state.r(i));
    if (moves) { scale += size(k) * (abs(inlet_S(k)) + arms + abs(own(k))); }
    if (turns) { scale += size(k + 3) * (abs(inlet_S(k + 3)) + abs(own(k + 3))); }
  }
  inlet.scale += scale * Scalar(0.125);
}

/// Σ |n| of the rows on a subsystem's frames.
template <class Workspace>
[[gnu::noinline, gnu::cold]] auto size_of_rows(const Node& node, int frames, Workspace& ws)
{
  RootRow<typename Workspace::Scalar> size = RootRow<typename Workspace::Scalar>::Zero();
  for (int k = 0; k < frames; ++k) { size += size_of_columns(ws.rows(node.frame + k)); }
  return size;
}

/// Σ |n| of rows about a coupling point, r from the inlet's, to what an inlet's are reduced from: that n S_i = 0 of
/// what is handed on is up to roundings of these.
template <class Scalar, class Workspace>
[[gnu::noinline]] void add_reduced_from(Eigen::Index inlet, RootRow<Scalar> size, const Vector3<Scalar>& r,
                                        Workspace& ws)
{
  using std::abs;
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    size(i + 3) += abs(r(j)) * size(k) + abs(r(k)) * size(j);
  }
  RootInertia<Scalar>& N = ws.root(inlet);
  N.reduced_from = N.is_reduced ? N.reduced_from + size : size;
  N.is_reduced = true;
}

/// What has been handed on to an inlet without a body of its own is wrong by roundings of the rows `size` that it was
/// reduced from, `weakness` times as large where their v was small, and so is v of the inlet, be it ever so small.
/// (Four joints about one point or along one direction, all but the last without mass: of 12000 machines 6000 passed
/// for regular without this; with it none, and of 6000 with three joints none is refused.)
template <class Workspace>
[[gnu::noinline, gnu::cold]] void add_scale_of_rows(const Node& node, const RootRow<typename Workspace::Scalar>& size,
                                                    const typename Workspace::Scalar& weakness, Workspace& ws)
{
  using std::abs;
  using Scalar = typename Workspace::Scalar;
  const Vector6<Scalar>& T = ws.shared_axis(node.index).difference;
  Scalar scale(0);
  for (int k = 0; k < 6; ++k) { scale += size(k) * abs(T(k)); }
  ws.root(node.inlet).scale += scale * weakness;
}

/// h' on the inlet. S_i · h' is what acts on the joint itself, `load`, or within it, where the inlet's S has a share of
/// S_i.
template <class S, class Workspace>
[[gnu::always_inline]] inline void put_wrench(const Node& node, const NodeState<S>& state,
                                              const TriplePair<typename S::Scalar>& h, const typename S::Scalar& load,
                                              Workspace& ws)
{
  using Scalar = typename S::Scalar;
  RootInertia<Scalar>& inlet = ws.root(node.inlet);
  Scalar* const to = inlet.keeps_v ? inlet.h.data() : ws.frame(node.inlet).inertia().h.data();
  TriplePair<Scalar> sum(to);
  sum += TriplePair<Scalar>(h.linear, h.angular + cross(Triple<Scalar>(state.r.data()), h.linear));
  sum.put(to);
  if (!inlet.keeps_v) { return; }
  const SharedAxis<Scalar>& shared = ws.shared_axis(node.index);
  inlet.h_along += shared.share * load + dot(TriplePair<Scalar>(shared.difference.data()), h);
  if constexpr (has_inlet_twists<S>()) {
    for (int d = 0; d < S::n_i; ++d) { inlet.h_along += shared.undone(d) * ws.load()(node.v + d); }
  }
}

/// √m of the heaviest body that the frames of S carry.
template <class S, class Workspace>
typename S::Scalar heaviest(const Node& node, const Workspace& ws)
{
  using std::max;
  typename S::Scalar root = ws.root(node.frame).heaviest;
  for (int k = 1; k < S::n_frames; ++k) { root = max(root, ws.root(node.frame + k).heaviest); }
  return root;
}

/// The rows of a frame's own body, before any others.
template <class Workspace>
[[gnu::always_inline]] inline void begin_rows(Eigen::Index frame, Workspace& ws)
{
  auto& rows = ws.rows(frame);
  if (rows.count > 0) { return; }
  const auto& own = ws.root(frame).own.rows;
#pragma GCC unroll 8
  for (int r = 0; r < own.most; r += own.lanes) {
#pragma GCC unroll 8
    for (int c = 0; c < 8; ++c) { put_rows<typename Workspace::Scalar>(rows_at(own.at(c, r)), rows.at(c, r)); }
  }
  rows.count = own.count;
}

/// Compressed rows in place of others.
template <class Scalar, int most, std::size_t steps>
void put_compressed(const std::array<RootRow<Scalar>, steps>& result, int count, RootRows<Scalar, most>& rows)
{
  rows.count = 0;
  rows.open(count);
  for (int k = 0; k < count; ++k) { rows.put_row(k, result[static_cast<std::size_t>(k)]); }
}

/// To `compressed` at most `rank` rows in place of others, n(r) those from row r on, `count` of them without the one at
/// `hole`; on the tape they are from `out` on.
template <int most, class Scalar, class Rows>
[[gnu::always_inline]] inline Eigen::Index compress_left(Rows&& n, Eigen::Index count, Eigen::Index hole, int rank,
                                                         RootRows<Scalar, 6>& compressed, RowTape<Scalar>* tape,
                                                         Eigen::Index out)
{
  RootRows<Scalar, most> rows;
  for (Eigen::Index r = 0; r < count; r += rows.lanes) {
    const auto part = n(r);
#pragma GCC unroll 8
    for (int c = 0; c < 7; ++c) { put_rows<Scalar>(part[static_cast<std::size_t>(c)], rows.at(c, r)); }
    put_rows<Scalar>(no_rows<Scalar>(), rows.at(along_S, r));
  }
  rows.count = count;
  if (hole >= 0) { rows.put_row(hole, SingleRow<Scalar>::zero()); }
  std::array<RootRow<Scalar>, 6> result;
  std::array<int, 6> pivot;
  put_compressed(result, compress_apart<6>(rows, result, pivot, rank, tape, out), compressed);
  return compressed.count;
}

/// What a subsystem leaves beside its rows.
template <class Scalar, int n_within>
struct LeftWithin {
  std::array<SingleRow<Scalar>, static_cast<std::size_t>(n_within)> row;  ///< of rotors and springs
  int count = 0;
  TriplePair<Scalar> known;  ///< acceleration of the frame that the rows do not contain yet
  Triple<Scalar> turning;    ///< part of z of the inlet bodies' moments

  LeftWithin()
  {
    turning = Triple<Scalar>(Scalar(0), Scalar(0), Scalar(0));
    known = {turning, turning};
  }
};

/// The rows that are left, n(r) those from row r on, `count`, of which the one at `hole` is no more, and those of
/// bodies on the inlet, seen from the parent's point. `tape`: of what leaves the rows, `from` the first of them there,
/// `within_from` the first of what lies within.
template <Scene scene, class S, class Workspace, class Rows, int n_within>
[[gnu::always_inline]] inline void stack_on_inlet(const Node& node, const NodeState<S>& state, Rows&& n,
                                                  Eigen::Index count, Eigen::Index hole, bool inlet_bodies,
                                                  Workspace& ws, const LeftWithin<typename S::Scalar, n_within>& left,
                                                  RowTape<typename S::Scalar>* tape, Eigen::Index from,
                                                  Eigen::Index within_from)
{
  using std::abs;
  using std::max;
  using Scalar = typename S::Scalar;
  RootInertia<Scalar>& inlet = ws.root(node.inlet);
  auto& onto = ws.rows(node.inlet);
  const BodyRoot<Scalar>& body = ws.inlet_body(node.index);
  const int body_rows = inlet_bodies ? body.rows : 0;
  begin_rows(node.inlet, ws);
  RowTape<Scalar>* const inlet_tape = ws.frame_tape(node.inlet);
  constexpr int lanes = rows_abreast<Scalar>;
  if (onto.end() + count + left.count + body_rows + 2 * lanes > onto.most) [[unlikely]] {
    std::array<RootRow<Scalar>, 6> result;
    std::array<int, 6> pivot;
    const Eigen::Index before = onto.count;
    const int rank = compress_apart<6>(onto, result, pivot, 6, inlet_tape, before);
    if (inlet_tape != nullptr) [[unlikely]] {
      inlet_tape->move(before, 0, rank);
      inlet_tape->cut(rank);
    }
    put_compressed(result, rank, onto);
  }
  RowMove<Scalar> move;
  move.r = state.r;
  TriplePair<Scalar> known = left.known;
  if constexpr (scene.velocity) { known.linear += Triple<Scalar>::settled(state.c.data()); }
  known.put(move.known.data());
  if (inlet.keeps_v) {
    TriplePair<Scalar>(ws.shared_axis(node.index).difference.data()).put(move.T.data());
  } else {
    move.T.setZero();
  }
  const Eigen::Index to = onto.end();
  move_rows<false>(n, count, move, onto, inlet.scale);
  if (tape != nullptr) [[unlikely]] {
    const bool in_hole = hole >= 0;
    tape->arrival = {from,
                     count,
                     to,
                     within_from,
                     left.count,
                     in_hole ? to + hole : onto.count,
                     onto.count + (in_hole ? 0 : 1),
                     inlet_tape->size()};
  }
  if constexpr (n_within > 0) {
    for (int k = 0; k < left.count; ++k) {
      const SingleRow<Scalar>& row = left.row[static_cast<std::size_t>(k)];
      SingleRow<Scalar> there = moved(row, move, inlet.scale);
      if (inlet.keeps_v) {  // n S_i is not 0
        const Scalar& share = ws.shared_axis(node.index).share;
        const TriplePair<Scalar> own(state.S_k[0].data());
        there.v += dot(row.n, own) * share;
        inlet.scale += dot_of_sizes(row.n, own) * abs(share);
      }
      if (hole < 0) { onto.open(1); }
      onto.put_row(hole < 0 ? onto.count - 1 : to + hole, there);
      hole = -1;
    }
  }
  if (hole >= 0) { onto.put_row(to + hole, SingleRow<Scalar>::zero()); }
  inlet.heaviest = max(inlet.heaviest, heaviest<S>(node, ws));
  if (body_rows > 0) {
    const Vector3<Scalar> at_inlet(Scalar(0), Scalar(0), Scalar(0));
    const Vector6<Scalar> none = Vector6<Scalar>::Zero();
    const Vector6<Scalar> column = inlet.keeps_v ? shift_twist(state.r, inlet.S) : none;
    Scalar scale;
    OwnRows<Scalar> own;
    own.set(body);
    place_roots<scene.velocity, Along::column>(body, ws.inlet_axes(node, state), at_inlet, ws.frame(node.inlet).omega,
                                               column, own, scale);
    if (inlet.keeps_v) { inlet.scale += scale; }
    if constexpr (scene.velocity && rotor_count<S>() > 0) {
      for (int k = 3; k < body_rows; ++k) { own.at(rhs, k) += left.turning(k - 3); }
    }
    if constexpr (scene.velocity) {
      if (body.has_beside) [[unlikely]] {
        const Vector3<Scalar> m = moment_beside(body, ws.inlet_axes(node, state), ws.frame(node.inlet).omega);
        Vector6<Scalar>& h = inlet.keeps_v ? inlet.h : ws.frame(node.inlet).inertia().h;
        for (int i = 0; i < 3; ++i) {
          h(3 + i) += m(i);
          if (inlet.keeps_v) { inlet.h_along += inlet.S(3 + i) * m(i); }
        }
      }
    }
    move.known = none;
    if constexpr (scene.velocity) { move.known.template head<3>() = state.c; }
    move.T = none;
    const auto of_body = [&](Eigen::Index r) __attribute__((always_inline)) { return columns_at<8>(own.rows, r); };
    move_rows<true>(of_body, body_rows, move, onto, scale);
    inlet.heaviest = max(inlet.heaviest, body.root_mass);
  }
}

}  // namespace iim::detail
