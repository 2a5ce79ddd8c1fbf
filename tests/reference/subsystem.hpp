// One subsystem as the paper's Sect. 2 and appendix A have it: body-fixed frames, dense matrices, slow and obvious.
//
// Frame i is fixed to the parent at the coupling point, so that V_i = (v_o; ω_o; q̇_i) has the guidance velocities in
// frame i. Every formula is written out from the parameters; nothing here calls the library's kinematics or inertias.
// A rotor is a body of its own with a frame that turns with it: no gyroscopic term is written by hand.
#pragma once

#include "dense.hpp"

#include <iim/iim.hpp>

#include <cmath>
#include <type_traits>
#include <vector>

namespace iim::reference {

/// exp(angle·ã) for a unit vector a.
template <class T>
Dense<T> turned(const Dense<T>& a, const T& angle)
{
  using std::cos;
  using std::sin;
  const Dense<T> A = tilde(a);
  return Dense<T>::identity(3) + sin(angle) * A + T(T(1) - cos(angle)) * (A * A);
}

template <class T>
Dense<T> normalised(const Vector3<T>& a)
{
  using std::sqrt;
  return T(T(1) / sqrt(T(a.squaredNorm()))) * Dense<T>(a);
}

/// A point that the internal coordinates move, and axes fixed to the part that carries it; all in axes of frame i.
template <class T>
struct MovedPoint {
  Dense<T> E, E_dot;  ///< axes of the part, and their derivative
  Dense<T> r, r_dot;  ///< position from the coupling point, velocity relative to frame i
  Dense<T> Jv, Jw;    ///< ∂v/∂q̇_i, ∂ω/∂q̇_i, 3 × n_i
  Dense<T> Jv_dot, Jw_dot;

  /// The point x of frame i itself.
  MovedPoint(const Dense<T>& x, Index n)
      : E(Dense<T>::identity(3)), E_dot(3, 3), r(x), r_dot(3), Jv(3, n), Jw(3, n), Jv_dot(3, n), Jw_dot(3, n)
  {
  }
};

/// (8) and the same for a body: twist of the point in the axes (E A)ᵀ, for axes A on the part, from V_i.
///     G = [ R  R r̃ᵀ  R ∂v/∂q̇ ; 0  R  R ∂ω/∂q̇ ],   R = (E A)ᵀ
template <class T>
struct TwistMap {
  Dense<T> G, G_dot;  ///< 6 × (6 + n_i)

  TwistMap(const MovedPoint<T>& at, const Dense<T>& A) : G(6, 6 + at.Jv.cols()), G_dot(6, 6 + at.Jv.cols())
  {
    const Dense<T> R = (at.E * A).transpose();
    const Dense<T> R_dot = (at.E_dot * A).transpose();
    const Dense<T> rT = tilde(at.r).transpose();
    const Dense<T> rT_dot = tilde(at.r_dot).transpose();
    G.set(0, 0, R);
    G.set(0, 3, R * rT);
    G.set(3, 3, R);
    G.set(0, 6, R * at.Jv);
    G.set(3, 6, R * at.Jw);
    G_dot.set(0, 0, R_dot);
    G_dot.set(0, 3, R_dot * rT + R * rT_dot);
    G_dot.set(3, 3, R_dot);
    G_dot.set(0, 6, R_dot * at.Jv + R * at.Jv_dot);
    G_dot.set(3, 6, R_dot * at.Jw + R * at.Jw_dot);
  }
};

/// Kinematics of one subsystem at its (q_i, q̇_i).
template <class T>
struct Kinematics {
  enum class Kind { fixed, revolute, prismatic, free };
  Kind kind = Kind::fixed;
  Dense<T> axis{3};
  Dense<T> q, qd;

  Index n_i() const { return qd.rows(); }

  /// The point x of the part that the joint moves.
  MovedPoint<T> moved(const Dense<T>& x) const
  {
    MovedPoint<T> at(x, n_i());
    if (kind == Kind::revolute) {
      at.E = turned(axis, q(0));
      at.r = at.E * x;
      at.Jv = tilde(axis) * at.r;
      at.Jw = axis;
    } else if (kind == Kind::prismatic) {
      at.r = x + q(0) * axis;
      at.Jv = axis;
    } else if (kind == Kind::free) {
      const Dense<T> e = q.rows(3, 3);  // quaternion (e, w)
      const T w = q(6);
      const T length2 = w * w + e.squared_norm();
      at.E = T(T(w * w - e.squared_norm()) / length2) * Dense<T>::identity(3) +
             T(T(2) / length2) * (e * e.transpose() + w * tilde(e));
      at.r = q.head(3) + at.E * x;
      at.Jv = beside(at.E, -(at.E * tilde(x)));
      at.Jw = beside(Dense<T>(3, 3), at.E);
    }
    at.r_dot = at.Jv * qd;
    at.E_dot = tilde(Dense<T>(at.Jw * qd)) * at.E;
    if (kind == Kind::revolute) { at.Jv_dot = tilde(axis) * at.r_dot; }
    if (kind == Kind::free) {
      at.Jv_dot = beside(at.E_dot, -(at.E_dot * tilde(x)));
      at.Jw_dot = beside(Dense<T>(3, 3), at.E_dot);
    }
    return at;
  }
};

/// M̄_i, h̄_i, B̄_i from the bodies (A1)–(A7).
template <class T>
struct SubsystemDynamics {
  /// A body as the balances of momentum want it.
  struct BodyState {
    T mass;
    Dense<T> centre;    ///< from the coupling point, axes of frame i
    Dense<T> momentum;  ///< M_j V_Cj turned into axes of frame i
  };

