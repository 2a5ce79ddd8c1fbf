// Motion inside a subsystem of several bodies: coordinates that depend on q_i, and frames carried along by them.
//
// A Dependent is a number with what q_i does to it: a formula written in Dependents gives a coordinate, its Jacobian
// and the Jacobian's derivative together. A RelativeMotion is a frame; turning, sliding and shifting it by Dependents
// gives the next frame, so that a mechanism is written like a drawing of it.
#pragma once

#include <iim/spatial.hpp>
#include <iim/subsystem.hpp>

#include <Eigen/Geometry>

#include <array>
#include <cmath>
#include <cstddef>

namespace iim {

/// x(q_i): value, ∂x/∂q_i, ẋ, and ẍ for q̈_i = 0.
template <class Scalar_, int n>
struct Dependent {
  using Scalar = Scalar_;
  using Gradient = Eigen::Matrix<Scalar, 1, n>;

  Scalar value = Scalar(0);
  Gradient gradient = Gradient::Zero();
  Scalar rate = Scalar(0);
  Scalar bias = Scalar(0);

  Dependent() = default;
  Dependent(const Scalar& constant) : value(constant) {}  // NOLINT: a number is a Dependent that does not depend
  Dependent(const Scalar& value_, const Gradient& gradient_, const Scalar& rate_, const Scalar& bias_)
      : value(value_), gradient(gradient_), rate(rate_), bias(bias_)
  {
  }

  /// f(x) from its value and first two derivatives.
  Dependent chain(const Scalar& f, const Scalar& f1, const Scalar& f2) const
  {
    return {f, Gradient(f1 * gradient), Scalar(f1 * rate), Scalar(f1 * bias + f2 * rate * rate)};
  }

  friend Dependent operator+(const Dependent& a, const Dependent& b)
  {
    return {Scalar(a.value + b.value), Gradient(a.gradient + b.gradient), Scalar(a.rate + b.rate),
            Scalar(a.bias + b.bias)};
  }
  friend Dependent operator-(const Dependent& a)
  {
    return {Scalar(-a.value), Gradient(-a.gradient), Scalar(-a.rate), Scalar(-a.bias)};
  }
  friend Dependent operator-(const Dependent& a, const Dependent& b) { return a + (-b); }
  friend Dependent operator*(const Dependent& a, const Dependent& b)
  {
    return {Scalar(a.value * b.value), Gradient(a.gradient * b.value + a.value * b.gradient),
            Scalar(a.rate * b.value + a.value * b.rate),
            Scalar(a.bias * b.value + Scalar(2) * a.rate * b.rate + a.value * b.bias)};
  }
  friend Dependent operator/(const Dependent& a, const Dependent& b)
  {
    const Scalar inverse = Scalar(1) / b.value;
    return a * b.chain(inverse, -inverse * inverse, Scalar(2) * inverse * inverse * inverse);
  }
  friend Dependent sqrt(const Dependent& a)
  {
    using std::sqrt;
    const Scalar root = sqrt(a.value);
    const Scalar f1 = Scalar(1) / (Scalar(2) * root);
    return a.chain(root, f1, -f1 / (Scalar(2) * a.value));
  }
  friend Dependent sin(const Dependent& a)
  {
    using std::cos;
    using std::sin;
    const Scalar s = sin(a.value);
    return a.chain(s, cos(a.value), -s);
  }
  friend Dependent cos(const Dependent& a)
  {
    using std::cos;
    using std::sin;
    const Scalar c = cos(a.value);
    return a.chain(c, -sin(a.value), -c);
  }
  /// Angle of the point (x, y); its derivatives are those of x dy − y dx over r².
  friend Dependent atan2(const Dependent& y, const Dependent& x)
  {
    using std::atan2;
    const Scalar over = Scalar(1) / (x.value * x.value + y.value * y.value);
    const Scalar turning = (x.value * y.rate - y.value * x.rate) * over;
    const Scalar stretch = (x.value * x.rate + y.value * y.rate) * over;
    return {Scalar(atan2(y.value, x.value)), Gradient((x.value * y.gradient - y.value * x.gradient) * over), turning,
            Scalar((x.value * y.bias - y.value * x.bias) * over - Scalar(2) * turning * stretch)};
  }
};

/// The internal coordinates themselves as Dependents.
template <class Scalar, int n>
std::array<Dependent<Scalar, n>, static_cast<std::size_t>(n)> independent(const Eigen::Matrix<Scalar, n, 1>& q,
                                                                          const Eigen::Matrix<Scalar, n, 1>& qd)
{
  std::array<Dependent<Scalar, n>, static_cast<std::size_t>(n)> x;
  for (int d = 0; d < n; ++d) {
    auto& x_d = x[static_cast<std::size_t>(d)];
    x_d.value = q(d);
    x_d.rate = qd(d);
    x_d.gradient(d) = Scalar(1);
  }
  return x;
}

/// A frame that moves relative to the inlet. Inlet axes throughout.
template <class Scalar, int n>
struct RelativeMotion {
  using Vector = Vector3<Scalar>;
  using Columns = Eigen::Matrix<Scalar, 3, n>;

