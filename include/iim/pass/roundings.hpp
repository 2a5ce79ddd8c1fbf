// How large the roundings of an inertia are: what its pivots are told from zero by.
//
// A frame's A, reduced joint by joint from larger ones, differs from the exact one by E ≈ ε (diag(size) + loss lossᵀ).
// `size`: the largest that stood on its diagonal; along each axis for itself, since what a chain in a plane weighs
// across that plane does not round what is in it. `loss`: a pivot D with roundings ε·scale, scale > D, leaves A' = A −
// UᵀU/D wrong by ε·scale W Wᵀ, more than ε A, and the next pivots with it. Both go inward as A does,
//
//     E' = Pᵀ E P, P = 1 − S W:      loss' = loss − W (S·loss)  or  √scale (W − S/|S|²), the larger,
//
// both zero along S, as A' is: axes that nearly coincide lose nothing by the second. Frames without loss
// (FrameState::loses) pay nothing for it. (With one flag for the whole tree and both kinds of loss at each joint, the
// pass of chains took a fourth longer, with lanes half as long again.)
#pragma once

#include <iim/node_state.hpp>
#include <iim/pass/articulated_inertia.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

namespace iim::detail {

/// scale += Sᵀ diag(size) S, its diagonal.
template <MotionPattern pattern, class Scalar, int n>
[[gnu::always_inline]] inline void add_scale(const TriplePair<Scalar>& size, const Eigen::Matrix<Scalar, 6, n>& S,
                                             Eigen::Matrix<Scalar, n, 1>& scale)
{
#pragma GCC unroll 8
  for (int d = 0; d < n; ++d) {
    const Scalar* column = S.data() + 6 * d;
    if constexpr (pattern.linear) {
      const auto s = Triple<Scalar>::settled(column);
      scale(d) += dot(s * s, size.linear);
    }
    if constexpr (pattern.angular) {
      const auto s = Triple<Scalar>::settled(column + 3);
      scale(d) += dot(s * s, size.angular);
    }
  }
}

/// Whether a pivot leaves so little of `scale` that its own roundings are counted behind it, or that it is mended: less
/// than an eighth; of several states, which wait for the one that needs it, a twelfth. (From 1/4 on, one more of 1600
/// wrong results under loads is refused in float, and a chain of 50 takes 7 % longer. Several states from 1/8 on:
/// chains of boxes take 5 % longer, B̂ of 4800 states of an arm has up to 8 ε, too; from 1/16 on 5 % less, 11 ε. One
/// state from 1/16 on: chains of skew joints over 16 ε twice as often.)
template <class Scalar, int n>
[[gnu::always_inline]] inline bool loses(const Eigen::Matrix<Scalar, n, n>& D, const Eigen::Matrix<Scalar, n, 1>& scale)
{
  constexpr double least = is_several<Scalar> ? 1.0 / 12 : 1.0 / 8;
  bool strong = true;
#pragma GCC unroll 8
  for (int d = 0; d < n; ++d) { strong &= ScalarTraits<Scalar>::is_positive(D(d, d) - Scalar(least) * scale(d)); }
  return !strong;
}

/// Sᵀ loss of the frames that have any.
template <class S>
[[gnu::noinline]] Velocities<S> along_loss(const FrameState<typename S::Scalar>* frames, const NodeMemory<S>& state)
{
  Velocities<S> along = Velocities<S>::Zero();
  for (int k = 0; k < S::n_frames; ++k) {
    if (!frames[k].loses) { continue; }
    for (int d = 0; d < S::n_i; ++d) {
      along(d) += column_dot<S::pattern>(state.S_k[static_cast<std::size_t>(k)], d, frames[k].inertia().loss);
    }
  }
  return along;
}

/// |x|; of NaN NaN.
template <class Scalar>
Scalar magnitude(const Scalar& x)
{
  return ScalarTraits<Scalar>::is_positive(x) ? x : Scalar(-x);
}
template <class Scalar>
Scalar largest_of(const Triple<Scalar>& x)
{
  return larger(magnitude(x(0)), larger(magnitude(x(1)), magnitude(x(2))));
}
template <class Scalar>
Scalar largest_of(const TriplePair<Scalar>& x)
{
  return larger(largest_of(x.linear), largest_of(x.angular));
}

/// a > b ? x : y. Lanes, which compare all or none, have their own.
template <class Scalar>
[[gnu::always_inline]] inline Scalar if_greater(const Scalar& a, const Scalar& b, const Scalar& x, const Scalar& y)
{
  return a > b ? x : y;
}

/// Row d of W.
template <class S>
TriplePair<typename S::Scalar> gain(const NodeMemory<S>& state, int d)
{
  const auto& W = state.W;
  return {{W(d, 0), W(d, 1), W(d, 2)}, {W(d, 3), W(d, 4), W(d, 5)}};
}

/// Loss, at the inlet's point.
template <class Scalar>
void add_loss(TriplePair<Scalar> loss, const Vector3<Scalar>& r, FrameState<Scalar>& inlet)
{
  loss.angular += cross(triple(r), loss.linear);
  if (inlet.loses) { loss += inlet.inertia().loss; }
  inlet.inertia().loss = loss;
  inlet.loses = true;
}

/// What is left of loss, or what weak pivots leave, to the inlet. scale: of D's roundings by those of A; along: Sᵀ
/// loss.
template <class S>
[[gnu::noinline]] void pass_loss(const FrameState<typename S::Scalar>* frames, const NodeMemory<S>& state,
                                 const Velocities<S>& scale, const Velocities<S>& along, bool weak,
                                 FrameState<typename S::Scalar>& inlet)
{
  using Scalar = typename S::Scalar;
  using std::max;
  using std::sqrt;
  const Triple<Scalar> zero(Scalar(0), Scalar(0), Scalar(0));
  TriplePair<Scalar> loss(zero, zero);
  for (int k = 0; k < S::n_frames; ++k) {
    if (frames[k].loses) { loss += frames[k].inertia().loss; }
  }
  for (int d = 0; d < S::n_i; ++d) { loss -= gain(state, d) * along(d); }
  if (weak) {
    TriplePair<Scalar> fresh(zero, zero);
    for (int d = 0; d < S::n_i; ++d) {
      TriplePair<Scalar> left = gain(state, d);
      const TriplePair<Scalar> s(state.S_k[0].data() + 6 * d);
      if constexpr (has_own_twist<S>() && !(S::pattern.linear && S::pattern.angular)) {
        left -= s;  // of length 1
      } else {
        // A rotor's angle moves no frame: its column of S is zero, and so is its scale.
        const Scalar square =
            max(Scalar(dot(s.linear, s.linear) + dot(s.angular, s.angular)), Scalar(std::numeric_limits<float>::min()));
        left -= s * (Scalar(1) / square);
      }
      fresh += left * sqrt(scale(d));
    }
    const auto squared = [](const TriplePair<Scalar>& a) {
      return dot(a.linear, a.linear) + dot(a.angular, a.angular);
    };
    const Scalar old_square = squared(loss), fresh_square = squared(fresh);
    const auto larger = [&](int i) { return if_greater(fresh_square, old_square, fresh(i), loss(i)); };
    loss = {{larger(0), larger(1), larger(2)}, {larger(3), larger(4), larger(5)}};
  }
  add_loss(loss, state.r, inlet);
}

/// Size, at the inlet's point.
template <class Scalar>
[[gnu::always_inline]] inline void pass_size(const TriplePair<Scalar>& size, const Vector3<Scalar>& r,
                                             FrameState<Scalar>& inlet)
{
  const auto a = Triple<Scalar>::settled(r.data());
  const Triple<Scalar> square = a * a, next = square.turned(), after = next.turned();
  const Triple<Scalar> mass_next = size.linear.turned(), mass_after = mass_next.turned();
  const Triple<Scalar> distant = mass_next * after + mass_after * next;
  TriplePair<Scalar>& there = inlet.inertia().size;
  there.linear = max(there.linear, size.linear);
  there.angular = max(max(there.angular, size.angular), distant);
}

}  // namespace iim::detail
