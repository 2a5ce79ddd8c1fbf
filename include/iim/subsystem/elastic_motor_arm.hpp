// Motor-arm with a spring between gear and link: series elastic actuator.
#pragma once

#include <iim/errors.hpp>
#include <iim/subsystem.hpp>
#include <iim/subsystem/joint.hpp>
#include <iim/subsystem/motor_arm.hpp>

#include <array>
#include <string>

namespace iim {

/// Link, spring, gear and motor. q: angle of the rotor relative to its housing, then of the joint [rad, m].
/// Input: torque of the motor on the rotor, so that B̄_i = (0; 1, 0).
///
/// The gear's output is at q_0 / gear_ratio; spring and damper act between it and the joint. The rotor is that of a
/// MotorArm; as an armature its inertia is on q̇_0 alone.
template <class Joint>
struct ElasticMotorArmOn {
  using Scalar = typename Joint::Scalar;
  static_assert(Joint::n_i == 1, "an ElasticMotorArm drives a joint with one velocity");
  static constexpr int n_q = 2;
  static constexpr int n_i = 2;
  static constexpr int n_u = 1;
  static constexpr int n_frames = 1;
  static constexpr MotionPattern pattern = Joint::pattern.about_coupling_point();
  using Vector2 = Eigen::Matrix<Scalar, 2, 1>;

  Joint joint{};
  Body<Scalar> body{};
  Motor<Scalar> motor{};
  Scalar stiffness = Scalar(0);  ///< at the joint [N m/rad, N/m]
  Scalar damping = Scalar(0);    ///< at the joint [N m s/rad, N s/m]

  void prepare(const std::string& name)
  {
    MotorArmOn<Joint> rigid{joint, body, motor};
    rigid.prepare(name);
    joint = rigid.joint;
    motor = rigid.motor;
    if (motor.gear_ratio == Scalar(0)) { detail::refuse({name, ": gear ratio of an elastic drive must not be 0"}); }
    if (!(motor.axial_inertia > Scalar(0))) {
      detail::refuse({name, ": the rotor of an elastic drive needs a positive axial inertia, got ",
                      detail::to_text(motor.axial_inertia)});
    }
    for (const Scalar& x : {stiffness, damping}) {
      if (!(x >= Scalar(0)) || !detail::is_finite(x)) {
        detail::refuse({name, ": stiffness and damping must be finite and not negative, got ", detail::to_text(x)});
      }
    }
  }

  bool motion(const Matrix3<Scalar>& R, const Vector2& q, const Vector2& qd,
              std::array<FrameMotion<Scalar, 2>, 1>& frames) const
  {
    FrameMotion<Scalar, 2>& m = frames[0];
    Eigen::Matrix<Scalar, 6, 1> S = Eigen::Matrix<Scalar, 6, 1>::Zero();
    FrameMotion<Scalar, 1> of_joint{m.R, m.r, S, m.bias};
    const Eigen::Matrix<Scalar, 1, 1> angle(q(1));
    const Eigen::Matrix<Scalar, 1, 1> rate(qd(1));
    const bool ok = joint.motion(R, angle, rate, of_joint);
    for (int k = 0; k < 6; ++k) { m.S(k, 1) = S(k); }  // the column of the rotor stays zero
    return ok;
  }

  Body<Scalar>& fixed_body() { return body; }
  std::array<CarriedBody<Scalar>, 2> bodies() const { return MotorArmOn<Joint>{joint, body, motor}.bodies(); }

  std::array<Rotor<Scalar, 2>, 1> rotors() const
  {
    return {
        {{-1, motor.axis, motor.axial_inertia, Eigen::Matrix<Scalar, 1, 2>(Scalar(1), Scalar(0)), !motor.armature}}};
  }

  Vector2 Bbar(const Vector2&) const { return Vector2(Scalar(1), Scalar(0)); }

  Vector2 internal_force(const Vector2& q, const Vector2& qd) const
  {
    const Scalar torque = spring_torque(q, qd);
    return Vector2(-torque / motor.gear_ratio, torque);
  }

  std::array<Spring<Scalar, 2>, 1> springs(const Vector2& q, const Vector2& qd) const
  {
    const Eigen::Matrix<Scalar, 1, 2> ratio(Scalar(-1) / motor.gear_ratio, Scalar(1));
    return {{{ratio, stiffness, damping, spring_torque(q, qd)}}};
  }

  /// Energy in the spring [J].
  Scalar potential(const Vector2& q) const
  {
    const Scalar twist = q(1) - q(0) / motor.gear_ratio;
    return stiffness * twist * twist / Scalar(2);
  }

  /// Power lost in the damper [W].
  Scalar dissipation(const Vector2&, const Vector2& qd) const
  {
    const Scalar rate = qd(1) - qd(0) / motor.gear_ratio;
    return damping * rate * rate;
  }

  template <class T>
  auto cast() const
  {
    return ElasticMotorArmOn<decltype(joint.template cast<T>())>{joint.template cast<T>(), body.template cast<T>(),
                                                                 motor.template cast<T>(), T(stiffness), T(damping)};
  }

private:
  Scalar spring_torque(const Vector2& q, const Vector2& qd) const
  {
    return stiffness * (q(1) - q(0) / motor.gear_ratio) + damping * (qd(1) - qd(0) / motor.gear_ratio);
  }
};

template <class Scalar>
using ElasticMotorArm = ElasticMotorArmOn<Revolute<Scalar>>;
template <class Scalar>
using ElasticLinearMotorArm = ElasticMotorArmOn<Prismatic<Scalar>>;

static_assert(Subsystem<ElasticMotorArm<double>>);
static_assert(Subsystem<ElasticLinearMotorArm<double>>);

}  // namespace iim
