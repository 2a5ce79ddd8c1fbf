// Pivots that are small against the inertia that they stand in, in the projected form.
//
// Where thin parts lie along a joint's axis, as a wrist that is stretched along the forearm, D = Sᵀ A S is a difference
// of large entries of A, and wrong by ‖A‖/D roundings; with D all that M⁻¹ says of this joint. By Gauss's principle D
// is also
//
//     D = Σ_b a_bᵀ I_b a_b + Σ_r J_r (g_r a)²,        a: q̈_i = 1, and beyond it q̈_j = −W_j y_j
//
// over all bodies and rotors from the joint on, that is what the joint moves where the joints beyond it are free. Of
// all motions beyond this is the least such sum, so that errors of W count by their squares only; it has no
// differences, and the moments of a body meet the motion in its own axes. U is the same of a and of the motions that
// the inlet's axes make, Uₑ = Σ_b a_bᵀ I_b aₑ (single_motion.hpp). The sums go on, body by body, until A of a frame is
// good enough for what hangs on it: until the roundings of A along a are no more than those of a pivot that is not
// small. (Four times as many, passes of chains of boxes and rods take 3 to 10 % less, but trees of balls and of
// universal joints have up to 74 and 51 ε of B̂ instead of 13 and 27. Of several states, which wait for the deepest,
// four times: biped without rotors 5 % less, same digits.)
//
// A' = PᵀA P would bring the roundings of A along S in again, times ‖W‖². As A' S = 0, it is taken across S alone:
//
//     A' = E (A − ½ (U W + Wᵀ Uᵀ)) E,        E = 1 − S Sᵀ
//
// or, where the joint has inertia of its own, from A with U in place of its A S. So what is wrong of A stays as large
// as ε A, however small the pivots, and each pivot looks through it to where it has digits. (D alone from the sum, with
// U as A S, loses what the two have in common: masses × 10 per link a hundred times more.)
//
// Where all that hangs on the joint does so by one about the same line, or along the same direction (joint_lines.hpp),
// nothing of it is felt: that joint's A' and p' have A' S = 0 and Sᵀp' = ±τ, its load, but for roundings of what
// passes. D, U and Sᵀp are then the own body's, and τ. (Random hands, humanoids and chains of rods, joints about
// coordinate axes: q̈₀ in the median 16, 48 and 8 ε instead of 1100, 200 and 59, over 16 times the data's sensitivity in
// 2, 8 and 0.5 % of states instead of 84, 49 and 40; under loads 2 % instead of 38.)
//
// q̈ has the roundings of the forces by which heavy bodies are held, which h is a difference of; it is made right once
// by what the equations of motion leave of it (second_look.hpp), by how heavy these are.
//
// Measured (double, median and worst of 100 states in ε; in brackets without all this): B̂ of seven links under 10³, 10⁶
// and 10⁹ times their weight 5, 45 (340, 8000), 5, 144 (3·10⁵, 4·10⁶) and 7, 430 (2·10⁸, 3·10⁹), q̈₀ 3, 125 at most
// (300, 8000; 2·10⁵, 3·10⁶; 2·10⁸, 3·10⁹); masses × 10 per link, 12 links, B̂ 13, 1200 (8·10⁴, 10⁷), q̈₀ 2, 2·10⁴
// (7·10⁴, 2·10⁷); thin links on sliding and turning joints B̂ 6, 38 (9, 170). Chains of 6 to 30 boxes whose joints turn
// about the boxes or across them 1.4, 12 (31, 2300), such rods 1.5, 38 (2200, 2·10⁵). A joint takes 30 to 120 ns more
// where it is done, by how far the sums go, q̈ 40 ns a joint: arms under loads take up to 2.3 times as long, chains of
// boxes and rods, in every third joint, a third to a half longer, others in few states (a wrist stretched along the
// forearm).
//
// Several states at once do so for all lanes where it is to be done in one; passes of such boxes take a third of the
// time that they took when each such state was computed by itself.
//
// (A half to two thirds of what is mended of an arm or a biped could stay as it is: scale/D roundings of x xᵀ/D, x: the
// joints' accelerations where this one's is 1, are hidden by M⁻¹'s largest entry. With x as far as the next joints, and
// hidden by half of that entry, one state takes 3 to 7 % less, several 2 to 8 %, but B̂ of slender arms has up to 17 ε
// instead of 12; hidden by all of it, digits are as before, and nothing is gained. x of all joints takes as long as the
// sums.)
//
// Of several velocities, of screws, and of a free base: mended_root.hpp; of several frames: mended_compound.hpp.
#pragma once

