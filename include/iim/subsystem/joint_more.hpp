// Further joints of a rigid link: helical, cylindrical, universal, planar, spherical.
//
// Those that slide give S about the frame's own origin (MotionPattern::about_frame); for `bias` see FrameMotion.
#pragma once

#include <iim/errors.hpp>
#include <iim/numerics/turns.hpp>
#include <iim/subsystem.hpp>
#include <iim/subsystem/joint.hpp>
#include <iim/subsystem/rigid_link.hpp>

#include <cmath>
#include <string>

namespace iim {

/// Screw. q: angle [rad]; the frame advances by lead·q along the axis. The input is the torque about the axis (and
/// lead times the force along it).
template <class Scalar_>
struct Helical {
  using Scalar = Scalar_;
  static constexpr int n_q = 1;
  static constexpr int n_i = 1;
  static constexpr MotionPattern pattern{.bias = false, .about_frame = true};

  Vector3<Scalar> axis = Vector3<Scalar>::UnitZ();  ///< unit vector in inlet axes, through the coupling point
  Scalar lead = Scalar(0);                          ///< advance per angle [m/rad]

  void prepare(const std::string& owner)
  {
    unit_ = detail::UnitAxis<Scalar>(axis, owner);
    if (!detail::is_finite(lead)) { detail::refuse({owner, ": lead must be finite, got ", detail::to_text(lead)}); }
  }

  bool motion(const Matrix3<Scalar>& R, const Eigen::Matrix<Scalar, 1, 1>& q, const Eigen::Matrix<Scalar, 1, 1>&,
              FrameMotion<Scalar, 1>& m) const
  {
    const detail::Triple<Scalar> w = unit_.in(R);
    unit_.turn(R, w, Turn<Scalar>(q(0)), m.R);
    const detail::Triple<Scalar> v = w * lead;
    v.put(m.S.data());
    w.put(m.S.data() + 3);
    (v * q(0)).put(m.r.data());
    return true;
  }

  Vector6<Scalar> own_twist() const
  {
    Vector6<Scalar> V;
    V << lead * unit_.direction, unit_.direction;
    return V;
  }

  template <class T>
  Helical<T> cast() const
  {
    return {axis.template cast<T>(), T(lead)};
  }

  detail::UnitAxis<Scalar> unit_{Vector3<Scalar>::UnitZ(), "axis"};  ///< from `axis`, by prepare
};

/// Turning about and sliding along one axis, independently. q: angle [rad], displacement [m].
template <class Scalar_>
struct Cylindrical {
  using Scalar = Scalar_;
  static constexpr int n_q = 2;
  static constexpr int n_i = 2;
  static constexpr MotionPattern pattern{.bias = false, .about_frame = true};

  Vector3<Scalar> axis = Vector3<Scalar>::UnitZ();  ///< unit vector in inlet axes, through the coupling point

  void prepare(const std::string& owner) { unit_ = detail::UnitAxis<Scalar>(axis, owner); }

  bool motion(const Matrix3<Scalar>& R, const Eigen::Matrix<Scalar, 2, 1>& q, const Eigen::Matrix<Scalar, 2, 1>&,
              FrameMotion<Scalar, 2>& m) const
  {
    const detail::Triple<Scalar> w = unit_.in(R);
    unit_.turn(R, w, Turn<Scalar>(q(0)), m.R);
    w.put(&m.S(3, 0));
    w.put(&m.S(0, 1));
    (w * q(1)).put(m.r.data());
    return true;
  }

  Eigen::Matrix<Scalar, 6, 2> inlet_twists() const
  {
    Eigen::Matrix<Scalar, 6, 2> V = Eigen::Matrix<Scalar, 6, 2>::Zero();
    for (int k = 0; k < 3; ++k) { V(k + 3, 0) = V(k, 1) = unit_.direction(k); }
    return V;
  }

  template <class T>
  Cylindrical<T> cast() const
  {
    return {axis.template cast<T>()};
  }

