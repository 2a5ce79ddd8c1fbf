// Pivots that are small against the inertia that they stand in, in the projected form.
//
// Where thin parts lie along a joint's axis, as a wrist that is stretched along the forearm, D = Sᵀ A S is a difference of large
// entries of A, and wrong by ‖A‖/D roundings; with D all that M⁻¹ says of this joint. By Gauss's principle D is also
//
//     D = Σ_b a_bᵀ I_b a_b + Σ_r J_r (g_r a)²,        a: q̈_i = 1, and beyond it q̈_j = −W_j y_j
//
// over all bodies and rotors from the joint on, that is what the joint moves where the joints beyond it are free. Of all motions
// beyond this is the least such sum, so that errors of W count by their squares only; it has no differences, and the moments of a
// body meet the motion in its own axes.
//
// A' = PᵀA P would bring the roundings of A along S in again, times ‖W‖². As A' S = 0, it is taken across S alone:
//
//     A' = E (A − ½ (U W + Wᵀ Uᵀ)) E,        E = 1 − S Sᵀ
//
// which is for the first weak pivot on the way inward: behind it, and where D is smaller by far, as under heavy loads, the
// roundings of A, U and D hang together, and are better left together (masses × 10 per link, 12 links: a hundred times worse with
// this than without).
//
// Measured (double, B̂, worst of 1000 random states in ε): an arm of six axes whose wrist is of light thin links 61, with this 15;
// a robot with two arms of seven 27 and 9. Where a pivot's roundings would not be seen beside larger parts of M⁻¹ nothing is done:
// of the robots tried up to one pass in six has such a pivot, of a biped without gears one in three, and chains and trees have none.
//
// Of a free base, where such a pivot is one of six, all of A⁻¹ = C Cᵀ is made right (mend_root): with a = C G = Cᵀ A C is 1 but for
// what C is wrong by, and A⁻¹ = C G⁻¹ Cᵀ. (Of 3000 random chains on a free base like their links the error of B̂ is over 16 ε for
// 0.7 %, 3.5 % without; on a base 10⁻⁶ as heavy, its limbs about one axis, 13 ε at most, 10⁸ without.)
#pragma once

#include <iim/articulated_inertia.hpp>
#include <iim/carried.hpp>
#include <iim/internal_inertia.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>
#include <iim/workspace.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace iim::detail {

/// G += Σ_b a_iᵀ I_b a_j + Σ_r J_r (g_r a_i)(g_r a_j), i ≤ j < n, over what hangs on a subsystem, for n accelerations of its frame:
/// one in FrameState::Vdot, or six in WorkspaceData::motions. The pass, which knows the types of the tree, adds them up; the steps
/// know this alone.
template <class Scalar>
struct SumBeyond {
  void* pass;
  void (*add)(void* pass, const Node& node, int n, Scalar* G);  ///< G: n × n, column by column
  Scalar largest = Scalar(0);  ///< of all M̄_R⁻¹ of one velocity so far, which ‖M⁻¹‖ is not less than
};

/// A frame's n accelerations, world axes, at its coupling point.
template <class Data>
[[gnu::always_inline]] inline typename Data::Scalar* motions_of(Index frame, int n, Data& ws)
{
  return n == 1 ? ws.frame(frame).Vdot.data() : ws.motions(frame).data();
}

/// Of the body on a frame that has the n accelerations a at its coupling point.
template <class Scalar>
[[gnu::noinline]] void add_products(const FrameMass<Scalar>& body, const Matrix3<Scalar>& R, const Vector3<Scalar>& r,
                                    const Scalar* a, int n, Scalar* G)
{
  if (!body.present) { return; }
  const Triple<Scalar> centre = triple(r) + combined(R, body.com);
  std::array<TriplePair<Scalar>, 6> moves;  // of the centre, world axes; of the body's turning, its own
  for (int k = 0; k < n; ++k) {
    const TriplePair<Scalar> at(a + 6 * k);
    TriplePair<Scalar>& own = moves[static_cast<std::size_t>(k)];
    own.linear = at.linear + cross(at.angular, centre);
    const Vector3<Scalar> omega(dot(column(R, 0), at.angular), dot(column(R, 1), at.angular), dot(column(R, 2), at.angular));
    own.angular = triple(omega);
    const TriplePair<Scalar> momentum(own.linear * body.mass, combined(body.central_inertia, omega));
    for (int j = 0; j <= k; ++j) { G[k * n + j] += dot(moves[static_cast<std::size_t>(j)], momentum); }
  }
}

