// One subsystem as the paper's Sect. 2 and appendix A have it: body-fixed frames, dense matrices, slow and obvious.
//
// Frame i is fixed to the parent at the coupling point, so that V_i = (v_o; ω_o; q̇_i) has the guidance velocities in
// frame i. Every formula is written out from the parameters; nothing here calls the library's kinematics or inertias.
// A rotor is a body of its own with a frame that turns with it: no gyroscopic term is written by hand.
#pragma once

#include <iim/iim.hpp>

#include <cmath>
#include <type_traits>
#include <vector>

namespace iim::reference {

/// exp(angle·ã) for a unit vector a.
template <class T>
Matrix3<T> turned(const Vector3<T>& a, const T& angle)
{
  using std::cos;
  using std::sin;
  const Matrix3<T> A = skew(a);
  return Matrix3<T>::Identity() + sin(angle) * A + (T(1) - cos(angle)) * (A * A);
}

/// A point that the internal coordinates move, and axes fixed to the part that carries it; all in axes of frame i.
template <class T>
struct MovedPoint {
  Matrix3<T> E, E_dot;          ///< axes of the part, and their derivative
  Vector3<T> r, r_dot;          ///< position from the coupling point, velocity relative to frame i
  MatrixX<T> Jv, Jw;            ///< ∂v/∂q̇_i, ∂ω/∂q̇_i, 3 × n_i
  MatrixX<T> Jv_dot, Jw_dot;
};

/// (8) and the same for a body: twist of the point in axes R, from V_i.
///     G = [ R  R r̃ᵀ  R ∂v/∂q̇ ; 0  R  R ∂ω/∂q̇ ],   R = (E A)ᵀ for axes A on the part
template <class T>
struct TwistMap {
  MatrixX<T> G, G_dot;  ///< 6 × (6 + n_i)

  TwistMap(const MovedPoint<T>& at, const Matrix3<T>& A)
  {
    const Index n = at.Jv.cols();
    const Matrix3<T> R = (at.E * A).transpose();
    const Matrix3<T> R_dot = (at.E_dot * A).transpose();
    const Matrix3<T> r = skew(at.r).transpose();
    const Matrix3<T> r_dot = skew(at.r_dot).transpose();
    G = MatrixX<T>::Zero(6, 6 + n);
    G.topLeftCorner(3, 3) = R;
    G.block(0, 3, 3, 3) = R * r;
    G.block(3, 3, 3, 3) = R;
    G.topRightCorner(3, n) = R * at.Jv;
    G.bottomRightCorner(3, n) = R * at.Jw;
    G_dot = MatrixX<T>::Zero(6, 6 + n);
    G_dot.topLeftCorner(3, 3) = R_dot;
    G_dot.block(0, 3, 3, 3) = R_dot * r + R * r_dot;
    G_dot.block(3, 3, 3, 3) = R_dot;
    G_dot.topRightCorner(3, n) = R_dot * at.Jv + R * at.Jv_dot;
    G_dot.bottomRightCorner(3, n) = R_dot * at.Jw + R * at.Jw_dot;
  }
};

/// Kinematics of one subsystem at its (q_i, q̇_i).
template <class T>
struct Kinematics {
  enum class Kind { fixed, revolute, prismatic, free };
  Kind kind = Kind::fixed;
  Vector3<T> axis = Vector3<T>::Zero();
  VectorX<T> q, qd;

  Index n_i() const { return qd.size(); }

  static MovedPoint<T> on_inlet(const Vector3<T>& x, Index n)
  {
    const MatrixX<T> zero = MatrixX<T>::Zero(3, n);
    return {Matrix3<T>::Identity(), Matrix3<T>::Zero(), x, Vector3<T>::Zero(), zero, zero, zero, zero};
  }

  /// The point x of the part that the joint moves.
  MovedPoint<T> moved(const Vector3<T>& x) const
  {
    MovedPoint<T> at = on_inlet(x, n_i());
    if (kind == Kind::revolute) {
      at.E = turned<T>(axis, q(0));
      at.r = at.E * x;
      at.Jv = axis.cross(at.r);
      at.Jw = axis;
    } else if (kind == Kind::prismatic) {
      at.r = x + axis * q(0);
      at.Jv = axis;
    } else if (kind == Kind::free) {
      const Vector3<T> e = q.segment(3, 3);  // unit quaternion e, w
      at.E = (q(6) * q(6) - e.dot(e)) * Matrix3<T>::Identity() + T(2) * (e * e.transpose()) + T(2) * q(6) * skew(e);
      at.E /= q.tail(4).squaredNorm();
      at.r = q.head(3) + at.E * x;
      at.Jv << at.E, -at.E * skew(x);
      at.Jw.rightCols(3) = at.E;
    }
    at.r_dot = at.Jv * qd;
    const Vector3<T> omega = at.Jw * qd;
    at.E_dot = skew(omega) * at.E;
    if (kind == Kind::revolute) { at.Jv_dot = axis.cross(at.r_dot); }
    if (kind == Kind::free) {
      at.Jv_dot << at.E_dot, -at.E_dot * skew(x);
      at.Jw_dot.rightCols(3) = at.E_dot;
    }
    return at;
  }
};

/// M̄_i, h̄_i, B̄_i from the bodies (A1)–(A7).
template <class T>
struct SubsystemDynamics {
  MatrixX<T> Mbar;  ///< (A5)
  VectorX<T> hbar;  ///< Ḡ_i V_i − Q̄_i, Q̄_i: gravity
  MatrixX<T> Bbar;  ///< of the subsystem's own motors
  MatrixX<T> F;     ///< (7)
  T kinetic{0};     ///< ½ V_iᵀ M̄_i V_i body by body
  std::vector<T> masses;
  std::vector<Vector3<T>> centres;  ///< in axes of frame i, from the coupling point
  std::vector<VectorX<T>> momenta;  ///< M_j V_Cj of each body, turned into axes of frame i