  detail::UnitAxis<Scalar> unit_{Vector3<Scalar>::UnitZ(), "axis"};  ///< from `axis`, by prepare
};

/// Cross of two axes through the coupling point, itself without mass. q: angle about `first`, which stands still in the
/// inlet, then about `second`, which turns with the cross [rad]. The axes need not be perpendicular, only different.
template <class Scalar_>
struct Universal {
  using Scalar = Scalar_;
  static constexpr int n_q = 2;
  static constexpr int n_i = 2;
  static constexpr MotionPattern pattern{.linear = false, .offset = false};

  Vector3<Scalar> first = Vector3<Scalar>::UnitX();   ///< unit vector in inlet axes
  Vector3<Scalar> second = Vector3<Scalar>::UnitY();  ///< unit vector in inlet axes, for q = 0

  void prepare(const std::string& owner)
  {
    first_ = detail::UnitAxis<Scalar>(first, owner + ": first");
    second_ = detail::UnitAxis<Scalar>(second, owner + ": second");
    detail::check_two_axes(first, second, owner);
  }

  bool motion(const Matrix3<Scalar>& R, const Eigen::Matrix<Scalar, 2, 1>& q, const Eigen::Matrix<Scalar, 2, 1>& qd,
              FrameMotion<Scalar, 2>& m) const
  {
    Matrix3<Scalar> crossed;
    const detail::Triple<Scalar> w1 = first_.in(R);
    first_.turn(R, w1, Turn<Scalar>(q(0)), crossed);
    const detail::Triple<Scalar> w2 = second_.in(crossed);
    second_.turn(crossed, w2, Turn<Scalar>(q(1)), m.R);
    const detail::Triple<Scalar> turning = cross(w1, w2);
    w1.put(&m.S(3, 0));
    w2.put(&m.S(3, 1));
    for (int k = 0; k < 3; ++k) { m.bias(k) = Scalar(0); }
    (turning * (qd(0) * qd(1))).put(m.bias.data() + 3);
    return true;
  }

  Vector6<Scalar> inlet_twists() const
  {
    Vector6<Scalar> V = Vector6<Scalar>::Zero();
    for (int k = 0; k < 3; ++k) { V(k + 3) = first_.direction(k); }
    return V;
  }

  template <class T>
  Universal<T> cast() const
  {
    return {first.template cast<T>(), second.template cast<T>()};
  }

  detail::UnitAxis<Scalar> first_{Vector3<Scalar>::UnitX(), "axis"};   ///< from `first`, by prepare
  detail::UnitAxis<Scalar> second_{Vector3<Scalar>::UnitY(), "axis"};  ///< from `second`, by prepare
};

/// Sliding in a plane through the coupling point and turning about its normal. q: displacement along x and along
/// y = normal × x [m], both fixed in the inlet, and the angle [rad].
template <class Scalar_>
struct Planar {
  using Scalar = Scalar_;
  static constexpr int n_q = 3;
  static constexpr int n_i = 3;
  static constexpr MotionPattern pattern{.bias = false, .about_frame = true};

  Vector3<Scalar> normal = Vector3<Scalar>::UnitZ();  ///< unit vector in inlet axes
  Vector3<Scalar> x = Vector3<Scalar>::UnitX();       ///< unit vector in inlet axes, perpendicular to the normal

  void prepare(const std::string& owner)
  {
    unit_ = detail::UnitAxis<Scalar>(normal, owner + ": normal");
    const Vector3<Scalar> along = detail::UnitAxis<Scalar>(x, owner + ": x").direction;
    detail::check_perpendicular(unit_.direction, along, owner);
    y_ = unit_.direction.cross(along).normalized();
    x_ = y_.cross(unit_.direction);
  }

  bool motion(const Matrix3<Scalar>& R, const Eigen::Matrix<Scalar, 3, 1>& q, const Eigen::Matrix<Scalar, 3, 1>&,
              FrameMotion<Scalar, 3>& m) const
  {
    const detail::Triple<Scalar> w = unit_.in(R);
    const Vector3<Scalar> e1 = detail::times(R, x_);
    const Vector3<Scalar> e2 = detail::times(R, y_);
    unit_.turn(R, w, Turn<Scalar>(q(2)), m.R);
    for (int k = 0; k < 3; ++k) {
      m.r(k) = q(0) * e1(k) + q(1) * e2(k);
      m.S(k, 0) = e1(k);
      m.S(k, 1) = e2(k);
      m.S(k + 3, 2) = w(k);
    }
    return true;
  }

