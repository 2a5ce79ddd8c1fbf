// The inward loop of the O(n) pass for one subsystem in square-root form: square_root.hpp.
#pragma once

#include <iim/internal_inertia.hpp>
#include <iim/kinematics.hpp>
#include <iim/spatial.hpp>
#include <iim/square_root.hpp>
#include <iim/subsystem.hpp>
#include <iim/workspace.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>

namespace iim::detail {

/// The rows that are left, and those of bodies on the inlet, seen from the parent's point.
template <Scene scene, class S, class N, class Workspace>
void stack_on_inlet(const N& node, const NodeState<S>& state, const RootRow<typename S::Scalar>* left, int count,
                    bool inlet_bodies, Workspace& ws)
{
  using Scalar = typename S::Scalar;
  RootInertia<Scalar>& inlet = ws.root(node.inlet);
  constexpr int capacity = RootInertia<Scalar>::most;
  constexpr int most =
      6 + (S::n_frames + 1) * capacity + rotor_count<S>() + (scene.implicit ? spring_count<S>() : 0);
  const BodyRoot<Scalar>& body = ws.inlet_body(node.index);
  const int body_rows = inlet_bodies ? body.rows : 0;
  const auto stack_on = [&](RootRow<Scalar>* row) {
    for (int r = 0; r < count; ++r, ++row) {
      *row = left[r];
      shift_row<scene.velocity>(*row, state.r, state.c);
    }
    if (body_rows > 0) {
      RootInertia<Scalar> own;
      const Vector3<Scalar> at_inlet(Scalar(0), Scalar(0), Scalar(0));
      place_roots<scene.velocity>(body, state.R, at_inlet, ws.frame(node.inlet).omega, own);
      for (int r = 0; r < own.rows; ++r, ++row) {
        *row = own.row[static_cast<std::size_t>(r)];
        shift_row<scene.velocity>(*row, state.r, state.c);
      }
    }
  };
  const int size = inlet.rows + count + body_rows;
  if (size <= capacity) {
    stack_on(inlet.row.data() + inlet.rows);
    inlet.rows = size;
  } else {
    std::array<RootRow<Scalar>, most> stack;
    std::copy(inlet.row.begin(), inlet.row.begin() + inlet.rows, stack.begin());
    stack_on(stack.data() + inlet.rows);
    std::array<int, 6> pivot;
    inlet.rows = compress<most>(stack, size, inlet.row.data(), pivot);
  }
}

/// Rows of all frames, rotors and springs; eliminated; stacked on the parent.
template <Scene scene, class S, class N, class Workspace>
void square_root_inward(const N& node, const S& s, Workspace& ws, Diagnosis& diagnosis)
{
  using std::abs;
  using std::sqrt;
  using Scalar = typename S::Scalar;
  constexpr MotionPattern pattern = S::pattern;
  constexpr int n_i = S::n_i;
  constexpr int n_rotors = rotor_count<S>();
  constexpr int most =
      RootInertia<Scalar>::most * S::n_frames + n_rotors + (scene.implicit ? spring_count<S>() : 0) + abreast;
  using VectorI = Eigen::Matrix<Scalar, n_i, 1>;
  NodeState<S>& state = ws.template node<S>(node);

  // [v | N | z] over the frames, applied forces beside it.
  std::array<VectorI, most> v;
  std::array<RootRow<Scalar>, most> rows;
  int count = 0;
  Vector6<Scalar> hg;
  VectorI hq, scale;
  for (int d = 0; d < n_i; ++d) {
    hq(d) = -ws.load()(node.v + d);
    scale(d) = Scalar(0);
  }
  for (int k = 0; k < S::n_frames; ++k) {
    const auto& S_k = state.S_k[static_cast<std::size_t>(k)];
    const FrameState<Scalar>& f = ws.frame(node.frame + k);
    const RootInertia<Scalar>& N_k = ws.root(node.frame + k);
    for (int r = 0; r < N_k.rows; ++r, ++count) {
      const auto at = static_cast<std::size_t>(count);
      RootRow<Scalar>& n = rows[at];
      n = N_k.row[static_cast<std::size_t>(r)];
      for (int d = 0; d < n_i && !is_free<S>(); ++d) {
        v[at](d) = column_dot<pattern>(S_k, d, n(0), n(1), n(2), n(3), n(4), n(5));
        for (int i = pattern.linear ? 0 : 3; i < (pattern.angular ? 6 : 3); ++i) { scale(d) += abs(S_k(i, d) * n(i)); }
      }
      if constexpr (has_bias<scene, S>(0) || has_bias<scene, S>(3)) { subtract_known(n, f.bias); }
    }
    for (int d = 0; d < n_i; ++d) { hq(d) += column_dot<pattern>(S_k, d, f.h); }
    if (k == 0) {
      hg = f.h;
    } else {
      add(hg, f.h);
    }
  }
  if constexpr (n_rotors > 0) {
    const auto rotors = s.rotors();
    for (std::size_t k = 0; k < n_rotors; ++k, ++count) {
      const SpunRotor<S> spun = spin_rotor<scene, S>(node, rotors[k], state, ws);
      const auto at = static_cast<std::size_t>(count);
      const Scalar root = sqrt(spun.J);
      const Scalar zero(0);
      rows[at] << zero, zero, zero, root * spun.a(0), root * spun.a(1), root * spun.a(2), -root * spun.bias, zero;
      for (int d = 0; d < n_i; ++d) {
        v[at](d) = root * spun.e(d);
        scale(d) += abs(v[at](d));
      }
      if constexpr (scene.velocity) { add_gyroscopic(spun, rotors[k], state, hg, hq); }
    }
  }
  if constexpr (scene.implicit) {
    for (const auto& spring : state.springs) {
      const auto at = static_cast<std::size_t>(count++);
      rows[at].setZero();
      const Scalar root = sqrt(spring.inertia);
      for (int d = 0; d < n_i; ++d) {
        v[at](d) = root * spring.ratio(d);
        scale(d) += abs(v[at](d));
      }
    }
  }

  Eigen::Matrix<Scalar, n_i, n_i>& C = state.MbarR_inv_root;
  bool regular;
  if constexpr (is_free<S>()) {
    regular = eliminate_free<Scalar, most>(rows, count, state.S_k[0], v, C);
  } else {
    regular = eliminate<n_i, Scalar, most>(v, rows, count, scale, C);
  }
  if (!regular) {
    diagnosis.fail(Status::not_positive_definite, node.index);
    C.setConstant(std::numeric_limits<Scalar>::quiet_NaN());
  }
  for (int d = 0; d < n_i; ++d) {
    for (int e = 0; e < n_i; ++e) {
      state.MbarR_inv(d, e) = C(d, 0) * C(e, 0);
      state.MbarR(d, e) = v[0](d) * v[0](e);
      for (int k = 1; k < n_i; ++k) {
        state.MbarR_inv(d, e) += C(d, k) * C(e, k);
        state.MbarR(d, e) += v[static_cast<std::size_t>(k)](d) * v[static_cast<std::size_t>(k)](e);
      }
    }
    for (int j = 0; j < 6; ++j) {
      state.W(d, j) = C(d, 0) * rows[0](j);
      state.U(j, d) = v[0](d) * rows[0](j);
      for (int k = 1; k < n_i; ++k) {
        state.W(d, j) += C(d, k) * rows[static_cast<std::size_t>(k)](j);
        state.U(j, d) += v[static_cast<std::size_t>(k)](d) * rows[static_cast<std::size_t>(k)](j);
      }
    }
  }
  state.psi = product(state.MbarR_inv, hq);
  for (int d = 0; d < n_i; ++d) {
    for (int k = 0; k < n_i; ++k) { state.psi(d) -= C(d, k) * rows[static_cast<std::size_t>(k)](rhs); }
  }
  if constexpr (is_free<S>()) {
    state.W = state.S_k[0].transpose();
    return;  // nothing passes on
  }
  if (node.inlet < 0) { return; }
  for (int j = 0; j < 6; ++j) {
    for (int d = 0; d < n_i; ++d) { hg(j) -= state.W(d, j) * hq(d); }
  }
  add(ws.frame(node.inlet).h, shift_wrench(state.r, hg));
  stack_on_inlet<scene>(node, state, rows.data() + n_i, count - n_i, true, ws);
}

}  // namespace iim::detail