  Matrix3<Scalar> R = Matrix3<Scalar>::Identity();  ///< frame to inlet
  Vector p = Vector::Zero();                        ///< origin from the coupling point [m]
  Columns v = Columns::Zero();                      ///< velocity of the origin per q̇_i
  Columns w = Columns::Zero();                      ///< angular velocity per q̇_i
  Vector velocity = Vector::Zero();                 ///< v q̇_i
  Vector omega = Vector::Zero();                    ///< w q̇_i
  Vector a = Vector::Zero();                        ///< acceleration of the origin for q̈_i = 0
  Vector alpha = Vector::Zero();                    ///< angular acceleration for q̈_i = 0

  /// The frame after a turn about its own `axis` (unit vector) through its origin.
  RelativeMotion turned(const Vector& axis, const Dependent<Scalar, n>& angle) const
  {
    RelativeMotion next = *this;
    const Vector u = detail::times(R, axis);
    next.R = R * Eigen::AngleAxis<Scalar>(angle.value, axis).toRotationMatrix();
    next.w += u * angle.gradient;
    next.omega += u * angle.rate;
    next.alpha += u * angle.bias + detail::cross(omega, u) * angle.rate;
    return next;
  }

  /// The frame after sliding along its own `axis`.
  RelativeMotion slid(const Vector& axis, const Dependent<Scalar, n>& distance) const
  {
    const Vector u = detail::times(R, axis);
    RelativeMotion next = carried(Vector(u * distance.value));
    next.v += u * distance.gradient;
    next.velocity += u * distance.rate;
    next.a += u * distance.bias + detail::cross(omega, u) * (Scalar(2) * distance.rate);
    return next;
  }

  /// A frame fixed in this one, axes parallel, its origin at `offset`.
  RelativeMotion at(const Vector& offset) const { return carried(detail::times(R, offset)); }

  /// A frame at the same origin whose axes stay those of the inlet: for a point mass.
  RelativeMotion upright() const
  {
    RelativeMotion next;
    next.p = p;
    next.v = v;
    next.velocity = velocity;
    next.a = a;
    return next;
  }

  /// Component of the origin along a direction of the inlet, seen from a point of the inlet.
  Dependent<Scalar, n> along(const Vector& direction, const Vector& from) const
  {
    return {Scalar(direction.dot(p - from)), typename Dependent<Scalar, n>::Gradient(direction.transpose() * v),
            Scalar(direction.dot(velocity)), Scalar(direction.dot(a))};
  }

  /// Writes it as Subsystem::motion wants it, R_inlet: inlet to world.
  void write(const Matrix3<Scalar>& R_inlet, FrameMotion<Scalar, n>& m) const
  {
    detail::multiply(R_inlet, R, m.R);
    m.r = detail::times(R_inlet, p);
    for (int d = 0; d < n; ++d) {
      const Vector w_d = w.col(d);
      Vector v_d = v.col(d);
      v_d -= detail::cross(w_d, p);
      m.S.template block<3, 1>(0, d) = detail::times(R_inlet, v_d);
      m.S.template block<3, 1>(3, d) = detail::times(R_inlet, w_d);
    }
    Vector a_o = a;
    a_o -= detail::cross(alpha, p) + detail::cross(omega, detail::cross(omega, p));
    detail::set(m.bias, detail::times(R_inlet, a_o), detail::times(R_inlet, alpha));
  }

private:
  RelativeMotion carried(const Vector& d) const
  {
    RelativeMotion next = *this;
    next.p += d;
    for (int k = 0; k < n; ++k) { next.v.col(k) += detail::cross(Vector(w.col(k)), d); }
    next.velocity += detail::cross(omega, d);
    next.a += detail::cross(alpha, d) + detail::cross(omega, detail::cross(omega, d));
    return next;
  }
};

}  // namespace iim
