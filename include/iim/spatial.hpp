// Twists, wrenches and 6×6 inertias in axes parallel to the world.
//
// Component order is linear before angular everywhere: twist (v, ω), acceleration (v̇, ω̇), wrench (f, n).
// All vectors of one subsystem are taken at one point, its reference point (the coupling point), in axes
// parallel to the world. Between two subsystems only the point moves, so that R_ip = 1 in (8) and
//
//     X(r) = [ 1  r̃ᵀ ; 0  1 ]        twist at x + r from the twist at x       (8), r = r_pi
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace iim {

using Index = Eigen::Index;

template <class Scalar> using Vector3 = Eigen::Matrix<Scalar, 3, 1>;
template <class Scalar> using Matrix3 = Eigen::Matrix<Scalar, 3, 3>;
template <class Scalar> using Vector6 = Eigen::Matrix<Scalar, 6, 1>;
template <class Scalar> using Matrix6 = Eigen::Matrix<Scalar, 6, 6>;
template <class Scalar> using VectorX = Eigen::Matrix<Scalar, Eigen::Dynamic, 1>;
template <class Scalar> using MatrixX = Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic>;

/// Cross-product matrix: skew(a) b = a × b.
template <class Scalar>
Matrix3<Scalar> skew(const Vector3<Scalar>& a)
{
  Matrix3<Scalar> m;
  m << Scalar(0), -a.z(), a.y(), a.z(), Scalar(0), -a.x(), -a.y(), a.x(), Scalar(0);
  return m;
}

/// Twist (or any motion vector) at x + r from the one at x: (v + ω × r, ω).
template <class Scalar>
Vector6<Scalar> shift_twist(const Vector3<Scalar>& r, const Vector6<Scalar>& V)
{
  Vector6<Scalar> shifted;
  shifted.template head<3>() = V.template head<3>() + V.template tail<3>().cross(r);
  shifted.template tail<3>() = V.template tail<3>();
  return shifted;
}

/// Wrench about x of a wrench that is given about x + r: (f, n + r × f), the transpose of shift_twist.
template <class Scalar>
Vector6<Scalar> shift_wrench(const Vector3<Scalar>& r, const Vector6<Scalar>& w)
{
  Vector6<Scalar> shifted;
  shifted.template head<3>() = w.template head<3>();
  shifted.template tail<3>() = w.template tail<3>() + r.cross(w.template head<3>());
  return shifted;
}

/// Symmetric 6×6 map from accelerations to wrenches, [ M H ; Hᵀ J ], about one point.
template <class Scalar>
struct SpatialInertia {
  Matrix3<Scalar> M;  ///< force per linear acceleration, symmetric
  Matrix3<Scalar> H;  ///< force per angular acceleration
  Matrix3<Scalar> J;  ///< moment per angular acceleration, symmetric

  void set_zero()
  {
    M.setZero();
    H.setZero();
    J.setZero();
  }

  /// One rigid body: mass m, first moment mc = m·(centre − point), rotational inertia Θ about the point.
  void set_rigid(const Scalar& m, const Vector3<Scalar>& mc, const Matrix3<Scalar>& Theta)
  {
    M.setZero();
    M.diagonal().setConstant(m);
    H = skew<Scalar>(-mc);
    J = Theta;
  }

  SpatialInertia& operator+=(const SpatialInertia& other)
  {
    M += other.M;
    H += other.H;
    J += other.J;
    return *this;
  }

  /// Adds X(r)ᵀ A X(r): the inertia A, given about the point r away, about this point.
  void add_shifted(const SpatialInertia& A, const Vector3<Scalar>& r)
  {
    const Matrix3<Scalar> rx = skew(r);
    Matrix3<Scalar> H_shifted;
    H_shifted.noalias() = A.H - A.M.lazyProduct(rx);
    M += A.M;
    H += H_shifted;
    J += A.J;
    J.noalias() += rx.lazyProduct(H_shifted);
    J.noalias() -= A.H.transpose().lazyProduct(rx);
  }

  /// Wrench that gives the acceleration a, per unit of a's time derivative.
  Vector6<Scalar> operator*(const Vector6<Scalar>& a) const
  {
    Vector6<Scalar> w;
    w.template head<3>().noalias() =
        M.lazyProduct(a.template head<3>()) + H.lazyProduct(a.template tail<3>());
    w.template tail<3>().noalias() =
        H.transpose().lazyProduct(a.template head<3>()) + J.lazyProduct(a.template tail<3>());
    return w;
  }

  Matrix6<Scalar> dense() const
  {
    Matrix6<Scalar> A;
    A << M, H, H.transpose(), J;
    return A;
  }
};

}  // namespace iim
