// Slider-crank, and a lever driven by a linear actuator.
#pragma once

#include <iim/subsystem/compound.hpp>
#include <iim/subsystem/loop.hpp>

#include <array>
#include <cmath>
#include <string>

namespace iim {

/// Crank at the coupling point A, rod from B on it to a slider on a guide parallel to the plane's x. q: angle of the
/// crank from x [rad]; closed form. Frames: 0 crank (origin A), 1 rod (origin B), both with their x along the bar; 2
/// slider (origin at the rod's end C), not turned.
template <class Scalar_>
struct SliderCrankLinkage {
  using Scalar = Scalar_;
  static constexpr int n_i = 1;
  static constexpr int n_frames = 3;

  Plane<Scalar> plane{};
  Scalar crank = Scalar(1);   ///< A to B [m]
  Scalar rod = Scalar(2);     ///< B to C [m]
  Scalar offset = Scalar(0);  ///< of the guide along the plane's y [m]
  Scalar side = Scalar(1);    ///< the slider is ahead of B (1) or behind it (−1)

  void prepare(const std::string& owner)
  {
    plane.prepare(owner);
    detail::check_length(crank, owner + ": crank");
    detail::check_length(rod, owner + ": rod");
    if (!detail::is_finite(offset)) {
      detail::refuse({owner, ": offset must be finite, got ", detail::to_text(offset)});
    }
    using std::abs;
    if (!(abs(offset) < crank + rod)) {
      detail::refuse({owner, ": crank and rod do not reach the guide, which is ", detail::to_text(offset), " m away"});
    }
    detail::check_side(side, owner);
  }

  bool place(const std::array<Dependent<Scalar, 1>, 1>& q, std::array<RelativeMotion<Scalar, 1>, 3>& frames) const
  {
    using D = Dependent<Scalar, 1>;
    const PlanePoint<Scalar, 1> B{cos(q[0]) * D(crank), sin(q[0]) * D(crank)};
    const D rise = D(offset) - B.y;
    D square = D(rod * rod) - rise * rise;
    const Scalar least = detail::dead_centre<Scalar>() * rod;
    const bool reached = ScalarTraits<Scalar>::is_positive(square.value - least * least);
    if (!reached) { square = D(rod * rod); }
    const D reach = sqrt(square) * D(side);
    frames[0] = RelativeMotion<Scalar, 1>{}.turned(plane.normal, q[0]);
    frames[1] = plane.at(B).turned(plane.normal, atan2(rise, reach));
    frames[2] = plane.at(PlanePoint<Scalar, 1>{B.x + reach, D(offset)});
    return reached;
  }

  template <class T>
  SliderCrankLinkage<T> cast() const
  {
    return {plane.template cast<T>(), T(crank), T(rod), T(offset), T(side)};
  }
};

/// Lever on a hinge at the coupling point, turned by a linear actuator (screw, cylinder) between a pivot D on the inlet
/// and a pin C on the lever: a knee or ankle. q: angle of the lever [rad]; closed form. Input: torque of the motor on
/// the screw, B̄_i = screw·ds/dq with the actuator's length s; with screw = 1 it is the actuator's force.
///
/// Frames: 0 lever, the inlet turned by q; 1 cylinder (origin D) and 2 piston (origin C), x along the actuator towards
/// C; 3 screw (origin D), turned by screw·s relative to the cylinder, which carries the rotor's inertia.
template <class Scalar_>
struct ActuatedLeverLinkage {
  using Scalar = Scalar_;
  static constexpr int n_i = 1;
  static constexpr int n_u = 1;
  static constexpr int n_frames = 4;
  using Coordinates = Eigen::Matrix<Scalar, 1, 1>;
  using Vector2 = Eigen::Matrix<Scalar, 2, 1>;

  Plane<Scalar> plane{};
  Vector2 pivot = Vector2::UnitX();  ///< D in the plane, from the hinge [m]
  Vector2 pin = Vector2::UnitY();    ///< C in the plane for q = 0, from the hinge [m]
  Scalar screw = Scalar(1);          ///< turn of the screw per length [rad/m]

  void prepare(const std::string& owner)
  {
    plane.prepare(owner);
    for (const Vector2* point : {&pivot, &pin}) {
      if (!detail::all_finite(*point) || !(point->norm() > Scalar(0))) {
        detail::refuse({owner, ": pivot and pin must be finite and off the hinge, got ", detail::to_text(*point)});
      }
    }
    if (!detail::is_finite(screw) || screw == Scalar(0)) {
      detail::refuse({owner, ": screw must be finite and not zero, got ", detail::to_text(screw)});
    }
  }

  bool place(const std::array<Dependent<Scalar, 1>, 1>& q, std::array<RelativeMotion<Scalar, 1>, 4>& frames) const
  {
    using D = Dependent<Scalar, 1>;
    const PlanePoint<Scalar, 1> from{D(pivot(0)), D(pivot(1))};
    const PlanePoint<Scalar, 1> C = pin_at(q[0]);
    const PlanePoint<Scalar, 1> way = C - from;
    D square = way.x * way.x + way.y * way.y;
    // The direction is lost where pin and pivot meet.
    const Scalar least = detail::dead_centre<Scalar>();
    const bool apart = ScalarTraits<Scalar>::is_positive(square.value - least * least * pivot.squaredNorm());
    if (!apart) { square = D(Scalar(1)); }
    frames[0] = RelativeMotion<Scalar, 1>{}.turned(plane.normal, q[0]);
    const D direction = atan2(way.y, way.x);
    frames[1] = plane.at(from).turned(plane.normal, direction);
    frames[2] = plane.at(C).turned(plane.normal, direction);
    frames[3] = frames[1].turned(plane.x, sqrt(square) * D(screw));
    return apart;
  }

  /// The actuator's length [m].
  Dependent<Scalar, 1> length(const Dependent<Scalar, 1>& q) const
  {
    const PlanePoint<Scalar, 1> way = pin_at(q) - PlanePoint<Scalar, 1>{pivot(0), pivot(1)};
    return sqrt(way.x * way.x + way.y * way.y);
  }

  Coordinates Bbar(const Coordinates& q) const
  {
    const auto x = independent<Scalar, 1>(q, Coordinates::Zero());
    return Coordinates(screw * length(x[0]).gradient(0));
  }

  template <class T>
  ActuatedLeverLinkage<T> cast() const
  {
    return {plane.template cast<T>(), pivot.template cast<T>(), pin.template cast<T>(), T(screw)};
  }

private:
  PlanePoint<Scalar, 1> pin_at(const Dependent<Scalar, 1>& q) const
  {
    using D = Dependent<Scalar, 1>;
    const D c = cos(q);
    const D s = sin(q);
    return {c * D(pin(0)) - s * D(pin(1)), s * D(pin(0)) + c * D(pin(1))};
  }
};

template <class Scalar>
using SliderCrank = Compound<SliderCrankLinkage<Scalar>>;
template <class Scalar>
using ActuatedLever = Compound<ActuatedLeverLinkage<Scalar>>;

static_assert(Subsystem<SliderCrank<double>>);
static_assert(Subsystem<ActuatedLever<double>>);

}  // namespace iim
