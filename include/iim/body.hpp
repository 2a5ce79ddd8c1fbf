// Rigid bodies: mass, centre of mass, inertia (A1), and what a tree keeps of them.
#pragma once

#include <iim/errors.hpp>
#include <iim/spatial.hpp>

#include <algorithm>
#include <cmath>
#include <string>

namespace iim {

/// Where a frame sits in another one: x_outer = R x_inner + p.
template <class Scalar_>
struct Placement {
  using Scalar = Scalar_;
  Matrix3<Scalar> R = Matrix3<Scalar>::Identity();
  Vector3<Scalar> p = Vector3<Scalar>::Zero();  ///< [m]

  Placement operator*(const Placement& inner) const { return {R * inner.R, R * inner.p + p}; }

  template <class T>
  Placement<T> cast() const
  {
    return {R.template cast<T>(), p.template cast<T>()};
  }
};

/// A rigid body in the axes of the frame that carries it.
template <class Scalar_>
struct Body {
  using Scalar = Scalar_;
  Scalar mass = Scalar(0);                            ///< [kg]
  Vector3<Scalar> com = Vector3<Scalar>::Zero();      ///< centre of mass [m]
  Matrix3<Scalar> inertia = Matrix3<Scalar>::Zero();  ///< about the centre of mass [kg m²]

  /// A part without inertia (the cross of a universal joint, a frame). Mass zero in any other body of the types in
  /// subsystem/ is an error; rotors have one with moments alone.
  static Body massless()
  {
    Body body;
    body.is_massless = true;
    return body;
  }

  bool is_massless = false;  ///< set by massless()
  /// Lets a principal moment exceed the sum of the other two, which that of no body does but many a robot's file says.
  /// M stays positive definite.
  bool any_moments = false;

  /// The same body in the axes of an outer frame.
  Body placed(const Placement<Scalar>& at) const
  {
    Body body = *this;
    body.com = detail::times(at.R, com);
    detail::add(body.com, at.p);
    const Matrix3<Scalar> turned = detail::turned(at.R, inertia);
    for (int i = 0; i < 3; ++i) {  // symmetric to the last bit
      for (int j = 0; j < 3; ++j) { body.inertia(i, j) = (turned(i, j) + turned(j, i)) * Scalar(0.5); }
    }
    return body;
  }

  /// What the two make as one rigid body, in the same axes. Only sums of non-negative terms: a small part on a large
  /// one keeps its digits.
  void add(const Body& other)
  {
    if (other.is_massless) { return; }
    if (is_massless) {
      *this = other;
      return;
    }
    const Scalar total = mass + other.mass;
    any_moments |= other.any_moments;
    if (!(total > Scalar(0))) {  // inertias of rotors whose masses are elsewhere
      for (int k = 0; k < 9; ++k) { inertia.data()[k] += other.inertia.data()[k]; }
      return;
    }
    Vector3<Scalar> apart;
    for (int i = 0; i < 3; ++i) {
      apart(i) = other.com(i) - com(i);
      com(i) += (other.mass / total) * apart(i);
    }
    for (int k = 0; k < 9; ++k) { inertia.data()[k] += other.inertia.data()[k]; }
    detail::add_point<Scalar>(mass * (other.mass / total), apart, inertia);
    mass = total;
  }

  template <class T>
  Body<T> cast() const
  {
    return {T(mass), com.template cast<T>(), inertia.template cast<T>(), is_massless, any_moments};
  }
};

namespace detail {

template <class Scalar>
Scalar sum_of_moments(const Matrix3<Scalar>& I)
{
  return I(0, 0) + I(1, 1) + I(2, 2);
}

}  // namespace detail

/// The rigid body that all bodies carried by one frame make together.
template <class Scalar>
struct FrameMass {
  Scalar mass = Scalar(0);
  Vector3<Scalar> com = Vector3<Scalar>::Zero();              ///< centre of mass
  Matrix3<Scalar> central_inertia = Matrix3<Scalar>::Zero();  ///< about the centre of mass
  Vector3<Scalar> centre = Vector3<Scalar>::Zero();  ///< of mass, from the frame's origin or from what set_about names
  Vector3<Scalar> first_moment = Vector3<Scalar>::Zero();  ///< m·centre
  Matrix3<Scalar> inertia = Matrix3<Scalar>::Zero();       ///< about the same point
  bool present = false;  ///< false: the frame carries nothing, and nothing is computed for it

  void add(const Body<Scalar>& body)
  {
    if (body.is_massless) { return; }
    Body<Scalar> all = body;
    if (present) {
      all = {mass, com, central_inertia};
      all.add(body);
    }
    mass = all.mass;
    com = all.com;
    central_inertia = all.inertia;
    present = true;
    set_about(Vector3<Scalar>::Zero());
  }

  /// Moments about another point of the frame, if it carries anything.
  void set_about(const Vector3<Scalar>& point)
  {
    if (!present) { return; }
    for (int i = 0; i < 3; ++i) {
      centre(i) = com(i) - point(i);
      first_moment(i) = mass * centre(i);
    }
    inertia = central_inertia;
    detail::add_point(mass, centre, inertia);
  }
};

namespace detail {

/// U and D of a frame's own bodies for its own twist: constants, in its axes. From them a thin moment about the joint's
/// axis is what it is, where an inertia that is turned to world axes has the roundings of the others in it (a wrist of
/// one thin rod: 112 ε of B̂, with this 1).
template <class Scalar>
struct OwnColumn {
  Vector3<Scalar> linear, angular;
  Scalar D;

