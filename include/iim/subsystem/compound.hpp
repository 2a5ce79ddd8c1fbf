// Compound: several rigid bodies on one set of internal coordinates.
#pragma once

#include <iim/body.hpp>
#include <iim/errors.hpp>
#include <iim/subsystem.hpp>
#include <iim/subsystem/joint.hpp>
#include <iim/subsystem/relative_motion.hpp>

#include <array>
#include <concepts>
#include <cstddef>
#include <string>
#include <tuple>
#include <type_traits>
#include <utility>

namespace iim {

/// How the frames of a compound move: what an author writes for a pan-tilt head, a wrist, a linkage.
template <class T>
concept Mechanism =
    requires(const T m, T mutable_m, const std::string owner,
             const std::array<Dependent<typename T::Scalar, T::n_i>, static_cast<std::size_t>(T::n_i)> q,
             std::array<RelativeMotion<typename T::Scalar, T::n_i>, static_cast<std::size_t>(T::n_frames)> frames) {
      requires T::n_i >= 1 && T::n_frames >= 1;
      // Places all frames, given at the coupling point in inlet axes. False: no such configuration.
      { m.place(q, frames) } -> std::same_as<bool>;
      // Throws ModelError naming `owner` if the parameters are wrong.
      mutable_m.prepare(owner);
      // Optional: `n_u` and `Bbar(q)`, else the inputs are the generalised forces on q̇_i; `rotors()`;
      // `internal_force(q, qd)`, `springs(q, qd)`, `potential(q)`, `dissipation(q, qd)`; `own_bodies()`, a std::array
      // of CarriedBody beside those of the compound.
    };

namespace detail {

template <class Mechanism>
constexpr int mechanism_inputs()
{
  if constexpr (requires { Mechanism::n_u; }) { return Mechanism::n_u; }
  return Mechanism::n_i;
}

template <class Mechanism>
constexpr std::size_t own_body_count()
{
  if constexpr (requires(const Mechanism m) { m.own_bodies(); }) {
    return std::tuple_size_v<std::remove_cvref_t<decltype(std::declval<const Mechanism&>().own_bodies())>>;
  }
  return 0;
}

}  // namespace detail

/// Bodies on the frames of a mechanism. Outlets are the mechanism's frames, in its order.
template <Mechanism M>
struct Compound {
  using Scalar = typename M::Scalar;
  static constexpr int n_q = M::n_i;
  static constexpr int n_i = M::n_i;
  static constexpr int n_u = detail::mechanism_inputs<M>();
  static constexpr int n_frames = M::n_frames;
  static constexpr MotionPattern pattern{};
  using Coordinates = Eigen::Matrix<Scalar, n_i, 1>;

  M mechanism{};
  /// Of each frame; massless if not set.
  std::array<Body<Scalar>, static_cast<std::size_t>(n_frames)> body = nothing();

  void prepare(const std::string& name)
  {
    mechanism.prepare(name);
    for (int k = 0; k < n_frames; ++k) {
      validate(body[static_cast<std::size_t>(k)], name + ", frame " + std::to_string(k));
    }
  }

  bool motion(const Matrix3<Scalar>& R, const Coordinates& q, const Coordinates& qd,
              std::array<FrameMotion<Scalar, n_i>, static_cast<std::size_t>(n_frames)>& frames) const
  {
    std::array<RelativeMotion<Scalar, n_i>, static_cast<std::size_t>(n_frames)> placed;
    const bool reached = mechanism.place(independent<Scalar, n_i>(q, qd), placed);
    for (std::size_t k = 0; k < placed.size(); ++k) { placed[k].write(R, frames[k]); }
    return reached;
  }

  std::array<CarriedBody<Scalar>, static_cast<std::size_t>(n_frames) + detail::own_body_count<M>()> bodies() const
  {
    std::array<CarriedBody<Scalar>, static_cast<std::size_t>(n_frames) + detail::own_body_count<M>()> all;
    std::size_t at = 0;
    for (; at < body.size(); ++at) { all[at] = {static_cast<int>(at), body[at]}; }
    if constexpr (detail::own_body_count<M>() > 0) {
      for (const CarriedBody<Scalar>& carried : mechanism.own_bodies()) { all[at++] = carried; }
    }
    return all;
  }

