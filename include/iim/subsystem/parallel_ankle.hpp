// Ankle with two degrees of freedom, turned by two motors through cranks and push-rods.
#pragma once

#include <iim/subsystem/compound.hpp>
#include <iim/subsystem/loop.hpp>
#include <iim/subsystem/motor_arm.hpp>

#include <array>
#include <cmath>
#include <cstddef>
#include <string>

namespace iim {

/// One motor of a ParallelAnkle with its crank and rod. Inlet axes and origin, unless said otherwise.
template <class Scalar_>
struct PushRod {
  using Scalar = Scalar_;
  Vector3<Scalar> hinge = Vector3<Scalar>::Zero();  ///< centre of the crank's circle [m]
  Vector3<Scalar> axis = Vector3<Scalar>::UnitY();  ///< of crank and rotor, unit vector
  /// Hinge to rod for a crank angle of 0, perpendicular to the axis [m].
  Vector3<Scalar> crank = Vector3<Scalar>::UnitX();
  Vector3<Scalar> foot = Vector3<Scalar>::Zero();  ///< where the rod ends, in the foot's frame [m]
  Scalar rod = Scalar(1);                          ///< length [m]
  Scalar side = Scalar(1);        ///< of the two crank angles, that with ∂rod/∂angle > 0 (1) or < 0 (−1)
  Scalar rod_mass = Scalar(0);    ///< uniform and slender [kg]
  Scalar gear_ratio = Scalar(1);  ///< rotor rate per crank rate
  /// About the axis [kg m²], a disc's: half of it about the others; its mass: the shank's.
  Scalar rotor_inertia = Scalar(0);
};

/// Foot on a universal joint at the coupling point (first axis fixed in the inlet, the shank), held by two push-rods.
/// q: angles about the two axes [rad]; each crank's angle follows in closed form. Inputs: torques of the motors on
/// their rotors, B̄_i = (0; gear ratio · ∂crank/∂q). A dead centre, where a rod is in line with its crank, is refused.
///
/// Frames: 0 foot; 1, 2 cranks (origins at the hinges, the inlet's axes turned by the crank angle); 3, 4 rotors,
/// turned by gear ratio times a crank angle within ±π, where what hangs on a rotor jumps if the ratio is no whole
/// number; 5, 6 middles of the rods, which do not turn. A uniform slender rod is m/6, 2m/3, m/6 at its ends and middle:
/// the same mass, centre and kinetic energy, and no spin about its own length, which the mechanism leaves undefined.
template <class Scalar_>
struct ParallelAnkleLinkage {
  using Scalar = Scalar_;
  static constexpr int n_i = 2;
  static constexpr int n_u = 2;
  static constexpr int n_frames = 7;
  using Coordinates = Eigen::Matrix<Scalar, 2, 1>;
  using D = Dependent<Scalar, 2>;

  Vector3<Scalar> first = Vector3<Scalar>::UnitY();   ///< unit vector in inlet axes
  Vector3<Scalar> second = Vector3<Scalar>::UnitX();  ///< unit vector in inlet axes for q = 0
  std::array<PushRod<Scalar>, 2> rod{};

  void prepare(const std::string& owner)
  {
    using std::abs;
    first = detail::UnitAxis<Scalar>(first, owner + ": first").direction;
    second = detail::UnitAxis<Scalar>(second, owner + ": second").direction;
    detail::check_two_axes(first, second, owner);
    for (std::size_t k = 0; k < 2; ++k) {
      const std::string name = owner + ": push-rod " + std::to_string(k);
      PushRod<Scalar>& r = rod[k];
      r.axis = detail::UnitAxis<Scalar>(r.axis, name).direction;
      detail::check_length(r.rod, name + ": rod");
      const Scalar length = r.crank.norm();
      detail::check_length(length, name + ": crank");
      if (!(abs(r.axis.dot(r.crank)) < Scalar(1e-6) * length)) {
        detail::refuse({name, ": crank must be perpendicular to its axis, got ", detail::to_text(r.crank), " and ",
                        detail::to_text(r.axis)});
      }
      detail::check_side(r.side, name);
      if (!detail::all_finite(r.hinge) || !detail::all_finite(r.foot) || !detail::is_finite(r.gear_ratio)) {
        detail::refuse({name, ": hinge, foot and gear ratio must be finite"});
      }
      for (const Scalar& x : {r.rod_mass, r.rotor_inertia}) {
        if (!(x >= Scalar(0)) || !detail::is_finite(x)) {
          detail::refuse(
              {name, ": rod mass and rotor inertia must be finite and not negative, got ", detail::to_text(x)});
        }
      }
    }
  }

