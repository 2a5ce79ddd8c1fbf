// A free subsystem in square-root form: square_root.hpp.
//
// A free base that is much lighter than the limb on it moves almost freely as the limb's first joint does: of the
// limb's rows n, n S = 0 for S, the joint's own column seen from the base. Were the base's acceleration kept as six
// numbers, the limb would move by their roundings times what the base's lightness makes of a force. So its columns are
// exchanged:
//
//     V̇ = E b + S·rate,    N V̇ = [N E  v] (b; rate),   v = N S,    E: unit columns but one, p, where S is largest
//
// with v = 0 in the limb's rows from the start, v = N_b S in the base's own, n times what is left of S (SharedAxis) in
// those of other limbs. With Q [N E  v  z] = [N₁  z₁] and G the columns of (E b; rate) = G e for N₁ (b; rate) = e,
//
//     (E b; rate) = G (z₁ − Gᵀ (h; Sᵀh)),   V̇ = E b + S·rate,   q̈ = W (V̇ − bias − y),   C = W (E b + S·rate) of G
//
// and E b and the rate reach the limb apart from each other, as from a joint. Nothing passes on to what it hangs on.
#pragma once

#include <iim/node_state.hpp>
#include <iim/numerics/registers.hpp>
#include <iim/pass/free_axis.hpp>
#include <iim/pass/internal_inertia.hpp>
#include <iim/pass/kinematics.hpp>
#include <iim/scalar.hpp>
#include <iim/spatial.hpp>
#include <iim/square_root/root_compress.hpp>
#include <iim/square_root/root_rows.hpp>
#include <iim/square_root/square_root.hpp>
#include <iim/subsystem.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

namespace iim::detail {

/// S of a free frame: the column of the joint `child` that hangs on it, or what joints on it have in common, and v of
/// the frame's own rows. Before the inward loop.
template <class Workspace>
void set_free_axis(const FreeAxis<typename Workspace::Scalar>& axis, Workspace& ws)
{
  using std::abs;
  using Scalar = typename Workspace::Scalar;
  const FrameState<Scalar>& f = ws.frame(axis.frame);
  RootInertia<Scalar>& N = ws.root(axis.frame);
  Vector3<Scalar> r = f.r;
  Vector6<Scalar> S;
  if (axis.child >= 0) {
    add(r, times(f.R, ws.tree().placement(axis.child).p));
    S = ws.root(ws.tree().node(axis.child).frame).S;
  } else {
    set(S, times(f.R, linear(axis.common)), times(f.R, angular(axis.common)));
  }
  for (int i = 0; i < 3; ++i) { r(i) = -r(i); }
  N.S = shift_twist(r, S);
  N.h.setZero();
  N.h_along = Scalar(0);
  N.scale = Scalar(0);
  const BodyRoot<Scalar>& body = ws.frame_body(axis.frame);
  for (int k = 0; k < body.rows; ++k) {
    Scalar along(0);
    for (int i = 0; i < 6; ++i) {
      const Scalar part = N.own.at(i, k) * N.S(i);
      along += part;
      N.scale += abs(part);
    }
    N.own.at(along_S, k) = along;
  }
}

/// The column that S replaces: the largest of its angular ones, or of its linear ones if it has no other.
template <class Scalar>
int exchanged(const Vector6<Scalar>& S)
{
  using std::abs;
  const auto most = [&](int first) {
    const int at = abs(S(first + 1)) > abs(S(first)) ? first + 1 : first;
    return abs(S(first + 2)) > abs(S(at)) ? first + 2 : at;
  };
  const int turning = most(3);
  return abs(S(turning)) > Scalar(0) ? turning : most(0);
}

/// Lanes `column` and along_S of a row, exchanged: whole rows at a time, since parts of one that is stored are slow to
/// load.
template <class Scalar>
class Exchange {
public:
  explicit Exchange(int column) : column_(column)
  {
    for (int l = 0; l < 8; ++l) {
      at_column_(l) = Scalar(l == column ? 1 : 0);
      at_end_(l) = Scalar(l == along_S ? 1 : 0);
    }
    others_ = Scalar(1) - at_column_ - at_end_;
  }

