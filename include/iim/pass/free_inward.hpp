// A free subsystem in matrix form; in square-root form: free_root.hpp.
//
// Nothing passes on, and W = S_k⁻¹ is known: what is asked for is C of M̄_R⁻¹ = C Cᵀ alone. It comes from the inertia
// about the body's own centre, which has the digits that M̄_R of another point would round away ((com/gyration)² of
// them), C = W C_A, A⁻¹ = C_A C_Aᵀ.
//
// A base moves along with the first joint of the limb on it almost freely: A' S = 0 for the limb's A' and the joint's
// column S (or what rotors, springs and bodies on the inlet hold, FreeAxis::held), but for roundings, which are as
// large as the limb is against the base. So A' and p' of the limb stay apart from what else the frame carries, A₀ and
// p₀, where they meet S, and S takes the place of one column of T = [E S], E: unit columns, and two across S:
//
//     A_T = Tᵀ (A₀ + A') T,   with (A₀ + A') S = A₀ S + held;      A_T⁻¹ = C_T C_Tᵀ,   C_A = T C_T
//     Tᵀ (p₀ + p'),           with Sᵀ p' = the force on the joint from within, FreeAxis::force
//
// The frame's motion per e of C_T reaches the joint in two parts, E e and S·rate, rate = last·e₅: with W S = undone = 1
// − slip (slip: what rotors and springs hold, else 0) the joint undoes S·rate, and its frame moves by E e and slip
// alone. As much for columns of B̂ as for q̈₀, and the other way round for wrenches: Sᵀ p' = slip·Sᵀ p less undone·τ. (A
// base 10⁻⁶ as heavy as its limb, an input beyond the limb's second joint: 340 ε; 5e7 with the sum of both.) So it does
// for any other limb whose first joint turns about the same line, with S or −S: all of them are handed on apart.
//
// (Of 1000 random chains on a free base like their links, the error of B̂ is over 16 ε for 2 % with this, 10 % without;
// of free bars in a plane, 31 of them, it is 11 ε and 1880, by the axes that the frame shares with its limb, too:
// parallel_axes.hpp. And in less time, since M̄_R is not formed: pass of the biped 3 % less.)
#pragma once

#include <iim/numerics/spd.hpp>
#include <iim/pass/articulated_inertia.hpp>
#include <iim/pass/carried.hpp>
#include <iim/pass/free_axis.hpp>
#include <iim/pass/free_limb.hpp>
#include <iim/pass/kinematics.hpp>
#include <iim/pass/mended_root.hpp>
#include <iim/pass/roundings.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>
#include <iim/workspace.hpp>

#include <array>
#include <cstddef>