  explicit SubsystemDynamics(Index n_i)
      : Mbar(MatrixX<T>::Zero(6 + n_i, 6 + n_i)), hbar(VectorX<T>::Zero(6 + n_i)), Bbar(6 + n_i, 0),
        F(MatrixX<T>::Zero(6 + n_i, n_i))
  {
    F.bottomRows(n_i).setIdentity();
  }

  /// Adds a body with its centre at `at`, inertia Θ in the axes of the part; gravity g in axes of frame i.
  void add(const MovedPoint<T>& at, const T& mass, const Matrix3<T>& Theta, const Vector3<T>& g, const VectorX<T>& V)
  {
    const TwistMap<T> map(at, Matrix3<T>::Identity());
    MatrixX<T> M = MatrixX<T>::Zero(6, 6);  // (A1)
    M.topLeftCorner(3, 3) = mass * Matrix3<T>::Identity();
    M.bottomRightCorner(3, 3) = Theta;
    const VectorX<T> V_C = map.G * V;  // (A3)
    MatrixX<T> Omega = MatrixX<T>::Zero(6, 6);
    Omega.topLeftCorner(3, 3) = skew(Vector3<T>(V_C.tail(3)));
    Omega.bottomRightCorner(3, 3) = Omega.topLeftCorner(3, 3);
    VectorX<T> W = VectorX<T>::Zero(6);
    W.head(3) = mass * (at.E.transpose() * g);
    const VectorX<T> P = M * V_C;
    Mbar += map.G.transpose() * M * map.G;                                           // (A5)
    hbar += map.G.transpose() * (M * (map.G_dot * V) + Omega * P) - map.G.transpose() * W;  // (A6), (A7)
    kinetic += V_C.dot(P) / T(2);
    masses.push_back(mass);
    centres.push_back(at.r);
    VectorX<T> turned_momentum(6);
    turned_momentum << at.E * P.head(3), at.E * P.tail(3);
    momenta.push_back(turned_momentum);
  }

  void add(const Kinematics<T>& joint, const Body<T>& body, const Vector3<T>& g, const VectorX<T>& V)
  {
    add(joint.moved(body.com), body.mass, body.inertia, g, V);
  }

  /// The rotor as a body whose frame turns by gear_ratio·q about its axis; as armature a locked body and k²J.
  void add(const Kinematics<T>& joint, const Motor<T>& motor, const Vector3<T>& g, const VectorX<T>& V)
  {
    using std::sqrt;
    const Vector3<T> a = motor.axis / T(sqrt(motor.axis.squaredNorm()));
    const Matrix3<T> along = a * a.transpose();
    const bool own_mass = motor.mass > T(0);
    Matrix3<T> Theta = Matrix3<T>::Zero();
    if (own_mass) { Theta += motor.transverse_inertia * (Matrix3<T>::Identity() - along); }
    MovedPoint<T> at = Kinematics<T>::on_inlet(own_mass ? motor.com : Vector3<T>::Zero(), joint.n_i());
    if (motor.armature) {
      Mbar.bottomRightCorner(1, 1)(0, 0) += motor.gear_ratio * motor.gear_ratio * motor.axial_inertia;
    } else {
      Theta += motor.axial_inertia * along;
      at.E = turned<T>(a, motor.gear_ratio * joint.q(0));
      at.E_dot = skew(Vector3<T>(a * (motor.gear_ratio * joint.qd(0)))) * at.E;
      at.Jw = a * motor.gear_ratio;
    }
    add(at, motor.mass, Theta, g, V);
    if (motor.armature) { kinetic += motor.axial_inertia * motor.gear_ratio * motor.gear_ratio * joint.qd(0) * joint.qd(0) / T(2); }
  }

  void add_motor_input(const T& ratio)
  {
    Bbar = MatrixX<T>::Zero(Mbar.rows(), 1);
    Bbar(Mbar.rows() - 1, 0) = ratio;
  }
};


template <class T, class S>
Kinematics<T> kinematics_of(const S& s, const VectorX<T>& q, const VectorX<T>& qd)
{
  using std::sqrt;
  Kinematics<T> joint{Kinematics<T>::Kind::fixed, Vector3<T>::Zero(), q, qd};
  if constexpr (std::is_same_v<S, FloatingBase<T>>) {
    joint.kind = Kinematics<T>::Kind::free;
  } else if constexpr (S::n_i == 1) {
    constexpr bool turns = std::is_same_v<decltype(s.joint), Revolute<T>>;
    joint.kind = turns ? Kinematics<T>::Kind::revolute : Kinematics<T>::Kind::prismatic;
    joint.axis = s.joint.axis / T(sqrt(s.joint.axis.squaredNorm()));
  }
  return joint;
}

template <class T, class S>
SubsystemDynamics<T> dynamics_of(const S& s, const Kinematics<T>& joint, const Vector3<T>& g, const VectorX<T>& V)
{
  SubsystemDynamics<T> dynamics(joint.n_i());
  dynamics.add(joint, s.body, g, V);
  if constexpr (requires { s.motor; }) {
    dynamics.add(joint, s.motor, g, V);
    dynamics.add_motor_input(s.motor.gear_ratio);
  } else if constexpr (S::n_u == 1) {
    dynamics.add_motor_input(T(1));
  }
  return dynamics;
}

}  // namespace iim::reference