  RootRow<Scalar> operator()(const RootRow<Scalar>& n) const
  {
    return n * others_ + (at_column_ * n(along_S) + at_end_ * n(column_));
  }

private:
  int column_;
  RootRow<Scalar> at_column_, at_end_, others_;
};

/// Q [N E  v  z] = [N₁  z₁] of the rows on a free frame, and G, the rate's row last. N₁ and z₁: as they are without the
/// exchange. False if N₁ is singular up to roundings.
template <class Scalar>
bool eliminate_free(RootInertia<Scalar>& inertia, typename RootInertia<Scalar>::Rows& rows,
                    std::array<RootRow<Scalar>, 6>& N, RowTape<Scalar>* tape)
{
  using std::abs;
  const bool keeps_v = inertia.keeps_v;
  const int p = keeps_v ? exchanged(inertia.S) : 0;
  const Exchange<Scalar> exchange(p);
  if (rows.count < 6) { return false; }
  RootRow<Scalar> scale = size_of_columns(rows);
  if (keeps_v) {
    scale(p) = inertia.scale;
    std::swap_ranges(rows.at(p, 0), rows.at(p, rows.end()), rows.at(along_S, 0));
  }
  std::array<int, 6> pivot{};
  if (tape != nullptr) [[unlikely]] { tape->tops = rows.count; }
  const int rank = compress_apart<6>(rows, N, pivot, 6, tape, rows.count);
  if (rank < 6) { return false; }
  bool regular = true;
  std::array<RootRow<Scalar>, 7>& G = inertia.G;
  for (int k = 5; k >= 0; --k) {
    const RootRow<Scalar>& n = N[static_cast<std::size_t>(k)];
    const int row = pivot[static_cast<std::size_t>(k)];
    // Measured: half of this still refuses every base without mass on one limb (3000 robots), twice of it refuses in
    // float one of a hundred bases that are up to 1e10 times lighter than their limb.
    const Scalar negligible = Scalar(8) * Eigen::NumTraits<Scalar>::epsilon() * scale(row);
    regular &= ScalarTraits<Scalar>::is_positive(abs(n(row)) - negligible);
    if (inertia.is_reduced && !(keeps_v && row == p)) { regular &= stands_out(n(row), inertia.reduced_from(row)); }
    RootRow<Scalar> sum;
    for (int l = 0; l < 8; ++l) { sum(l) = Scalar(l == k ? 1 : 0); }
    for (int l = k + 1; l < 6; ++l) {
      const int column = pivot[static_cast<std::size_t>(l)];
      sum -= G[static_cast<std::size_t>(column)] * n(column);
    }
    G[static_cast<std::size_t>(row)] = sum * (Scalar(1) / n(row));
  }
  G[free_rate].setZero();
  if (keeps_v) {
    std::swap(G[static_cast<std::size_t>(p)], G[free_rate]);
    for (RootRow<Scalar>& n : N) { n = exchange(n); }
  }
  return regular;
}

/// Σ_k rows[k] rows[k](d), d < 6: of rows with the six columns of X, the columns of XᵀX.
template <class Scalar>
[[gnu::always_inline]] inline void products(const std::array<RootRow<Scalar>, 6>& left,
                                            const std::array<RootRow<Scalar>, 6>& right,
                                            Eigen::Matrix<Scalar, 6, 6>& result)
{
#pragma GCC unroll 8
  for (int d = 0; d < 6; ++d) {
    RootRow<Scalar> a = left[0] * right[0](d), b = left[1] * right[1](d);
    a += left[2] * right[2](d), b += left[3] * right[3](d);
    a += left[4] * right[4](d), b += left[5] * right[5](d);
    a += b;
#pragma GCC unroll 8
    for (int i = 0; i < 6; ++i) { result(i, d) = a(i); }
  }
}

template <Scene scene, class S, class Workspace>
void free_root_inward(const Node& node, NodeState<S>& state, Workspace& ws, Diagnosis& diagnosis)
{
  using Scalar = typename S::Scalar;
  RootInertia<Scalar>& inertia = ws.root(node.frame);
  const FrameState<Scalar>& f = ws.frame(node.frame);
  const auto& G = inertia.G;
  const bool keeps_v = inertia.keeps_v;
  std::array<RootRow<Scalar>, 6> N_1;
  if (!eliminate_free(inertia, ws.rows(node.frame), N_1, ws.tape(node.index))) {
    diagnosis.fail(Status::not_positive_definite, node.index);
    const RootRow<Scalar> nothing = RootRow<Scalar>::Constant(not_a_number<Scalar>());
    N_1.fill(nothing);
    inertia.G.fill(nothing);
  }
  // (E b; rate) = G (z₁ − Gᵀ (h; Sᵀh)), with the forces on the velocities themselves in h
  Vector6<Scalar> h = f.inertia().h;
  for (int d = 0; d < 6; ++d) {
    const Scalar& load = ws.load()(node.v + d);
    for (int i = 0; i < 6; ++i) { h(i) -= state.W(d, i) * load; }
  }
  Scalar along(0);
  if (keeps_v) {
    along = inertia.h_along;
    for (int i = 0; i < 6; ++i) { along += inertia.S(i) * h(i); }
    add(h, inertia.h);
  }
  RootRow<Scalar> e = G[free_rate] * -along;
#pragma GCC unroll 8
  for (std::size_t i = 0; i < 6; ++i) { e -= G[i] * h(static_cast<int>(i)); }
#pragma GCC unroll 8
  for (std::size_t k = 0; k < 6; ++k) { e(static_cast<int>(k)) += N_1[k](rhs); }
  inertia.rate = dot_of_six(G[free_rate], e);
  // V̇ per e, and q̈: C
  std::array<RootRow<Scalar>, 6> whole, C;
  Vector6<Scalar> a;
#pragma GCC unroll 8
  for (int i = 0; i < 6; ++i) {
    const auto at = static_cast<std::size_t>(i);
    inertia.rest(i) = dot_of_six(G[at], e);
    a(i) = inertia.rest(i);
    whole[at] = G[at];
    if (keeps_v) {
      whole[at] += G[free_rate] * inertia.S(i);
      a(i) += inertia.S(i) * inertia.rate;
    }
  }
  if constexpr (has_bias<scene, S>(0)) {
    for (int i = 0; i < 3; ++i) { a(i) -= f.bias(i); }
  }
  if constexpr (has_bias<scene, S>(3)) {
    for (int i = 3; i < 6; ++i) { a(i) -= f.bias(i); }
  }
#pragma GCC unroll 8
  for (int d = 0; d < 6; ++d) {
    const auto at = static_cast<std::size_t>(d);
    C[at] = whole[3] * state.W(d, 3) + whole[4] * state.W(d, 4) + whole[5] * state.W(d, 5);
    Scalar rate = state.W(d, 3) * a(3) + state.W(d, 4) * a(4) + state.W(d, 5) * a(5);
    if (d < 3) {
      C[at] += whole[0] * state.W(d, 0) + whole[1] * state.W(d, 1) + whole[2] * state.W(d, 2);
      rate += state.W(d, 0) * a(0) + state.W(d, 1) * a(1) + state.W(d, 2) * a(2);
    }
    state.psi(d) = -rate;
  }
  std::array<RootRow<Scalar>, 6> C_columns;
#pragma GCC unroll 8
  for (int k = 0; k < 6; ++k) {
    RootRow<Scalar>& column = C_columns[static_cast<std::size_t>(k)];
#pragma GCC unroll 8
    for (int d = 0; d < 6; ++d) { state.MbarR_inv_root(d, k) = column(d) = C[static_cast<std::size_t>(d)](k); }
    column(6) = column(7) = Scalar(0);
  }
  products(C_columns, C_columns, state.MbarR_inv);
}

}  // namespace iim::detail