  Dense<T> Mbar;  ///< (A5)
  Dense<T> hbar;  ///< Ḡ_i V_i − Q̄_i (A6), (A7); Q̄_i: gravity
  Dense<T> Bbar;  ///< of the subsystem's own motors
  Dense<T> F;     ///< (7)
  T kinetic{0};   ///< energy, body by body
  std::vector<BodyState> bodies;

  explicit SubsystemDynamics(Index n_i = 0) : Mbar(6 + n_i, 6 + n_i), hbar(6 + n_i), Bbar(6 + n_i, 0), F(6 + n_i, n_i)
  {
    F.set(6, 0, Dense<T>::identity(n_i));
  }

  /// Adds a body with its centre at `at`, inertia Θ in the axes of the part; gravity g in axes of frame i.
  void add(const MovedPoint<T>& at, const T& mass, const Dense<T>& Theta, const Dense<T>& g, const Dense<T>& V)
  {
    const TwistMap<T> map(at, Dense<T>::identity(3));
    Dense<T> M(6, 6), Omega(6, 6), W(6);  // (A1)
    M.set(0, 0, mass * Dense<T>::identity(3));
    M.set(3, 3, Theta);
    const Dense<T> V_C = map.G * V;  // (A3)
    const Dense<T> omega = tilde(V_C.tail(3));
    Omega.set(0, 0, omega);
    Omega.set(3, 3, omega);
    W.set(0, 0, mass * (at.E.transpose() * g));
    const Dense<T> P = M * V_C;
    const Dense<T> GT = map.G.transpose();
    Mbar += GT * M * map.G;                                   // (A5)
    hbar += GT * (M * (map.G_dot * V) + Omega * P) - GT * W;  // (A6), (A7)
    kinetic += dot(V_C, P) / T(2);
    bodies.push_back({mass, at.r, stacked(at.E * P.head(3), at.E * P.tail(3))});
  }

  /// The rotor as a body whose frame turns by gear_ratio·q about its axis; as armature a locked body and k²J.
  void add(const Kinematics<T>& joint, const Motor<T>& motor, const Dense<T>& g, const Dense<T>& V)
  {
    const Dense<T> a = normalised(motor.axis);
    const Dense<T> along = a * a.transpose();
    const bool own_mass = motor.mass > T(0);
    Dense<T> Theta(3, 3);
    if (own_mass) { Theta += motor.transverse_inertia * (Dense<T>::identity(3) - along); }
    MovedPoint<T> at(own_mass ? Dense<T>(motor.com) : Dense<T>(3), joint.n_i());
    const T k2J = motor.gear_ratio * motor.gear_ratio * motor.axial_inertia;
    if (motor.armature) {
      Mbar(6, 6) += k2J;
      kinetic += k2J * joint.qd(0) * joint.qd(0) / T(2);
    } else {
      Theta += motor.axial_inertia * along;
      at.E = turned(a, T(motor.gear_ratio * joint.q(0)));
      at.E_dot = tilde(Dense<T>(T(motor.gear_ratio * joint.qd(0)) * a)) * at.E;
      at.Jw = motor.gear_ratio * a;
    }
    add(at, motor.mass, Theta, g, V);
  }

  void add_motor_input(const T& ratio)
  {
    Bbar = Dense<T>(Mbar.rows(), 1);
    Bbar(6) = ratio;
  }
};

/// Joint of one of the library's own types at (q_i, q̇_i).
template <class T, class S>
Kinematics<T> kinematics_of(const S& s, const Dense<T>& q, const Dense<T>& qd)
{
  Kinematics<T> joint;
  joint.q = q;
  joint.qd = qd;
  if constexpr (std::is_same_v<S, FloatingBase<T>>) {
    joint.kind = Kinematics<T>::Kind::free;
  } else if constexpr (S::n_i == 1) {
    constexpr bool turns = std::is_same_v<std::remove_cvref_t<decltype(s.joint)>, Revolute<T>>;
    joint.kind = turns ? Kinematics<T>::Kind::revolute : Kinematics<T>::Kind::prismatic;
    joint.axis = normalised(s.joint.axis);
  }
  return joint;
}

/// Bodies and motor of one of the library's own types.
template <class T, class S>
SubsystemDynamics<T> dynamics_of(const S& s, const Kinematics<T>& joint, const Dense<T>& g, const Dense<T>& V)
{
  SubsystemDynamics<T> dynamics(joint.n_i());
  dynamics.add(joint.moved(Dense<T>(s.body.com)), s.body.mass, Dense<T>(s.body.inertia), g, V);
  if constexpr (requires { s.motor; }) {
    dynamics.add(joint, s.motor, g, V);
    dynamics.add_motor_input(s.motor.gear_ratio);
  } else if constexpr (S::n_u == 1) {
    dynamics.add_motor_input(T(1));
  }
  return dynamics;
}

}  // namespace iim::reference
