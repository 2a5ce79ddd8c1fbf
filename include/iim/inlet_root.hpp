// What a subsystem leaves on the frame that it hangs on, in square-root form: its share of that frame's S, its wrench and its
// rows (square_root.hpp).
#pragma once

#include <iim/kinematics.hpp>
#include <iim/registers.hpp>
#include <iim/root_rows.hpp>
#include <iim/spatial.hpp>
#include <iim/square_root.hpp>
#include <iim/subsystem.hpp>
#include <iim/workspace.hpp>

#include <algorithm>
#include <array>

namespace iim::detail {

/// S of the inlet against S_i. undone, slip: W S_i and 1 − W S_i.
template <class S, class Workspace>
void share_axis(const Node& node, const NodeState<S>& state, [[maybe_unused]] const auto& slip, Workspace& ws,
                [[maybe_unused]] const typename S::Scalar& undone = typename S::Scalar(1))
{
  using Scalar = typename S::Scalar;
  const RootInertia<Scalar>& inlet = ws.root(node.inlet);
  if (!inlet.keeps_v) { return; }
  SharedAxis<Scalar>& shared = ws.shared_axis(node.index);
  shared.difference = shift_twist(state.r, inlet.S);
  shared.share = shared.undone = shared.slip = Scalar(0);
  if constexpr (one_column<S, Workspace>) {
    if (inlet.apart_along == node.index) {
      shared.difference.setZero();
      shared.share = Scalar(1);
      shared.undone = undone;
      shared.slip = slip;
      return;
    }
    const Vector6<Scalar>& own = state.S_k[0];
    constexpr int part = S::pattern.angular ? 3 : 0;
    const auto along_own = [&](const Vector6<Scalar>& x) {
      return Scalar(x(part) * own(part) + x(part + 1) * own(part + 1) + x(part + 2) * own(part + 2));
    };
    // First a whole share, which subtracts without a rounding if the axes are close, then what is left of it.
    const Scalar cosine = along_own(inlet.S), half(0.5);
    const Scalar whole(cosine > half ? 1 : cosine < -half ? -1 : 0);
#pragma GCC unroll 8
    for (int k = 0; k < 6; ++k) { shared.difference(k) -= whole * own(k); }
    const Scalar rest = along_own(shared.difference);
#pragma GCC unroll 8
    for (int k = 0; k < 6; ++k) { shared.difference(k) -= rest * own(k); }
    shared.share = whole + rest;
    shared.undone = shared.share * undone;
    shared.slip = shared.share * slip;
  }
}

/// Whether S of a subsystem and of its inlet are about one line, where a body of six rows does not keep the latter's v from
/// being roundings.
template <class S, class Workspace>
[[gnu::always_inline]] inline bool coincide(const Node& node, const NodeState<S>& state, const Workspace& ws)
{
  using std::abs;
  using Scalar = typename S::Scalar;
  const RootInertia<Scalar>& inlet = ws.root(node.inlet);
  if (ws.frame_body(node.inlet).rows == BodyRoot<Scalar>::most_rows || !inlet.keeps_v) [[likely]] { return false; }
  const auto sum = [](const auto& x, int k) { return Scalar((abs(x(k)) + abs(x(k + 1))) + abs(x(k + 2))); };
  const Vector6<Scalar>& T = ws.shared_axis(node.index).difference;
  const Scalar small(1e-3);
  return !(sum(T, 3) > small) && !(sum(T, 0) > small * (sum(state.r, 0) + sum(inlet.S, 0)));
}

/// Of axes that coincide the difference is roundings of what it is taken from, and so is v of the rows that are handed on: to the
/// scale an eighth of Σ |n| · |what it is taken from|, so that v below 8 ε of this counts as zero. What is exactly zero has no
/// roundings.
template <class S, class Workspace>
[[gnu::noinline, gnu::cold]] void add_scale_of_roundings(const Node& node, const NodeState<S>& state, Workspace& ws)
{
  using std::abs;
  using Scalar = typename S::Scalar;
  RootInertia<Scalar>& inlet = ws.root(node.inlet);
  const Vector6<Scalar>&T = ws.shared_axis(node.index).difference, &own = state.S_k[0], &inlet_S = inlet.S;
  const bool moves = (abs(T(0)) + abs(T(1))) + abs(T(2)) > Scalar(0), turns = (abs(T(3)) + abs(T(4))) + abs(T(5)) > Scalar(0);
  const RootInertia<Scalar>& N = ws.root(node.frame);
  RootRow<Scalar> size = RootRow<Scalar>::Zero();
  for (int r = 0; r < N.rows; ++r) { size += N.row[static_cast<std::size_t>(r)].abs(); }
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
[[gnu::noinline, gnu::cold]] auto size_of_rows(const Node& node, int frames, const Workspace& ws)
{
  RootRow<typename Workspace::Scalar> size = RootRow<typename Workspace::Scalar>::Zero();
  for (int k = 0; k < frames; ++k) {
    const auto& N = ws.root(node.frame + k);
    for (int r = 0; r < N.rows; ++r) { size += N.row[static_cast<std::size_t>(r)].abs(); }
  }
  return size;
}

/// What has been handed on to an inlet without a body of its own is wrong by roundings of the rows `size` that it was reduced from,
/// `weakness` times as large where their v was small, and so is v of the inlet, be it ever so small. (Four joints about one point or
/// along one direction, all but the last without mass: of 12000 machines 6000 passed for regular without this; with it none, and of
/// 6000 with three joints none is refused.)
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

/// h' on the inlet. S_i · h' is what acts on the joint itself, `load`, or within it, where the inlet's S has a share of S_i.
template <class S, class Workspace>
void put_wrench(const Node& node, const NodeState<S>& state, const Vector6<typename S::Scalar>& h,
                const typename S::Scalar& load, Workspace& ws)
{
  RootInertia<typename S::Scalar>& inlet = ws.root(node.inlet);
  if (!inlet.keeps_v) {
    add(ws.frame(node.inlet).h, shift_wrench(state.r, h));
    return;
  }
  const SharedAxis<typename S::Scalar>& shared = ws.shared_axis(node.index);
  add(inlet.h, shift_wrench(state.r, h));
  inlet.h_along += shared.share * load;
#pragma GCC unroll 8
  for (int k = 0; k < 6; ++k) { inlet.h_along += shared.difference(k) * h(k); }
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

/// The rows that are left, and those of bodies on the inlet, seen from the parent's point. `known`: acceleration of the
/// frame that the rows do not contain yet; `turning`: part of z of the inlet bodies' moments; `tape`: of what leaves the rows,
/// `first` the first of them there.
template <Scene scene, class S, class Workspace>
void stack_on_inlet(
    const Node& node, const NodeState<S>& state, const RootRow<typename S::Scalar>* left, int count, bool inlet_bodies,
    Workspace& ws, RowTape<typename S::Scalar>* tape, int first, [[maybe_unused]] int within = 0,
    Vector6<typename S::Scalar> known = Vector6<typename S::Scalar>::Zero(),
    [[maybe_unused]] const Vector3<typename S::Scalar>& turning = Vector3<typename S::Scalar>::Zero())
{
  using std::abs;
  using std::max;
  using Scalar = typename S::Scalar;
  RootInertia<Scalar>& inlet = ws.root(node.inlet);
  constexpr int capacity = RootInertia<Scalar>::most;
  constexpr int most = capacity + capacity + BodyRoot<Scalar>::most_rows;  // the inlet's, of one frame, of its bodies
  const BodyRoot<Scalar>& body = ws.inlet_body(node.index);
  const int body_rows = inlet_bodies ? body.rows : 0;
  const Vector6<Scalar> none = Vector6<Scalar>::Zero();
  const Vector6<Scalar> T = inlet.keeps_v ? ws.shared_axis(node.index).difference : none;
  if constexpr (scene.velocity) {
#pragma GCC unroll 8
    for (int i = 0; i < 3; ++i) { known(i) += state.c(i); }
  }
  const int rows = inlet.rows + count + body_rows;
  const bool fits = rows <= capacity;
  RowTape<Scalar>* const inlet_tape = ws.frame_tape(node.inlet);
  if (tape != nullptr) [[unlikely]] { tape->arrival = {first, count, inlet.rows, inlet_tape->size()}; }
  std::array<RootRow<Scalar>, most> stack;
  if (!fits) { std::copy(inlet.row.begin(), inlet.row.begin() + inlet.rows, stack.begin()); }
  RootRow<Scalar>* row = (fits ? inlet.row.data() : stack.data()) + inlet.rows;
  const RowMove<Scalar> move = row_move(state.r, known, T);
  RootRow<Scalar> size = RootRow<Scalar>::Zero();
  for (int r = 0; r < count; ++r, ++row) {
    size += left[r].abs();
    *row = moved(left[r], move);
  }
  if (inlet.keeps_v) {
    if constexpr (one_column<S, Workspace> && has_within<S>()) {  // the last rows, of what lies within: n S_i is not 0
      const Scalar& share = ws.shared_axis(node.index).share;
      for (int r = 1; r <= within; ++r) {
        Scalar along(0), whole(0);
#pragma GCC unroll 8
        for (int k = S::pattern.linear ? 0 : 3; k < (S::pattern.angular ? 6 : 3); ++k) {
          const Scalar x = left[count - r](k) * state.S_k[0](k);
          along += x;
          whole += abs(x);
        }
        row[-r](along_S) += along * share;
        inlet.scale += whole * abs(share);
      }
    }
    Scalar moved_scale(0);
#pragma GCC unroll 8
    for (int k = 0; k < 6; ++k) { moved_scale += size(k) * abs(T(k)); }
    inlet.scale += moved_scale;
  }
  if (body_rows > 0) {
    const Vector3<Scalar> at_inlet(Scalar(0), Scalar(0), Scalar(0));
    const Vector6<Scalar> column = inlet.keeps_v ? shift_twist(state.r, inlet.S) : none;
    Scalar scale;
    place_roots<scene.velocity, Along::column>(body, state.R, at_inlet, ws.frame(node.inlet).omega, column, row, scale);
    if (inlet.keeps_v) { inlet.scale += scale; }
    if constexpr (scene.velocity && rotor_count<S>() > 0) {
      for (int k = 3; k < body_rows; ++k) { row[k](rhs) += turning(k - 3); }
    }
    Vector6<Scalar> c = none;
    if constexpr (scene.velocity) { c.template head<3>() = state.c; }
    const RowMove<Scalar> body_move = row_move(state.r, c, none);
    for (int r = 0; r < body_rows; ++r, ++row) { *row = moved(*row, body_move); }
  }
  inlet.heaviest = max(inlet.heaviest, heaviest<S>(node, ws));
  if (body_rows > 0) { inlet.heaviest = max(inlet.heaviest, body.root_mass); }
  if (fits) {
    inlet.rows = rows;
  } else {
    std::array<int, 6> pivot;
    inlet.rows = in_one_function<Scalar>([&] { return compress<6, most>(stack.data(), rows, inlet.row.data(), pivot, 6, inlet_tape); });
    if (inlet_tape != nullptr) [[unlikely]] { inlet_tape->cut(inlet.rows); }
  }
}

}  // namespace iim::detail