  bool place(const std::array<D, 2>& q, std::array<RelativeMotion<Scalar, 2>, 7>& frames) const
  {
    frames[0] = foot(q);
    bool reached = true;
    for (std::size_t k = 0; k < 2; ++k) {
      const PushRod<Scalar>& r = rod[k];
      const RelativeMotion<Scalar, 2> end = frames[0].at(r.foot);
      D angle;
      reached = crank_angle(r, end, angle) && reached;
      const RelativeMotion<Scalar, 2> hinge = RelativeMotion<Scalar, 2>{}.at(r.hinge);
      frames[k + 1] = hinge.turned(r.axis, angle);
      frames[k + 3] = hinge.turned(r.axis, angle * D(r.gear_ratio));
      const RelativeMotion<Scalar, 2> pin = frames[k + 1].at(r.crank);
      RelativeMotion<Scalar, 2>& middle = frames[k + 5];
      middle = {};
      middle.p = (pin.p + end.p) / Scalar(2);
      middle.v = (pin.v + end.v) / Scalar(2);
      middle.velocity = (pin.velocity + end.velocity) / Scalar(2);
      middle.a = (pin.a + end.a) / Scalar(2);
    }
    return reached;
  }

  /// Angles of the cranks [rad].
  std::array<D, 2> cranks(const std::array<D, 2>& q) const
  {
    const RelativeMotion<Scalar, 2> at = foot(q);
    std::array<D, 2> angle;
    for (std::size_t k = 0; k < 2; ++k) { crank_angle(rod[k], at.at(rod[k].foot), angle[k]); }
    return angle;
  }

  std::array<CarriedBody<Scalar>, 8> own_bodies() const
  {
    std::array<CarriedBody<Scalar>, 8> all;
    for (std::size_t k = 0; k < 2; ++k) {
      const PushRod<Scalar>& r = rod[k];
      const int at = static_cast<int>(k);
      all[4 * k] = {0, point(r.rod_mass / Scalar(6), r.foot)};
      all[4 * k + 1] = {at + 1, point(r.rod_mass / Scalar(6), r.crank)};
      all[4 * k + 2] = {at + 5, point(r.rod_mass * Scalar(2) / Scalar(3), Vector3<Scalar>::Zero())};
      Body<Scalar> rotor = Body<Scalar>::massless();
      if (r.rotor_inertia > Scalar(0)) {
        rotor.is_massless = false;
        rotor.inertia = r.rotor_inertia / Scalar(2) * (Matrix3<Scalar>::Identity() + r.axis * r.axis.transpose());
      }
      all[4 * k + 3] = {at + 3, rotor};
    }
    return all;
  }

  Eigen::Matrix<Scalar, 2, 2> Bbar(const Coordinates& q) const
  {
    const std::array<D, 2> angle = cranks(independent<Scalar, 2>(q, Coordinates::Zero()));
    Eigen::Matrix<Scalar, 2, 2> B;
    for (int k = 0; k < 2; ++k) {
      const auto at = static_cast<std::size_t>(k);
      B.col(k) = rod[at].gear_ratio * angle[at].gradient.transpose();
    }
    return B;
  }

  template <class T>
  ParallelAnkleLinkage<T> cast() const
  {
    ParallelAnkleLinkage<T> other{first.template cast<T>(), second.template cast<T>(), {}};
    for (std::size_t k = 0; k < 2; ++k) {
      const PushRod<Scalar>& r = rod[k];
      other.rod[k] = {r.hinge.template cast<T>(),
                      r.axis.template cast<T>(),
                      r.crank.template cast<T>(),
                      r.foot.template cast<T>(),
                      T(r.rod),
                      T(r.side),
                      T(r.rod_mass),
                      T(r.gear_ratio),
                      T(r.rotor_inertia)};
    }
    return other;
  }

private:
  RelativeMotion<Scalar, 2> foot(const std::array<D, 2>& q) const
  {
    return RelativeMotion<Scalar, 2>{}.turned(first, q[0]).turned(second, q[1]);
  }

  static Body<Scalar> point(const Scalar& mass, const Vector3<Scalar>& at)
  {
    if (!(mass > Scalar(0))) { return Body<Scalar>::massless(); }
    return {mass, at, Matrix3<Scalar>::Zero(), false};
  }

  /// |e − c(θ)| = rod with e the rod's end seen from the hinge: X cos θ + Y sin θ = Z.
  bool crank_angle(const PushRod<Scalar>& r, const RelativeMotion<Scalar, 2>& end, D& angle) const
  {
    const Vector3<Scalar> across = detail::cross(r.axis, r.crank);
    const D x = end.along(r.crank, r.hinge), y = end.along(across, r.hinge), z = end.along(r.axis, r.hinge);
    const Scalar length2 = r.crank.squaredNorm();
    const D e2 = (x * x + y * y) / D(length2) + z * z;
    const D Z = (e2 + D(length2 - r.rod * r.rod)) * D(Scalar(0.5));
    const D amplitude2 = x * x + y * y;
    D square = amplitude2 - Z * Z;
    const Scalar least = detail::dead_centre<Scalar>();
    const bool reached = ScalarTraits<Scalar>::is_positive(square.value - least * least * amplitude2.value);
    if (!reached) { square = D(Scalar(1)); }
    // ½ d(rod²)/dθ = X sin θ − Y cos θ = root
    const D root = sqrt(square) * D(r.side);
    angle = atan2(y * Z + x * root, x * Z - y * root);
    return reached;
  }
};

template <class Scalar>
using ParallelAnkle = Compound<ParallelAnkleLinkage<Scalar>>;

static_assert(Subsystem<ParallelAnkle<double>>);

}  // namespace iim
