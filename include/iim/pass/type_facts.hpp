// What a workspace has to know of each subsystem's type before the first state, asked once: what follows from it is
// then written, and compiled, for all types together.
#pragma once

#include <iim/body.hpp>
#include <iim/node_state.hpp>
#include <iim/scalar.hpp>
#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>

#include <cmath>

namespace iim::detail {

template <class S>
constexpr bool turns_about_axis()
{
  return has_own_twist<S>() && S::pattern.angular;
}
/// Whether a subsystem may belong to a group of parallel joints (parallel_axes.hpp).
template <class S>
constexpr bool shares_axes()
{
  return S::n_frames == 1 && S::n_i <= 1 && (turns_about_axis<S>() || !S::pattern.angular);
}

/// How many times the moments of a joint's own body, their sum, are what turns about the joint's axis, rotors included;
/// 0 unless it is enough to lose digits by. turning: squared angle per unit of the joint's coordinate.
template <class S, class Scalar>
[[gnu::cold]] Scalar thinness(const S& s, const FrameMass<Scalar>& body, const Scalar& turning)
{
  if (!body.present) { return Scalar(0); }
  Scalar about_axis = OwnColumn<Scalar>(body, s.own_twist()).D;
  if constexpr (rotor_count<S>() > 0) {
    for (const auto& rotor : s.rotors()) { about_axis += rotor.inertia * rotor.ratio(0) * rotor.ratio(0); }
  }
  if (!ScalarTraits<Scalar>::is_positive(about_axis)) { return Scalar(0); }
  const Scalar moments = sum_of_moments(body.inertia) * turning;
  return ScalarTraits<Scalar>::is_positive(moments - Scalar(8) * about_axis) ? Scalar(moments / about_axis) : Scalar(0);
}

/// Of one subsystem.
template <class Scalar>
struct TypeFacts {
  int velocities = 0;
  bool is_free = false, keeps_v = false, turns_about_axis = false, shares_axes = false;
  Vector3<Scalar> axis{Scalar(0), Scalar(0), Scalar(0)};  ///< of length 1 in the frame's axes, where it turns about one
  Scalar turning = Scalar(1);                             ///< if so, angle per unit of its coordinate
  Scalar thinness = Scalar(0);
};
/// body: on its first frame.
template <class S, class Scalar>
[[gnu::cold]] TypeFacts<Scalar> facts_of(const S& s, const FrameMass<Scalar>& body)
{
  TypeFacts<Scalar> facts{S::n_i, is_free<S>(), keeps_v<S>, turns_about_axis<S>(), shares_axes<S>()};
  if constexpr (turns_about_axis<S>()) {
    using std::sqrt;
    const Vector3<Scalar> turning = angular(s.own_twist());
    const Scalar square = turning.squaredNorm();
    facts.turns_about_axis = ScalarTraits<Scalar>::is_positive(square);
    if (facts.turns_about_axis) {
      facts.turning = sqrt(square);
      facts.axis = turning * Scalar(Scalar(1) / facts.turning);
      facts.thinness = thinness(s, body, square);
    }
  }
  return facts;
}

}  // namespace iim::detail