  Eigen::Matrix<Scalar, n_i, n_u> Bbar(const Coordinates& q) const
  {
    if constexpr (requires { mechanism.Bbar(q); }) {
      return mechanism.Bbar(q);
    } else {
      return Eigen::Matrix<Scalar, n_i, n_u>::Identity();
    }
  }

  auto rotors() const
    requires requires(const M m) { m.rotors(); }
  {
    return mechanism.rotors();
  }

  Coordinates internal_force(const Coordinates& q, const Coordinates& qd) const
    requires requires(const M m, Coordinates x) { m.internal_force(x, x); }
  {
    return mechanism.internal_force(q, qd);
  }

  auto springs(const Coordinates& q, const Coordinates& qd) const
    requires requires(const M m, Coordinates x) { m.springs(x, x); }
  {
    return mechanism.springs(q, qd);
  }

  Scalar potential(const Coordinates& q) const
    requires requires(const M m, Coordinates x) { m.potential(x); }
  {
    return mechanism.potential(q);
  }

  Scalar dissipation(const Coordinates& q, const Coordinates& qd) const
    requires requires(const M m, Coordinates x) { m.dissipation(x, x); }
  {
    return mechanism.dissipation(q, qd);
  }

  template <class T>
  auto cast() const
  {
    Compound<decltype(mechanism.template cast<T>())> other;
    other.mechanism = mechanism.template cast<T>();
    for (std::size_t k = 0; k < body.size(); ++k) { other.body[k] = body[k].template cast<T>(); }
    return other;
  }

private:
  static auto nothing()
  {
    std::array<Body<Scalar>, static_cast<std::size_t>(n_frames)> all;
    all.fill(Body<Scalar>::massless());
    return all;
  }
};

/// Hinges in a row: frame 0 turns about axis 0 at the coupling point, frame k about axis k at `offset[k]` in frame
/// k − 1. q: relative angles [rad]. Two of them are a pan-tilt head or an arm of two links, three a wrist.
template <class Scalar_, int n>
struct HingeRow {
  using Scalar = Scalar_;
  static constexpr int n_i = n;
  static constexpr int n_frames = n;
  static constexpr auto count = static_cast<std::size_t>(n);

  /// Unit vectors, in the axes of the frame before.
  std::array<Vector3<Scalar>, count> axis = all(Vector3<Scalar>::UnitZ());
  /// Of the hinges, in the frame before [m]; offset[0] is not read.
  std::array<Vector3<Scalar>, count> offset = all(Vector3<Scalar>::Zero());

  void prepare(const std::string& owner)
  {
    for (std::size_t k = 0; k < count; ++k) {
      axis[k] = detail::UnitAxis<Scalar>(axis[k], owner + ": hinge " + std::to_string(k)).direction;
      if (k > 0 && !detail::all_finite(offset[k])) {
        detail::refuse(
            {owner, ": offset of hinge ", std::to_string(k), " must be finite, got ", detail::to_text(offset[k])});
      }
    }
  }

  bool place(const std::array<Dependent<Scalar, n>, count>& q,
             std::array<RelativeMotion<Scalar, n>, count>& frames) const
  {
    frames[0] = RelativeMotion<Scalar, n>{}.turned(axis[0], q[0]);
    for (std::size_t k = 1; k < count; ++k) { frames[k] = frames[k - 1].at(offset[k]).turned(axis[k], q[k]); }
    return true;
  }

  template <class T>
  HingeRow<T, n> cast() const
  {
    HingeRow<T, n> other;
    for (std::size_t k = 0; k < count; ++k) {
      other.axis[k] = axis[k].template cast<T>();
      other.offset[k] = offset[k].template cast<T>();
    }
    return other;
  }

private:
  static std::array<Vector3<Scalar>, count> all(const Vector3<Scalar>& value)
  {
    std::array<Vector3<Scalar>, count> values;
    values.fill(value);
    return values;
  }
};

template <class Scalar>
using PanTilt = Compound<HingeRow<Scalar, 2>>;
template <class Scalar>
using Wrist = Compound<HingeRow<Scalar, 3>>;

static_assert(Subsystem<PanTilt<double>>);

}  // namespace iim
