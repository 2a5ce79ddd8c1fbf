// The inward loop of the O(n) pass for one subsystem in square-root form: square_root.hpp.
#pragma once

#include <iim/numerics/registers.hpp>
#include <iim/pass/kinematics.hpp>
#include <iim/scalar.hpp>
#include <iim/square_root/free_root.hpp>
#include <iim/square_root/inlet_root.hpp>
#include <iim/square_root/root_rows.hpp>
#include <iim/square_root/root_step.hpp>
#include <iim/square_root/square_root.hpp>
#include <iim/subsystem.hpp>
#include <iim/workspace.hpp>

#include <cmath>

namespace iim::detail {

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
    in_one_function<Scalar>([&] { root_inward<scene>(node, s, state, ws, diagnosis); });
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
