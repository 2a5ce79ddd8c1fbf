// Joints of a rigid link: how one frame moves relative to the inlet.
#pragma once

#include <iim/errors.hpp>
#include <iim/subsystem.hpp>

#include <cmath>
#include <string>

namespace iim {

namespace detail {

/// A unit vector that may be one of the coordinate axes, which makes turning about it cheap.
template <class Scalar_>
struct UnitAxis {
  using Scalar = Scalar_;
  Vector3<Scalar> direction;
  int aligned = -1;  ///< 0, 1, 2: along that axis up to `sign`
  Scalar sign = Scalar(1);

  /// Throws ModelError naming `owner` unless |axis| is 1 within 1e-6; removes what is left of the difference.
  UnitAxis(const Vector3<Scalar>& axis, const std::string& owner) : direction(axis)
  {
    using std::sqrt;
    const Scalar norm = sqrt(axis.squaredNorm());
    if (!all_finite(axis) || !(norm > Scalar(1 - 1e-6)) || !(norm < Scalar(1 + 1e-6))) {
      throw ModelError(owner + ": axis must be a unit vector, got " + to_text(axis));
    }
    direction /= norm;
    for (int k = 0; k < 3; ++k) {
      if (axis((k + 1) % 3) == Scalar(0) && axis((k + 2) % 3) == Scalar(0)) {
        aligned = k;
        sign = axis(k) > Scalar(0) ? Scalar(1) : Scalar(-1);
        direction.setZero();
        direction(k) = sign;
      }
    }
  }

  /// R·direction.
  Vector3<Scalar> in(const Matrix3<Scalar>& R) const
  {
    if (aligned >= 0) { return Vector3<Scalar>(R(0, aligned) * sign, R(1, aligned) * sign, R(2, aligned) * sign); }
    return times(R, direction);
  }

  /// turned = R·exp(angle·direction~), w = R·direction.
  void turn(const Matrix3<Scalar>& R, const Vector3<Scalar>& w, const Scalar& angle, Matrix3<Scalar>& turned) const
  {
    Scalar s, c;
    sine_cosine(angle, s, c);
    if (aligned >= 0) {
      const int i = aligned == 2 ? 0 : aligned + 1;
      const int j = aligned == 0 ? 2 : aligned - 1;
      const Scalar t = sign * s;
      for (int k = 0; k < 3; ++k) {
        turned(k, aligned) = R(k, aligned);
        turned(k, i) = c * R(k, i) + t * R(k, j);
        turned(k, j) = c * R(k, j) - t * R(k, i);
      }
    } else {
      // Rodrigues: c R + s R ã + (1 − c) w aᵀ
      for (int j = 0; j < 3; ++j) {
        const int j1 = (j + 1) % 3, j2 = (j + 2) % 3;
        const Scalar d = direction(j) - c * direction(j);
        for (int k = 0; k < 3; ++k) {
          turned(k, j) = c * R(k, j) + w(k) * d + s * (R(k, j1) * direction(j2) - R(k, j2) * direction(j1));
        }
      }
    }
  }
};

}  // namespace detail

/// Rotation about an axis through the coupling point. q: angle [rad]; q̇: rate [rad/s].
template <class Scalar_>
struct Revolute {
  using Scalar = Scalar_;
  static constexpr int n_q = 1;
  static constexpr int n_i = 1;
  static constexpr MotionPattern pattern{.linear = false, .offset = false, .bias = false};

  Vector3<Scalar> axis = Vector3<Scalar>::UnitZ();  ///< unit vector in inlet axes

  void prepare(const std::string& owner) { unit_ = detail::UnitAxis<Scalar>(axis, owner); }

  bool motion(const Matrix3<Scalar>& R, const Eigen::Matrix<Scalar, 1, 1>& q, const Eigen::Matrix<Scalar, 1, 1>&,
              FrameMotion<Scalar, 1>& m) const
  {
    const Vector3<Scalar> w = unit_.in(R);
    unit_.turn(R, w, q(0), m.R);
    for (int k = 0; k < 3; ++k) { m.S(k + 3) = w(k); }
    return true;
  }

  Vector6<Scalar> own_twist() const
  {
    Vector6<Scalar> V;
    V << Vector3<Scalar>::Zero(), unit_.direction;
    return V;
  }

  template <class T>
  Revolute<T> cast() const
  {
    return {axis.template cast<T>()};
  }

  detail::UnitAxis<Scalar> unit_{Vector3<Scalar>::UnitZ(), "axis"};  ///< from `axis`, by prepare
};

/// Translation along an axis. q: displacement [m]; q̇: rate [m/s].
template <class Scalar_>
struct Prismatic {
  using Scalar = Scalar_;
  static constexpr int n_q = 1;
  static constexpr int n_i = 1;
  static constexpr MotionPattern pattern{.angular = false, .bias = false};

  Vector3<Scalar> axis = Vector3<Scalar>::UnitZ();  ///< unit vector in inlet axes

  void prepare(const std::string& owner) { unit_ = detail::UnitAxis<Scalar>(axis, owner); }

  bool motion(const Matrix3<Scalar>& R, const Eigen::Matrix<Scalar, 1, 1>& q, const Eigen::Matrix<Scalar, 1, 1>&,
              FrameMotion<Scalar, 1>& m) const
  {
    const Vector3<Scalar> w = unit_.in(R);
    m.R = R;
    for (int k = 0; k < 3; ++k) {
      m.r(k) = q(0) * w(k);
      m.S(k) = w(k);
    }
    return true;
  }

  Vector6<Scalar> own_twist() const
  {
    Vector6<Scalar> V;
    V << unit_.direction, Vector3<Scalar>::Zero();
    return V;
  }

  template <class T>
  Prismatic<T> cast() const
  {
    return {axis.template cast<T>()};
  }

  detail::UnitAxis<Scalar> unit_{Vector3<Scalar>::UnitZ(), "axis"};  ///< from `axis`, by prepare
};

/// No motion.
template <class Scalar_>
struct Fixed {
  using Scalar = Scalar_;
  static constexpr int n_q = 0;
  static constexpr int n_i = 0;
  static constexpr MotionPattern pattern{.linear = false, .angular = false, .offset = false, .bias = false};

  void prepare(const std::string&) {}

  bool motion(const Matrix3<Scalar>& R, const Eigen::Matrix<Scalar, 0, 1>&, const Eigen::Matrix<Scalar, 0, 1>&,
              FrameMotion<Scalar, 0>& m) const
  {
    m.R = R;
    return true;
  }

  template <class T>
  Fixed<T> cast() const
  {
    return {};
  }
};

}  // namespace iim