  OwnColumn() = default;
  OwnColumn(const FrameMass<Scalar>& body, const Vector6<Scalar>& twist)
  {
    const auto abs = [](const Scalar& x) { return x < Scalar(0) ? Scalar(-x) : x; };
    const Vector3<Scalar> omega = iim::detail::angular(twist);
    Vector3<Scalar> v = cross(omega, body.com);
    add(v, iim::detail::linear(twist));
    angular = times(body.central_inertia, omega);
    D = Scalar(0);
    const Scalar rounding = Scalar(4) * Eigen::NumTraits<Scalar>::epsilon();
    Scalar noise(0);
    for (int i = 0; i < 3; ++i) {
      linear(i) = body.mass * v(i);
      D += v(i) * linear(i) + omega(i) * angular(i);
      const int j = (i + 1) % 3, k = (i + 2) % 3;
      const Scalar lost = rounding * (abs(omega(j) * body.com(k)) + abs(omega(k) * body.com(j)) + abs(twist(i)));
      noise += lost * (body.mass * lost);
      for (int l = 0; l < 3; ++l) { noise += rounding * abs(omega(i) * body.central_inertia(i, l) * omega(l)); }
    }
    if (!ScalarTraits<Scalar>::is_positive(D - noise)) { D = Scalar(0); }  // as of a point on the axis: no pivot
    add(angular, cross(body.com, linear));
  }
};

/// Whether shift·1 + factor·A is positive definite: Gauss elimination of a symmetric matrix of double. (Eigen's
/// decompositions take seconds to compile.)
template <class Matrix>
[[gnu::cold]] bool is_definite(double shift, double factor, Matrix A)
{
  const Index n = A.rows();
  for (Index k = 0; k < n * n; ++k) { A.data()[k] = factor * A.data()[k] + (k % (n + 1) == 0 ? shift : 0); }
  for (Index k = 0; k < n; ++k) {
    if (!(A(k, k) > 0)) { return false; }
    for (Index i = k + 1; i < n; ++i) {
      for (Index j = k + 1; j < n; ++j) { A(i, j) -= A(i, k) / A(k, k) * A(k, j); }
    }
  }
  return true;
}

}  // namespace detail

/// Throws ModelError, naming `owner`, unless centre and inertia can be those of a body: finite, inertia symmetric,
/// without a negative principal moment, and no principal moment larger than the sum of the others (but for
/// Body::any_moments).
template <class Scalar>
[[gnu::cold]] void validate_inertia(const Body<Scalar>& body, const std::string& owner)
{
  if (!detail::all_finite(body.com)) {
    detail::refuse({owner, ": centre of mass must be finite, got ", detail::to_text(body.com)});
  }
  const Matrix3<Scalar>& I = body.inertia;
  const std::string moments = ", got the rows " + detail::to_text(I);
  if (!detail::all_finite(I)) { detail::refuse({owner, ": inertia must be finite", moments}); }
  // Compared in double: a test of plausibility, not a computation that later results depend on.
  Eigen::Matrix3d inertia;
  double scale = 0, asymmetry = 0;
  for (Index k = 0; k < 9; ++k) {
    inertia(k) = detail::to_double(I(k));
    scale = std::max(scale, std::abs(inertia(k)));
  }
  const double point = 1e-8;                                              // [m]
  if (scale <= detail::to_double(body.mass) * point * point) { return; }  // a point mass, but for roundings
  for (Index k = 0; k < 9; ++k) { inertia(k) /= scale; }
  for (Index k = 0; k < 3; ++k) {
    asymmetry = std::max(asymmetry, std::abs(inertia(k, (k + 1) % 3) - inertia((k + 1) % 3, k)));
  }
  const double slack = 1e-6;
  if (asymmetry > slack) { detail::refuse({owner, ": inertia must be symmetric", moments}); }
  if (!detail::is_definite(slack, 1, inertia)) {
    detail::refuse({owner, ": inertia has a negative principal moment", moments});
  }
  if (body.any_moments) { return; }
  const double sum = inertia(0, 0) + inertia(1, 1) + inertia(2, 2);
  if (!detail::is_definite((1 + slack) * sum + slack, -(2 + slack), inertia)) {
    detail::refuse({owner,
                    ": one principal moment of inertia exceeds the sum of the other two by more than roundings (with "
                    "Body::any_moments it may)",
                    moments});
  }
}

/// The same for a body that must have a mass, positive and finite, unless it is massless().
template <class Scalar>
[[gnu::cold]] void validate(const Body<Scalar>& body, const std::string& owner)
{
  if (body.is_massless) {
    if (body.mass != Scalar(0)) {
      detail::refuse({owner, ": a massless body was given a mass of ", detail::to_text(body.mass), " kg"});
    }
    for (Index k = 0; k < 9; ++k) {
      if (body.inertia(k) != Scalar(0)) {
        detail::refuse(
            {owner, ": a massless body was given moments of inertia, the rows ", detail::to_text(body.inertia)});
      }
    }
    return;
  }
  if (!(body.mass > Scalar(0)) || !detail::is_finite(body.mass)) {
    detail::refuse({owner, ": mass must be positive and finite, got ", detail::to_text(body.mass),
                    " kg (Body::massless() makes a part without inertia)"});
  }
  validate_inertia(body, owner);
}

}  // namespace iim