/// What of a subsystem's memory the sums need, whatever its type.
template <class Scalar>
struct MovedBy {
  const Matrix3<Scalar>& R;
  const Vector3<Scalar>& r;
  const Scalar* S;  ///< of all frames, 6 × n_i each
  const Scalar* W;  ///< n_i × 6
  int n_i;
  int n_frames;
};

/// Inertia that turns at the rate axis·ω + ratio·q̈: a rotor, a spring's.
template <class Scalar>
struct Spinning {
  Scalar inertia;
  Vector3<Scalar> axis;
  const Scalar* ratio;
};

/// A subsystem's share; leaves the accelerations of its frames where it found its inlet's. qdd: room for n_i × n numbers.
template <class Scalar, class Data>
[[gnu::noinline]] void add_share_of(const Node& node, const MovedBy<Scalar>& part, const Spinning<Scalar>* spinning, int n_spinning,
                                    Data& ws, int n, Scalar* G, Scalar* qdd)
{
  const Scalar* const inlet = motions_of(node.inlet, n, ws);
  Matrix6<Scalar> y;
  for (int k = 0; k < n; ++k) {
    const TriplePair<Scalar> at(inlet + 6 * k);
    TriplePair<Scalar>(at.linear + cross(at.angular, triple(part.r)), at.angular).put(&y(0, k));
    for (int d = 0; d < part.n_i; ++d) {
      Scalar& own = qdd[k * part.n_i + d];
      own = Scalar(0);
      for (int i = 0; i < 6; ++i) { own -= part.W[i * part.n_i + d] * y(i, k); }
    }
  }
  const Vector3<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
  add_products(ws.tree().inlet_mass(node.index), part.R, zero, y.data(), n, G);
  for (int r = 0; r < n_spinning; ++r) {
    Vector6<Scalar> rate;
    for (int k = 0; k < n; ++k) {
      rate(k) = dot(triple(spinning[r].axis), Triple<Scalar>(&y(3, k)));
      for (int d = 0; d < part.n_i; ++d) { rate(k) += spinning[r].ratio[d] * qdd[k * part.n_i + d]; }
      for (int j = 0; j <= k; ++j) { G[k * n + j] += rate(j) * (spinning[r].inertia * rate(k)); }
    }
  }
  for (int frame = 0; frame < part.n_frames; ++frame) {
    Scalar* const own = motions_of(node.frame + frame, n, ws);
    for (int k = 0; k < n; ++k) {
      TriplePair<Scalar> a(&y(0, k));
      for (int d = 0; d < part.n_i; ++d) { a += TriplePair<Scalar>(part.S + 6 * (frame * part.n_i + d)) * qdd[k * part.n_i + d]; }
      a.put(own + 6 * k);
    }
    const FrameState<Scalar>& f = ws.frame(node.frame + frame);
    add_products(ws.tree().frame_mass(node.frame + frame), f.R, f.r, own, n, G);
  }
}