#include <iim/pass/articulated_inertia.hpp>
#include <iim/pass/bodies_beyond.hpp>
#include <iim/pass/carried.hpp>
#include <iim/pass/internal_inertia.hpp>
#include <iim/pass/kinematics.hpp>
#include <iim/pass/roundings.hpp>
#include <iim/pass/second_look.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>
#include <iim/workspace.hpp>

namespace iim::detail {

/// As what a subsystem's step inward mends small pivots.
enum class Mended {
  nothing,  ///< they stay; those of free frames: free_inward.hpp
  pivot,    ///< of one frame that moves along a unit column: here
  root,     ///< of one frame that moves otherwise, with no rotors: mended_root.hpp
  compound  ///< of several frames, or with rotors: mended_compound.hpp
};
template <class S, class Data>
constexpr Mended mended_as()
{
  if (!mends<Data> || is_free<S>() || S::n_i == 0) { return Mended::nothing; }
  if (S::n_frames == 1 && has_unit_column<S>()) { return Mended::pivot; }
  if (!mends_several<Data> || S::n_i > 6) { return Mended::nothing; }
  return S::n_frames == 1 && rotor_count<S>() == 0 ? Mended::root : Mended::compound;
}

/// Column d of S, in all six rows.
template <MotionPattern pattern, class Scalar, int n>
[[gnu::always_inline]] inline TriplePair<Scalar> column_of(const Eigen::Matrix<Scalar, 6, n>& S, int d)
{
  const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
  const Scalar* const column = S.data() + 6 * d;
  return {pattern.linear ? Triple<Scalar>(column) : zero, pattern.angular ? Triple<Scalar>(column + 3) : zero};
}

/// Of a pivot below pivot_tolerance.
template <class Data>
[[gnu::cold, gnu::noinline]] void note_small_pivot(const Node& node, Data& ws, Diagnosis& diagnosis)
{
  if constexpr (looks_again<Data>) {
    ws.second_look().note_small_pivot(node.index);
  } else {
    diagnosis.fail(Status::not_positive_definite, node.index);
  }
}

/// A S and Sᵀ A S of a frame that moves along one column.
template <class Scalar>
struct Pivot {
  TriplePair<Scalar> U;
  Scalar D;                   ///< 0: left as it was
  Scalar more_h = Scalar(0);  ///< to its bias force, where that is known better, too
};

/// Whether A of a frame is good enough for a sum that is `so_far`, of the frame's acceleration a.
template <class Scalar, class Data>
[[gnu::always_inline]] inline bool has_digits(Data& ws, Index frame, const TriplePair<Scalar>& acceleration,
                                              const Scalar& so_far)
{
  const FrameState<Scalar>& f = ws.frame(frame);
  if (f.loses) { return false; }
  if constexpr (is_several<Scalar>) {
    if (!ws.places().has(frame)) { return true; }  // whatever stands there: the loop is done again
  }
  TriplePair<Scalar> a = acceleration;
  if (const auto* own = ws.axes().of(frame)) [[unlikely]] { a = turned(*own, false, a); }
  const TriplePair<Scalar> size = largest(f, f.inertia().A);
  const Scalar rounding = dot(TriplePair<Scalar>(a.linear * a.linear, a.angular * a.angular), size);
  return ScalarTraits<Scalar>::is_positive(Scalar(is_several<Scalar> ? 32 : 8) * so_far - rounding);
}
/// The same in a lane of the frame's motions.
template <class Scalar, class Lane, class Data>
[[gnu::always_inline]] inline bool has_digits(const Data& ws, Index frame, const Motions<Lane>& a, int lane,
                                              const Scalar& so_far)
{
  return has_digits(ws, frame,
                    TriplePair<Scalar>({a[0][lane], a[1][lane], a[2][lane]}, {a[3][lane], a[4][lane], a[5][lane]}),
                    so_far);
}

/// Roundings of accelerations, squared: a share of `scale` that sums are told from zero by.
template <class Scalar>
Scalar squared_roundings()
{
  const Scalar rounding = Scalar(64) * Eigen::NumTraits<Scalar>::epsilon();
  return rounding * rounding;
}

/// Of a joint along the unit column S, as it is: own: of what its frame does not take from others; D, h: with that. D:
/// small against `scale`.
template <class Scalar, class Data>
[[gnu::noinline]] Pivot<Scalar> mended_pivot_along(const Node& node, const TriplePair<Scalar>& S,
                                                   const Pivot<Scalar>& own, const Scalar& D, const Scalar& scale,
                                                   const Scalar& h, bool velocity, bool springs, Data& ws)
{
  if (const auto* const coaxial = ws.bodies_beyond().coaxial(node, springs, ws)) {
    if (!ScalarTraits<Scalar>::is_positive(own.D - squared_roundings<Scalar>() * scale)) { return {own.U, Scalar(0)}; }
    Scalar exact = coaxial->load(ws.load(), ws.tree()) - ws.load()(node.v);
    if (velocity) {
      const FrameState<Scalar>& f = ws.frame(node.frame);
      exact += along_column(ws.tree().frame_mass(node.frame), f, S, own.U, TriplePair<Scalar>(f.bias.data()), true);
    }
    return {own.U, own.D, exact - h};
  }
  if (!ws.frame(node.frame).arrived) { return {own.U, Scalar(0)}; }
  const Matrix3<Scalar>* const in_group = ws.axes().of(node.frame);
  TriplePair<Scalar> a = S;
  if (in_group != nullptr) [[unlikely]] {
    // The plane that a group's joints move in has its digits as it is, but under loads. (From 1/256 on, 9 joints under
    // 10³ times their weight 16, 230 ε; so 6, 28.)
    if (ScalarTraits<Scalar>::is_positive(Scalar(16) * D - scale)) { return {own.U, Scalar(0)}; }
    a = turned(*in_group, true, a);
  }
  const auto is_enough = [&ws](Index frame, const TriplePair<Scalar>& motion, const Scalar& so_far)
                             __attribute__((always_inline)) { return has_digits(ws, frame, motion, so_far); };
  const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
  MotionSum<Scalar> sum;
  sum.G = own.D;
  TriplePair<Scalar> U(zero, zero);
  ws.bodies_beyond().add_up_until(is_enough, node, a, springs, ws, sum, U);
  if (!ScalarTraits<Scalar>::is_positive(sum.G - squared_roundings<Scalar>() * (scale + sum.turning))) {
    return {own.U, Scalar(0)};
  }
  if (in_group != nullptr) [[unlikely]] { U = turned(*in_group, false, U); }
  U += own.U;
  ws.second_look().note_mended_pivot(sum.G, scale);
  return {U, sum.G};
}

/// Of subsystem S. (By value: what a function that is not inlined may write to would not stay in registers. All but
/// this is compiled once for all types: a controller is 12 % smaller.)
template <class S, class Data>
[[gnu::noinline]] Pivot<typename S::Scalar> mended_pivot(const Node& node, const NodeState<S>& state,
                                                         const typename S::Scalar D, const typename S::Scalar scale,
                                                         const typename S::Scalar h, bool velocity, bool springs,
                                                         Data& ws)
{
  using Scalar = typename S::Scalar;
  const Pivot<Scalar> own{own_column(state, ws.frame(node.frame)), state.own.D};
  return mended_pivot_along(node, column_of<S::pattern>(state.S_k[0], 0), own, D, scale, h, velocity, springs, ws);
}

/// A −= a bᵀ + b aᵀ.
template <class Scalar>
[[gnu::always_inline]] inline void subtract_both(const TriplePair<Scalar>& a, const TriplePair<Scalar>& b,
                                                 SpatialInertia<Scalar>& A)
{
  SixColumns<Scalar, 2> left, right;
  left[0] = right[1] = a;
  left[1] = right[0] = b;
  subtract_product(left, right, A);
}

/// A S = U for a unit column S, and all else of A as it was.
template <class Scalar>
[[gnu::always_inline]] inline void set_column(const TriplePair<Scalar>& S, const TriplePair<Scalar>& U,
                                              SpatialInertia<Scalar>& A)
{
  // x = A S − U, less ½ (S·x) S, which both terms have
  TriplePair<Scalar> x = times(A, S);
  x -= U;
  x -= S * (Scalar(0.5) * dot(S, x));
  subtract_both(S, x, A);
}

/// A' of such a pivot: with A S = U where the joint has inertia of its own, else across S. (Called: a controller is
/// smaller.)
template <class Scalar>
[[gnu::noinline]] void reduce(const SpatialInertia<Scalar>& A, const TriplePair<Scalar>& S, const TriplePair<Scalar>& U,
                              const TriplePair<Scalar>& W, bool has_own, SpatialInertia<Scalar>& reduced)
{
  SpatialInertia<Scalar> result;
  copy(A, result);
  if (has_own) {
    set_column(S, U, result);
  } else {
    const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
    subtract_both(U, W * Scalar(0.5), result);
    set_column(S, {zero, zero}, result);
  }
  copy(result, reduced);
}

}  // namespace iim::detail