namespace iim::detail {

template <class Scalar>
[[gnu::always_inline]] inline Scalar square(const Scalar& x)
{
  return x * x;
}

/// Two directions across a: columns of the reflection that takes it to ∓e₃.
template <class Scalar>
[[gnu::always_inline]] inline std::array<Triple<Scalar>, 2> across(const Triple<Scalar>& a, const Scalar& length)
{
  const Scalar zero(0), one(1);
  const Scalar size = if_greater(a(2), zero, a(2), Scalar(zero - a(2))) + length;
  const Scalar last = if_greater(a(2), zero, size, Scalar(zero - size));
  const Scalar factor = one / (length * size), x = factor * a(0), y = factor * a(1);
  const Triple<Scalar> u(a(0), a(1), last);
  return {Triple<Scalar>(one, zero, zero) - u * x, Triple<Scalar>(zero, one, zero) - u * y};
}

/// C_T, whose pivots are small. Whether no pivot is below pivot_tolerance, as `positive` has been.
template <class Scalar, class Data>
[[gnu::noinline]] bool mend_free(const Node& node, const FreeAxis<Scalar>& axis, const std::array<Triple<Scalar>, 2>& b,
                                 const Matrix6<Scalar>& A_T, const Vector6<Scalar>& scale, bool springs, bool positive,
                                 Data& ws, Matrix6<Scalar>& C_T)
{
  const TriplePair<Scalar> S_1(axis.S.data());
  Matrix6<Scalar> T = Matrix6<Scalar>::Identity();
  b[0].put(&T(3, 3));
  b[1].put(&T(3, 4));
  S_1.put(&T(0, 5));
  Vector6<Scalar> inertia = scale;
  inertia(5) = dot(TriplePair<Scalar>(S_1.linear * S_1.linear, S_1.angular * S_1.angular), axis.size) + axis.within;
  if (!positive) { root_of_inverse<Scalar, 6, true>(A_T, scale, C_T); }
  if (!mend_root(node, ws.tree().frame_mass(node.frame), T, scale, inertia, springs, ws, C_T)) { return positive; }
  positive = true;
  for (int k = 0; k < 6; ++k) {
    const Scalar loss = square(C_T(k, k)) * scale(k);
    positive &= ScalarTraits<Scalar>::is_positive(Scalar(1) - pivot_tolerance<Scalar>() * loss);
    ws.second_look().note_mended_pivot(Scalar(1), loss);
  }
  return positive;
}

/// To the frame what subsystems hand on to it; what limbs along the axis hand on is told apart, in `axis`.
template <Scene scene, class Workspace>
[[gnu::always_inline]] inline void gather_limbs(const Node& node, Workspace& ws,
                                                FrameState<typename Workspace::Scalar>& f,
                                                FreeAxis<typename Workspace::Scalar>& axis)
{
  using Scalar = typename Workspace::Scalar;
  if (axis.child < 0) {
    axis.held.setZero();
    axis.force = axis.within = Scalar(0);
    complete_axis(f, axis);
  } else if (axis.receiver >= 0) {
    take_limbs(ws, axis);
    complete_axis(f, axis);
    const FrameState<Scalar>& limbs = ws.frame(axis.receiver);
    arrive<scene.velocity>(node.frame, ws);
    FrameInertia<Scalar>& all = f.inertia();
    const FrameInertia<Scalar>& more = limbs.inertia();
    all.A += more.A;
    add(all.h, more.h);
    all.size = {max(all.size.linear, more.size.linear), max(all.size.angular, more.size.angular)};
    if (limbs.loses) [[unlikely]] { add_loss(more.loss, Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(0)), f); }
  }
}

/// To these the frame's own bodies: all that it carries, and what of it meets the axis.
template <Scene scene, class S, class Workspace>
[[gnu::always_inline]] inline Carried<typename S::Scalar> carry_all(const Node& node, const Workspace& ws,
                                                                    FrameState<typename S::Scalar>& f,
                                                                    FreeAxis<typename S::Scalar>& axis)
{
  using Scalar = typename S::Scalar;
  Carried<Scalar> all;
  if constexpr (is_several<Scalar>) {
    all = carried_at(f);
  } else {
    own_bodies<S, scene.velocity>(ws.tree().frame_mass(node.frame), f, all);
    complete_axis(all.A, all.h, axis);
    axis.size = {max(axis.size.linear, all.A.M.diagonal()), max(axis.size.angular, all.A.J.diagonal())};
    add_arrived(f, all);
  }
  return all;
}

/// T = [1 0 0; 0 b S_1], and M̄_R of the base in its columns.
template <class Scalar>
struct FreeEquation {
  std::array<Triple<Scalar>, 2> b;
  TriplePair<Scalar> S_1;
  Matrix6<Scalar> A_T;    ///< lower triangle
  Vector6<Scalar> scale;  ///< of the roundings of A_T's diagonal
  Matrix6<Scalar> C_T;
};

