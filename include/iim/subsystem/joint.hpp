// Joints of a rigid link: how one frame moves relative to the inlet.
#pragma once

#include <iim/errors.hpp>
#include <iim/numerics/turns.hpp>
#include <iim/subsystem.hpp>

#include <array>
#include <cmath>
#include <cstddef>
#include <string>

namespace iim {

namespace detail {

/// Throws ModelError naming `owner` if the axes are one, but for their directions.
template <class Scalar>
[[gnu::cold]] void check_two_axes(const Vector3<Scalar>& first, const Vector3<Scalar>& second, const std::string& owner)
{
  if (!(cross(first, second).squaredNorm() > Scalar(1e-12))) {
    detail::refuse({owner, ": the two axes must differ, got ", to_text(first), " and ", to_text(second)});
  }
}

/// Throws ModelError, naming `owner`, unless the unit vectors normal and x are perpendicular.
template <class Scalar>
[[gnu::cold]] void check_perpendicular(const Vector3<Scalar>& normal, const Vector3<Scalar>& x,
                                       const std::string& owner)
{
  using std::abs;
  if (!(abs(normal.dot(x)) < Scalar(1e-6))) {
    refuse({owner, ": x must be perpendicular to the normal, got ", to_text(x), " and ", to_text(normal)});
  }
}

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
      detail::refuse({owner, ": axis must be a unit vector, got ", to_text(axis), " of length ", to_text(norm)});
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
  [[gnu::always_inline]] Triple<Scalar> in(const Matrix3<Scalar>& R) const
  {
    return aligned >= 0 ? column(R, aligned) * sign : combined(R, direction);
  }

  /// turned = R·exp(angle·direction~), w = R·direction.
  [[gnu::always_inline]] void turn(const Matrix3<Scalar>& R, const Triple<Scalar>& w, const Turn<Scalar>& angle,
                                   Matrix3<Scalar>& turned) const
  {
    const Scalar &s = angle.sine, &c = angle.cosine;
    if (aligned >= 0) {
      const int i = aligned == 2 ? 0 : aligned + 1;
      const int j = aligned == 0 ? 2 : aligned - 1;
      const Scalar t = sign * s;
      const Triple<Scalar> a = column(R, i), b = column(R, j);
      column(R, aligned).put(turned.data() + 3 * aligned);
      (a * c + b * t).put(turned.data() + 3 * i);
      (b * c - a * t).put(turned.data() + 3 * j);
    } else {
      // Rodrigues: c R + s R ã + (1 − c) w aᵀ
      const std::array<Triple<Scalar>, 3> axis{column(R, 0), column(R, 1), column(R, 2)};
#pragma GCC unroll 8
      for (std::size_t j = 0; j < 3; ++j) {
        const std::size_t j1 = (j + 1) % 3, j2 = (j + 2) % 3;
        const Scalar d = direction(Index(j)) - c * direction(Index(j));
        const Triple<Scalar> across = axis[j1] * direction(Index(j2)) - axis[j2] * direction(Index(j1));
        (axis[j] * c + w * d + across * s).put(turned.data() + 3 * j);
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

  [[gnu::cold]] void prepare(const std::string& owner) { unit_ = detail::UnitAxis<Scalar>(axis, owner); }

  [[gnu::always_inline]] bool motion(const Matrix3<Scalar>& R, const Eigen::Matrix<Scalar, 1, 1>& q,
                                     const Eigen::Matrix<Scalar, 1, 1>& qd, FrameMotion<Scalar, 1>& m) const
  {
    return motion(R, Turn<Scalar>(q(0)), qd, m);
  }

  [[gnu::always_inline]] bool motion(const Matrix3<Scalar>& R, const Turn<Scalar>& q,
                                     const Eigen::Matrix<Scalar, 1, 1>&, FrameMotion<Scalar, 1>& m) const
  {
    const detail::Triple<Scalar> w = unit_.in(R);
    unit_.turn(R, w, q, m.R);
    w.put(m.S.data() + 3);
    return true;
  }

  Vector6<Scalar> own_twist() const
  {
    Vector6<Scalar> V;
    detail::set(V, Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(0)), unit_.direction);
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

  [[gnu::cold]] void prepare(const std::string& owner) { unit_ = detail::UnitAxis<Scalar>(axis, owner); }

  bool motion(const Matrix3<Scalar>& R, const Eigen::Matrix<Scalar, 1, 1>& q, const Eigen::Matrix<Scalar, 1, 1>&,
              FrameMotion<Scalar, 1>& m) const
  {
    const detail::Triple<Scalar> w = unit_.in(R);
    m.R = R;
    (w * q(0)).put(m.r.data());
    w.put(m.S.data());
    return true;
  }

  Vector6<Scalar> own_twist() const
  {
    Vector6<Scalar> V;
    detail::set(V, unit_.direction, Vector3<Scalar>(Scalar(0), Scalar(0), Scalar(0)));
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
  static constexpr bool is_fixed = true;

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