/// The same, of a type S. Cold, as it is compiled once for each.
template <Scene scene, class S, class Data>
[[gnu::cold]] void add_share(const Node& node, const S& s, const NodeState<S>& state, Data& ws, int n, typename S::Scalar* G)
{
  using Scalar = typename S::Scalar;
  if constexpr (is_free<S>()) {  // stays where it is
    std::fill_n(motions_of(node.frame, n, ws), 6 * n, Scalar(0));
  } else {
    std::array<Scalar, 6 * std::max(1, S::n_i)> qdd;
    const MovedBy<Scalar> part{state.R, state.r, state.S_k[0].data(), state.W.data(), S::n_i, S::n_frames};
    constexpr int n_rotors = rotor_count<S>(), n_spinning = n_rotors + (scene.implicit ? spring_count<S>() : 0);
    if constexpr (n_spinning == 0) {
      add_share_of(node, part, static_cast<const Spinning<Scalar>*>(nullptr), 0, ws, n, G, qdd.data());
    } else {
      std::array<SpunRotor<S>, static_cast<std::size_t>(n_rotors)> spun;
      std::array<Spinning<Scalar>, static_cast<std::size_t>(n_spinning)> spinning;
      if constexpr (n_rotors > 0) {
        const auto rotors = s.rotors();
        for (std::size_t k = 0; k < spun.size(); ++k) {
          spun[k] = spin_rotor<Scene{.velocity = false}>(node, rotors[k], state, ws);
          spinning[k] = {spun[k].J, spun[k].a, spun[k].e.data()};
        }
      }
      if constexpr (scene.implicit) {
        for (std::size_t k = 0; k < state.springs.size(); ++k) {
          spinning[spun.size() + k] = {state.springs[k].inertia, Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(0)),
                                       state.springs[k].ratio.data()};
        }
      }
      add_share_of(node, part, spinning.data(), n_spinning, ws, n, G, qdd.data());
    }
  }
}

/// Whether the steps of S do so: of a joint that moves one frame along one unit column, turning it or sliding, without springs of
/// its own (an implicit step adds their inertia to D).
template <class S, class Data>
constexpr bool mends_pivots()
{
  if constexpr (Data::update == Update::projected && !bodies_first<typename S::Scalar>) {
    return has_own_twist<S>() && spring_count<S>() == 0 && S::pattern.linear != S::pattern.angular;
  }
  return false;
}

/// S in all six rows.
template <class S>
Vector6<typename S::Scalar> unit_column(const NodeState<S>& state)
{
  using Scalar = typename S::Scalar;
  Vector6<Scalar> column;
  for (int i = 0; i < 6; ++i) { column(i) = (i < 3 ? S::pattern.linear : S::pattern.angular) ? state.S_k[0](i, 0) : Scalar(0); }
  return column;
}

/// D of a pivot D that is small against `scale`, if it is one of those above; else 0. (By value: what a function that is not
/// inlined may write to would not stay in registers.)
template <class S, class Data>
[[gnu::noinline]] typename S::Scalar mended_pivot(const Node& node, const NodeState<S>& state,
                                  const std::array<SpunRotor<S>, static_cast<std::size_t>(rotor_count<S>())>& spun,
                                  const typename S::Scalar scale, const SumBeyond<typename S::Scalar>& sum_beyond, Data& ws,
                                  const typename S::Scalar D)
{
  using Scalar = typename S::Scalar;
  constexpr Index most_subsystems = 32;  // what is summed takes as long as the step of one joint for every two
  const Scalar least(1.0 / 512);         // of scale
  const Index beyond = node.subtree_end - node.index - 1;
  FrameState<Scalar>& f = ws.frame(node.frame);
  if (beyond == 0 || beyond > most_subsystems || f.loses || ws.axes().of(node.frame) != nullptr) { return Scalar(0); }
  if (!ScalarTraits<Scalar>::is_positive(D - least * scale)) { return Scalar(0); }
  // What the roundings of this pivot would be in M⁻¹, against the larger parts of it.
  if (!ScalarTraits<Scalar>::is_positive(scale - Scalar(2) * D * D * sum_beyond.largest)) { return Scalar(0); }
  for (const SpunRotor<S>& rotor : spun) {  // A' S = 0 is for joints without inertia of their own
    if (!(rotor.J == Scalar(0))) { return Scalar(0); }
  }
  f.Vdot = unit_column(state);
  Scalar sum = state.own.D;
  sum_beyond.add(sum_beyond.pass, node, 1, &sum);
  return sum;
}