/// A_T and what the roundings of its diagonal are told from. size: of the inertia A is reduced from.
template <class Scalar>
[[gnu::always_inline]] inline void set_A_T(const SpatialInertia<Scalar>& A, const TriplePair<Scalar>& size,
                                           const FrameState<Scalar>& f, const FreeAxis<Scalar>& axis,
                                           FreeEquation<Scalar>& free)
{
  using Pair = TriplePair<Scalar>;
  const Pair S_1(axis.S.data()), a(axis.held.data());
  const std::array<Triple<Scalar>, 2> b = across(S_1.angular, axis.turning);
  free.S_1 = S_1, free.b = b;
#pragma GCC unroll 8
  for (int i = 0; i < 3; ++i) {
    free.scale(i) = size.linear(i);
#pragma GCC unroll 8
    for (int j = 0; j <= i; ++j) { free.A_T(i, j) = A.M(j, i); }
  }
#pragma GCC unroll 8
  for (int k = 0; k < 2; ++k) {
    const Triple<Scalar> b_k = b[static_cast<std::size_t>(k)];
    const Pair U = A.of_angular(b_k);
#pragma GCC unroll 8
    for (int i = 0; i < 3; ++i) { free.A_T(3 + k, i) = U.linear(i); }
#pragma GCC unroll 8
    for (int l = k; l < 2; ++l) { free.A_T(3 + l, 3 + k) = dot(b[static_cast<std::size_t>(l)], U.angular); }
    free.scale(3 + k) = dot(b_k * b_k, size.angular);
    free.A_T(5, 3 + k) = dot(b_k, a.angular);
  }
#pragma GCC unroll 8
  for (int i = 0; i < 3; ++i) { free.A_T(5, i) = a.linear(i); }
  free.A_T(5, 5) = dot(S_1, a);
  free.scale(5) = dot(Pair(S_1.linear * S_1.linear, S_1.angular * S_1.angular), axis.size) + axis.within;
  if (f.loses) [[unlikely]] {
    const Pair& loss = f.inertia().loss;
    for (int i = 0; i < 3; ++i) { free.scale(i) += square(loss.linear(i)); }
    free.scale(5) += square(axis.loss);
    for (int k = 0; k < 2; ++k) { free.scale(3 + k) += square(dot(b[static_cast<std::size_t>(k)], loss.angular)); }
  }
}

/// C_T, mended where pivots are small.
template <class Workspace, class Scalar>
[[gnu::always_inline]] inline void invert_free(const Node& node, const FreeAxis<Scalar>& axis,
                                               [[maybe_unused]] const Scalar& largest_inverse, Workspace& ws,
                                               Diagnosis& diagnosis, FreeEquation<Scalar>& free)
{
  bool positive = root_of_inverse<Scalar, 6>(free.A_T, free.scale, free.C_T);
  if constexpr (Workspace::update == Update::projected) {
    if constexpr (is_several<Scalar>) {
      bool strong = true;
#pragma GCC unroll 8
      for (int k = 0; k < 6; ++k) {
        strong &= ScalarTraits<Scalar>::is_positive(Scalar(512) - square(free.C_T(k, k)) * free.scale(k));
      }
      if (!strong) { OneByOne<Scalar>::ask(); }
    } else if (diagnosis.status == Status::ok &&
               is_weak(free.C_T, free.scale, Scalar(8), largest_inverse, axis.turning)) {
      positive = mend_free(node, axis, free.b, free.A_T, free.scale, ws.is_implicit(), positive, ws, free.C_T);
    }
  }
  if (!positive) { note_small_pivot(node, ws, diagnosis); }
}

/// Tᵀ p, p the bias wrench of the frame.
template <class Scalar>
[[gnu::always_inline]] inline void set_p_T(const TriplePair<Scalar>& p, const FreeAxis<Scalar>& axis,
                                           const FreeEquation<Scalar>& free, Vector6<Scalar>& p_T)
{
#pragma GCC unroll 8
  for (int i = 0; i < 3; ++i) { p_T(i) = p.linear(i); }
  p_T(3) = dot(free.b[0], p.angular);
  p_T(4) = dot(free.b[1], p.angular);
  p_T(5) = axis.force;
}

/// M̄_R⁻¹ = C Cᵀ, C an upper triangle of three by three blocks.
template <class Scalar>
[[gnu::always_inline]] inline void put_inverse(const std::array<TriplePair<Scalar>, 6>& C, Matrix6<Scalar>& MbarR_inv)
{
#pragma GCC unroll 8
  for (int d = 0; d < 6; ++d) {
    TriplePair<Scalar> sum = C[5] * C[5](d);
    sum += C[4] * C[4](d);
    sum += C[3] * C[3](d);
    if (d < 3) {
#pragma GCC unroll 8
      for (std::size_t k = 0; k < 3; ++k) { sum.linear += C[k].linear * C[k].linear(d); }
    }
    sum.put(&MbarR_inv(0, d));
  }
}