  Eigen::Matrix<Scalar, 6, 3> inlet_twists() const
  {
    Eigen::Matrix<Scalar, 6, 3> V = Eigen::Matrix<Scalar, 6, 3>::Zero();
    for (int k = 0; k < 3; ++k) {
      V(k, 0) = x_(k);
      V(k, 1) = y_(k);
      V(k + 3, 2) = unit_.direction(k);
    }
    return V;
  }

  template <class T>
  Planar<T> cast() const
  {
    return {normal.template cast<T>(), x.template cast<T>()};
  }

  detail::UnitAxis<Scalar> unit_{Vector3<Scalar>::UnitZ(), "axis"};  ///< from `normal`, by prepare
  Vector3<Scalar> x_ = Vector3<Scalar>::UnitX();
  Vector3<Scalar> y_ = Vector3<Scalar>::UnitY();
};

/// Ball. q: unit quaternion (x, y, z, w), frame to inlet; q̇: angular velocity in the frame's own axes [rad/s]. Inputs:
/// moment in the same axes. `motion` refuses a quaternion whose length is off by more than 1e-3.
template <class Scalar_>
struct Spherical {
  using Scalar = Scalar_;
  static constexpr int n_q = 4;
  static constexpr int n_i = 3;
  static constexpr MotionPattern pattern{.linear = false, .offset = false, .bias = false};  // Ṙω = R(ω × ω) = 0

  void prepare(const std::string&) {}

  bool motion(const Matrix3<Scalar>& R, const Eigen::Matrix<Scalar, 4, 1>& q, const Eigen::Matrix<Scalar, 3, 1>&,
              FrameMotion<Scalar, 3>& m) const
  {
    Matrix3<Scalar> E;
    const bool unit = detail::rotation_of(q(0), q(1), q(2), q(3), E);
    detail::multiply(R, E, m.R);
    for (int j = 0; j < 3; ++j) {
      for (int i = 0; i < 3; ++i) { m.S(i + 3, j) = m.R(i, j); }
    }
    return unit;
  }

  Eigen::Matrix<Scalar, 4, 1> neutral() const
  {
    return Eigen::Matrix<Scalar, 4, 1>(Scalar(0), Scalar(0), Scalar(0), Scalar(1));
  }

  void normalize(Eigen::Matrix<Scalar, 4, 1>& q) const { q.normalize(); }

  /// ½ quaternion ∘ (ω, 0)
  Eigen::Matrix<Scalar, 4, 1> coordinate_rate(const Eigen::Matrix<Scalar, 4, 1>& q,
                                              const Eigen::Matrix<Scalar, 3, 1>& qd) const
  {
    const Eigen::Quaternion<Scalar> omega(Scalar(0), qd(0), qd(1), qd(2));
    return (Eigen::Quaternion<Scalar>(q(3), q(0), q(1), q(2)) * omega).coeffs() / Scalar(2);
  }

  Eigen::Matrix<Scalar, 6, 3> inlet_twists() const
  {
    Eigen::Matrix<Scalar, 6, 3> V = Eigen::Matrix<Scalar, 6, 3>::Zero();
    for (int k = 0; k < 3; ++k) { V(k + 3, k) = Scalar(1); }
    return V;
  }

  template <class T>
  Spherical<T> cast() const
  {
    return {};
  }
};

template <class Scalar>
using HelicalLink = RigidLink<Helical<Scalar>>;
template <class Scalar>
using CylindricalLink = RigidLink<Cylindrical<Scalar>>;
template <class Scalar>
using UniversalLink = RigidLink<Universal<Scalar>>;
template <class Scalar>
using PlanarLink = RigidLink<Planar<Scalar>>;
template <class Scalar>
using SphericalLink = RigidLink<Spherical<Scalar>>;

static_assert(Subsystem<HelicalLink<double>>);
static_assert(Subsystem<CylindricalLink<double>>);
static_assert(Subsystem<UniversalLink<double>>);
static_assert(Subsystem<PlanarLink<double>>);
static_assert(Subsystem<SphericalLink<double>>);

}  // namespace iim
