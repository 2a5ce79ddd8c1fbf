// Motor-arm: a link, its gear, and the motor's rotor with its own axis.
#pragma once

#include <iim/subsystem/joint.hpp>
#include <iim/subsystem/rigid_link.hpp>

#include <array>
#include <string>

namespace iim {

/// The motor of a MotorArm. The housing belongs to the parent's bodies; the rotor, wholly, to the MotorArm.
template <class Scalar_>
struct Motor {
  using Scalar = Scalar_;
  Scalar gear_ratio = Scalar(1);                    ///< rotor rate relative to the housing per joint rate
  Scalar axial_inertia = Scalar(0);                 ///< rotor about its axis [kg m²]
  Vector3<Scalar> axis = Vector3<Scalar>::UnitZ();  ///< rotor axis, unit vector in the axes of its carrier, the inlet
  Scalar mass = Scalar(0);                          ///< of the rotor [kg]; zero: contained in the parent's body
  Vector3<Scalar> com = Vector3<Scalar>::Zero();    ///< of the rotor, on its axis, in the same axes [m]
  Scalar transverse_inertia = Scalar(0);            ///< rotor across its axis, about its centre [kg m²]
  bool armature = false;  ///< true: gear_ratio²·axial_inertia on the joint and no other trace of the rotor's spin

  /// Throws ModelError naming `owner` if no rotor can be so; the axis is a unit vector then.
  [[gnu::cold]] void prepare(const std::string& owner)
  {
    axis = detail::UnitAxis<Scalar>(axis, owner).direction;
    for (const Scalar& x : {axial_inertia, mass, transverse_inertia}) {
      if (!(x >= Scalar(0)) || !detail::is_finite(x)) {
        detail::refuse({owner, ": mass and inertias must be finite and not negative, got ", detail::to_text(x)});
      }
    }
    if (!detail::all_finite(com)) { detail::refuse({owner, ": centre must be finite, got ", detail::to_text(com)}); }
    // A disc has twice its transverse inertia about its axis; no body has more.
    if (mass > Scalar(0) && axial_inertia > Scalar(2 + 1e-6) * transverse_inertia) {
      detail::refuse({owner, ": axial inertia cannot exceed twice the transverse inertia, got ",
                      detail::to_text(axial_inertia), " and ", detail::to_text(transverse_inertia)});
    }
  }

  /// The rotor where it is carried, in the same axes, without the inertia about its own axis; massless without a mass.
  Body<Scalar> body() const
  {
    Body<Scalar> rotor = Body<Scalar>::massless();
    if (mass > Scalar(0)) {
      rotor.is_massless = false;
      rotor.mass = mass;
      rotor.com = com;
      detail::add_point(transverse_inertia, axis, rotor.inertia);
    }
    return rotor;
  }

  template <class T>
  Motor<T> cast() const
  {
    return {T(gear_ratio),         T(axial_inertia), axis.template cast<T>(), T(mass), com.template cast<T>(),
            T(transverse_inertia), armature};
  }
};

/// Link and geared motor (the paper's motor-arm). q, q̇: of the joint. Input: torque of the motor on the rotor, so
/// that B̄_i = (0; 0; gear_ratio).
///
/// The rotor is carried by the inlet and spins at gear_ratio·q̇ about its own axis a. With J its axial inertia it adds
///     M̄_i += J gᵀg,   g = (0, aᵀ, gear_ratio);      h̄_i += (0; ω_o × J (a·ω_o + gear_ratio q̇) a; 0)
/// and, if it has a mass of its own, that of a body on the inlet. The inertia J a aᵀ of the locked rotor is thus part
/// of the MotorArm; a parent body that contains it already must give it up (`without_rotor`).
template <class Joint>
struct MotorArmOn {
  using Scalar = typename Joint::Scalar;
  static_assert(Joint::n_i == 1, "a MotorArm drives a joint with one velocity");
  static constexpr int n_q = 1;
  static constexpr int n_i = 1;
  static constexpr int n_u = 1;
  static constexpr int n_frames = 1;
  static constexpr MotionPattern pattern = Joint::pattern.about_coupling_point();

  Joint joint{};
  Body<Scalar> body{};
  Motor<Scalar> motor{};

  [[gnu::cold]] void prepare(const std::string& name)
  {
    joint.prepare(name);
    validate(body, name);
    motor.prepare(name + ": rotor");
    if (!detail::is_finite(motor.gear_ratio)) {
      detail::refuse({name, ": gear ratio must be finite, got ", detail::to_text(motor.gear_ratio)});
    }
  }

  bool motion(const Matrix3<Scalar>& R, const Eigen::Matrix<Scalar, 1, 1>& q, const Eigen::Matrix<Scalar, 1, 1>& qd,
              std::array<FrameMotion<Scalar, 1>, 1>& frames) const
  {
    return joint.motion(R, q, qd, frames[0]);
  }

  [[gnu::always_inline]] bool motion(const Matrix3<Scalar>& R, const Turn<Scalar>& q,
                                     const Eigen::Matrix<Scalar, 1, 1>& qd,
                                     std::array<FrameMotion<Scalar, 1>, 1>& frames) const
    requires requires(const Joint& j) { j.motion(R, q, qd, frames[0]); }
  {
    return joint.motion(R, q, qd, frames[0]);
  }

  Vector6<Scalar> own_twist() const
    requires requires(const Joint& j) { j.own_twist(); }
  {
    return joint.own_twist();
  }

  Body<Scalar>& fixed_body() { return body; }
  std::array<CarriedBody<Scalar>, 2> bodies() const { return {{{0, body}, {-1, motor.body()}}}; }

  std::array<Rotor<Scalar, 1>, 1> rotors() const
  {
    // The axis as three numbers: lanes that are copied as one vector wait (several bipeds with AVX2 2 % less).
    const Vector3<Scalar>& a = motor.axis;
    return {{{-1, Vector3<Scalar>(a(0), a(1), a(2)), motor.axial_inertia, Eigen::Matrix<Scalar, 1, 1>(motor.gear_ratio),
              !motor.armature}}};
  }

  Eigen::Matrix<Scalar, 1, 1> Bbar(const Eigen::Matrix<Scalar, 1, 1>&) const
  {
    return Eigen::Matrix<Scalar, 1, 1>(motor.gear_ratio);
  }

  template <class T>
  auto cast() const
  {
    return MotorArmOn<decltype(joint.template cast<T>())>{joint.template cast<T>(), body.template cast<T>(),
                                                          motor.template cast<T>()};
  }
};

template <class Scalar>
using MotorArm = MotorArmOn<Revolute<Scalar>>;
template <class Scalar>
using LinearMotorArm = MotorArmOn<Prismatic<Scalar>>;

static_assert(Subsystem<MotorArm<double>>);

/// `body` less the axial inertia of a rotor on it that is going to be modelled by a MotorArm. The motor's axis is taken
/// to be in the body's axes: where the MotorArm is attached with a rotation R, give a motor whose axis is R times its
/// own.
template <class Scalar>
Body<Scalar> without_rotor(Body<Scalar> body, const Motor<Scalar>& motor)
{
  body.inertia -= motor.axial_inertia * (motor.axis * motor.axis.transpose());
  return body;
}

}  // namespace iim