/// A' of such a pivot.
template <class Scalar>
[[gnu::noinline]] SpatialInertia<Scalar> across(SpatialInertia<Scalar> A, const Vector6<Scalar>& S, TriplePair<Scalar> U,
                                                TriplePair<Scalar> W)
{
  Matrix6<Scalar> T = A.dense();
  for (int j = 0; j < 6; ++j) {
    for (int i = 0; i < 6; ++i) { T(i, j) -= Scalar(0.5) * (U(i) * W(j) + W(i) * U(j)); }
  }
  // E T E = T − S xᵀ − x Sᵀ, x = T S − ½ (Sᵀ T S) S
  Vector6<Scalar> x;
  Scalar twice(0);
  for (int i = 0; i < 6; ++i) {
    x(i) = Scalar(0);
    for (int j = 0; j < 6; ++j) { x(i) += T(i, j) * S(j); }
    twice += S(i) * x(i);
  }
  for (int i = 0; i < 6; ++i) { x(i) -= Scalar(0.5) * twice * S(i); }
  SpatialInertia<Scalar> result;
  for (int j = 0; j < 3; ++j) {
    for (int i = 0; i < 3; ++i) {
      result.M(i, j) = T(i, j) - (S(i) * x(j) + x(i) * S(j));
      result.H(i, j) = T(i, j + 3) - (S(i) * x(j + 3) + x(i) * S(j + 3));
      result.J(i, j) = T(i + 3, j + 3) - (S(i + 3) * x(j + 3) + x(i + 3) * S(j + 3));
    }
  }
  return result;
}

/// C_T of a free base to C_T L⁻ᵀ, L Lᵀ = G, of the motions C = T C_T. By the roundings of A_T, ε·scale, and by those
/// of the motions, ε·a·√size, of inertias `size` that these meet, each entry of G is taken from the sums or left as it is: along the
/// axis of the limb's first joint, where A_T is made of what is held, it is better than they are.
template <class Scalar, class Data>
[[gnu::cold, gnu::noinline]] void mend_root(const Node& node, const FrameMass<Scalar>& body, const Matrix6<Scalar>& T,
                                 const Vector6<Scalar>& scale, const Vector6<Scalar>& size,
                                 const SumBeyond<Scalar>& sum_beyond, Data& ws, Matrix6<Scalar>& C_T)
{
  using std::max;
  using std::sqrt;
  const auto abs = [](const Scalar& x) { return ScalarTraits<Scalar>::is_positive(x) ? x : Scalar(-x); };
  const FrameState<Scalar>& f = ws.frame(node.frame);
  Matrix6<Scalar> a = Matrix6<Scalar>::Zero();
  for (int k = 0; k < 6; ++k) {
    for (int j = 0; j <= k; ++j) {
      for (int i = 0; i < 6; ++i) { a(i, k) += T(i, j) * C_T(j, k); }
    }
  }
  Matrix6<Scalar> G = Matrix6<Scalar>::Zero();
  add_products(body, f.R, f.r, a.data(), 6, G.data());
  if (const auto* axes = ws.axes().of(node.frame)) { turn_triples(*axes, true, a.data(), 12); }
  ws.motions(node.frame) = a;
  sum_beyond.add(sum_beyond.pass, node, 6, G.data());
  Vector6<Scalar> of_motions;
  for (int k = 0; k < 6; ++k) {
    of_motions(k) = Scalar(0);
    for (int i = 0; i <= k; ++i) { of_motions(k) += abs(C_T(i, k)) * sqrt(size(i)); }
    for (int j = 0; j <= k; ++j) {
      Scalar of_A(0);
      for (int i = 0; i <= j; ++i) { of_A += abs(C_T(i, j) * C_T(i, k)) * scale(i); }
      if (!(Scalar(4) * of_A > max(of_motions(j), of_motions(k)))) { G(j, k) = Scalar(j == k ? 1 : 0); }
    }
  }
  Matrix6<Scalar> L;
  for (int k = 0; k < 6; ++k) {
    for (int j = 0; j <= k; ++j) {
      Scalar left = G(j, k);
      for (int i = 0; i < j; ++i) { left -= L(k, i) * L(j, i); }
      if (j < k) {
        L(k, j) = left / L(j, j);
      } else {
        if (!ScalarTraits<Scalar>::is_positive(left)) { return; }
        L(k, k) = sqrt(left);
      }
    }
  }
  for (int k = 0; k < 6; ++k) {
    for (int i = 0; i <= k; ++i) {
      for (int j = i; j < k; ++j) { C_T(i, k) -= L(k, j) * C_T(i, j); }
      C_T(i, k) /= L(k, k);
    }
  }
}

}  // namespace iim::detail
