// Floating base: one body that moves freely.
#pragma once

#include <iim/errors.hpp>
#include <iim/subsystem.hpp>

#include <array>
#include <string>

namespace iim {

/// A free rigid body. q: position (3) [m] in inlet axes, unit quaternion (x, y, z, w) body to inlet.
/// q̇: velocity of the origin (3) [m/s] and angular velocity (3) [rad/s], both in the body's own axes; q̈ is the time
/// derivative of these six numbers. No inputs of its own.
///
/// There is no guidance part (F = 1): M̄_i is the body's 6×6 inertia, and nothing passes on to what it hangs on.
template <class Scalar_>
struct FloatingBase {
  using Scalar = Scalar_;
  static constexpr int n_q = 7;
  static constexpr int n_i = 6;
  static constexpr int n_u = 0;
  static constexpr int n_frames = 1;
  static constexpr MotionPattern pattern{};
  static constexpr bool is_free = true;  ///< coupling point: the centre of mass

  Body<Scalar> body{};

  [[gnu::cold]] void prepare(const std::string& name) { validate(body, name); }

  /// False if the quaternion's length is off by more than 1e-3; smaller differences are divided out.
  bool motion(const Matrix3<Scalar>& R, const Eigen::Matrix<Scalar, 7, 1>& q, const Eigen::Matrix<Scalar, 6, 1>& qd,
              std::array<FrameMotion<Scalar, 6>, 1>& frames) const
  {
    FrameMotion<Scalar, 6>& m = frames[0];
    Matrix3<Scalar> E;
    const bool unit = detail::rotation_of(q(3), q(4), q(5), q(6), E);
    detail::multiply(R, E, m.R);
    const Vector3<Scalar>& com = body.com;
    m.r = detail::times(m.R, com);
    for (int i = 0; i < 3; ++i) { m.r(i) = -m.r(i); }
    for (int j = 0; j < 3; ++j) {
      const Vector3<Scalar> e(m.R(0, j), m.R(1, j), m.R(2, j)), moved = detail::cross(m.r, e);
      for (int i = 0; i < 3; ++i) {
        m.S(i, j) = e(i);
        m.S(i, j + 3) = moved(i);
        m.S(i + 3, j + 3) = e(i);
      }
    }
    // d(R (v + ω × com))/dt for v̇ = ω̇ = 0
    const Vector3<Scalar> omega(qd(3), qd(4), qd(5));
    Vector3<Scalar> v = detail::cross(omega, com);
    detail::add(v, Vector3<Scalar>(qd(0), qd(1), qd(2)));
    detail::set(m.bias, detail::times(m.R, detail::cross(omega, v)), Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(0)));
    return unit;
  }

  Body<Scalar>& fixed_body() { return body; }
  std::array<CarriedBody<Scalar>, 1> bodies() const { return {{{0, body}}}; }

  Eigen::Matrix<Scalar, 6, 0> Bbar(const Eigen::Matrix<Scalar, 7, 1>&) const { return {}; }

  Eigen::Matrix<Scalar, 7, 1> neutral() const
  {
    Eigen::Matrix<Scalar, 7, 1> q = Eigen::Matrix<Scalar, 7, 1>::Zero();
    q(6) = Scalar(1);
    return q;
  }

  void normalize(Eigen::Matrix<Scalar, 7, 1>& q) const { q.template tail<4>().normalize(); }

  /// (E v ; ½ quaternion ∘ (ω, 0))
  Eigen::Matrix<Scalar, 7, 1> coordinate_rate(const Eigen::Matrix<Scalar, 7, 1>& q,
                                              const Eigen::Matrix<Scalar, 6, 1>& qd) const
  {
    const Eigen::Quaternion<Scalar> rotation(q(6), q(3), q(4), q(5));
    const Eigen::Quaternion<Scalar> omega(Scalar(0), qd(3), qd(4), qd(5));
    Eigen::Matrix<Scalar, 7, 1> rate;
    rate.template head<3>() = rotation.normalized().toRotationMatrix() * qd.template head<3>();  // as `motion` has it
    rate.template tail<4>() = (rotation * omega).coeffs() / Scalar(2);
    return rate;
  }

  template <class T>
  FloatingBase<T> cast() const
  {
    return {body.template cast<T>()};
  }
};

static_assert(Subsystem<FloatingBase<double>>);

}  // namespace iim
