// What a frame carries, as one rigid body: the composite inertias behind M (11) and the momentum of a tree.
#pragma once

#include <iim/spatial.hpp>

#include <cstddef>

namespace iim::detail {

/// Rigid bodies taken together, about one point: mass, first moment m·c, rotational inertia. With rotors on it Θ is
/// still symmetric, though not that of a body.
template <class Scalar>
struct CompositeBody {
  Scalar mass;
  Vector3<Scalar> mc;
  Symmetric3<Scalar> Theta;

  void set_zero()
  {
    mass = Scalar(0);
    for (int i = 0; i < 3; ++i) { mc(i) = Scalar(0); }
    Theta.at.fill(Scalar(0));
  }

  /// The rigid body that A is the inertia of.
  [[gnu::always_inline]] void set(const SpatialInertia<Scalar>& A)
  {
    mass = A.M(0, 0);
    for (int i = 0; i < 3; ++i) { mc(i) = A.H((i + 1) % 3, (i + 2) % 3); }
    Theta = A.J;
  }

  [[gnu::always_inline]] CompositeBody& operator+=(const CompositeBody& other)
  {
    mass += other.mass;
    add(mc, other.mc);
    for (std::size_t k = 0; k < 6; ++k) { Theta.at[k] += other.Theta.at[k]; }
    return *this;
  }

  /// Adds a body that is given about the point r away.
  [[gnu::always_inline]] void add_shifted(const CompositeBody& body, const Vector3<Scalar>& r)
  {
    // Θ − (r̃ m̃c + m̃c r̃) − m r̃r̃ = Θ + 2 (r·s) 1 − (s rᵀ + r sᵀ),  s = mc + ½ m r
    Vector3<Scalar> s;
    for (int i = 0; i < 3; ++i) { s(i) = body.mc(i) + Scalar(0.5) * (body.mass * r(i)); }
    const Scalar trace = Scalar(2) * (r(0) * s(0) + r(1) * s(1) + r(2) * s(2));
    for (int j = 0; j < 3; ++j) {
      for (int i = 0; i <= j; ++i) { Theta(i, j) += body.Theta(i, j) - (s(i) * r(j) + r(i) * s(j)); }
      Theta(j, j) += trace;
    }
    mass += body.mass;
    for (int i = 0; i < 3; ++i) { mc(i) += body.mc(i) + body.mass * r(i); }
  }

  /// Adds J a aᵀ: what the axial inertia of a rotor is to its carrier.
  template <class Axis>
  void add_rotor(const Scalar& J, const Axis& a)
  {
    for (int j = 0; j < 3; ++j) {
      for (int i = 0; i <= j; ++i) { Theta(i, j) += J * a(i) * a(j); }
    }
  }

  /// Wrench for the linear and the angular acceleration v and w, momentum for velocities; parts declared zero are not
  /// read.
  template <bool linear, bool angular>
  [[gnu::always_inline]] Vector6<Scalar> times(const Vector3<Scalar>& v, const Vector3<Scalar>& w) const
  {
    Vector6<Scalar> f;
    for (int i = 0; i < 3; ++i) {
      const int j = (i + 1) % 3, k = (i + 2) % 3;
      if constexpr (linear && angular) {
        f(i) = mass * v(i) + (w(j) * mc(k) - w(k) * mc(j));
        f(i + 3) = (mc(j) * v(k) - mc(k) * v(j)) + (Theta(i, 0) * w(0) + Theta(i, 1) * w(1) + Theta(i, 2) * w(2));
      } else if constexpr (linear) {
        f(i) = mass * v(i);
        f(i + 3) = mc(j) * v(k) - mc(k) * v(j);
      } else if constexpr (angular) {
        f(i) = w(j) * mc(k) - w(k) * mc(j);
        f(i + 3) = Theta(i, 0) * w(0) + Theta(i, 1) * w(1) + Theta(i, 2) * w(2);
      } else {
        f(i) = Scalar(0);
        f(i + 3) = Scalar(0);
      }
    }
    return f;
  }
};

}  // namespace iim::detail