/// C = W T C_T and M̄_R⁻¹, and the accelerations without inputs. The frame's V̇ = −A⁻¹ p is told from the forces on it
/// alone: as the inlet's acceleration, bias and S q̈ together it would have the roundings of gravity, which joints feel
/// by their lengths' reciprocal (solo12 at rest: q̈₀ 50 ε, with this 2). ψ = W (bias − V̇).
template <Scene scene, class S, class Workspace>
[[gnu::always_inline]] inline void put_free(const Node& node, const TriplePair<typename S::Scalar>& p,
                                            const FreeEquation<typename S::Scalar>& free, const Workspace& ws,
                                            FrameState<typename S::Scalar>& f, FreeAxis<typename S::Scalar>& axis,
                                            NodeState<S>& state)
{
  using Scalar = typename S::Scalar;
  using Pair = TriplePair<Scalar>;
  Vector6<Scalar> p_T;
  set_p_T(p, axis, free, p_T);
  const TransposedRotation<Scalar> back(f.R);
  const Triple<Scalar> r = triple(f.r), zero(Scalar(0), Scalar(0), Scalar(0));
  const Matrix6<Scalar>& C_T = free.C_T;
  std::array<Pair, 6> C;
  Pair left(zero, zero);  // −V̇, but for S·rate
  Scalar rate(0);
#pragma GCC unroll 8
  for (int k = 0; k < 6; ++k) {
    Triple<Scalar> lin(C_T(0, k), k > 0 ? C_T(1, k) : Scalar(0), k > 1 ? C_T(2, k) : Scalar(0)), ang = zero;
    if (k > 2) { ang = free.b[0] * C_T(3, k); }
    if (k > 3) { ang += free.b[1] * C_T(4, k); }
    const Pair apart(lin, ang);
    apart.put(&axis.E(0, k));
    if (k > 4) {
      ang += free.S_1.angular * C_T(5, 5);
      lin += free.S_1.linear * C_T(5, 5);
    }
    Scalar e = C_T(0, k) * p_T(0);
#pragma GCC unroll 8
    for (int i = 1; i <= k; ++i) { e += C_T(i, k) * p_T(i); }
    Pair& own = C[static_cast<std::size_t>(k)];
    own = {back * (k > 2 ? lin - cross(r, ang) : lin), k > 2 ? back * ang : zero};
    if constexpr (has_internal_force<S>() || S::n_u > 0) { e -= dot(own, Pair(ws.load().data() + node.v)); }
    left += apart * e;
    if (k > 4) { rate = e * C_T(5, 5); }
    own.put(&state.MbarR_inv_root(0, k));
  }
  axis.last = C_T(5, 5);
  axis.rate = Scalar(0) - rate;
  Pair(zero - left.linear, zero - left.angular).put(axis.rest.data());
  left += free.S_1 * rate;
  Pair(zero - left.linear, zero - left.angular).put(f.Vdot.data());
  if constexpr (has_bias<scene, S>(0)) { left.linear += Triple<Scalar>(f.bias.data()); }
  if constexpr (has_bias<scene, S>(3)) { left.angular += Triple<Scalar>(f.bias.data() + 3); }
  Pair(back * (left.linear - cross(r, left.angular)), back * left.angular).put(state.psi.data());
  put_inverse(C, state.MbarR_inv);
}

template <Scene scene, class S, class Workspace>
void free_matrix_inward(const Node& node, NodeState<S>& state, Workspace& ws, Diagnosis& diagnosis,
                        const typename S::Scalar& largest_inverse)
{
  using Scalar = typename S::Scalar;
  FrameState<Scalar>& f = ws.frame(node.frame);
  FreeAxis<Scalar>& axis = *ws.free_axis(node.frame);
  gather_limbs<scene>(node, ws, f, axis);
  const Carried<Scalar> all = carry_all<scene, S>(node, ws, f, axis);
  keep(all, f);
  FreeEquation<Scalar> free;
  set_A_T(all.A, largest(f, all.A), f, axis, free);
  invert_free(node, axis, largest_inverse, ws, diagnosis, free);
  put_free<scene>(node, all.h, free, ws, f, axis, state);
}

}  // namespace iim::detail
