// The square root of a rigid body's inertia, for the square-root form of the O(n) pass.
#pragma once

#include <iim/body.hpp>
#include <iim/spatial.hpp>

#include <cmath>
#include <utility>

namespace iim::detail {

/// Eigenvalues and eigenvectors of a symmetric matrix by Jacobi's rotations: small eigenvalues keep their own digits,
/// and any Scalar with a square root will do.
template <class Scalar>
void principal_axes(Matrix3<Scalar> I, Vector3<Scalar>& moment, Matrix3<Scalar>& axes)
{
  using std::abs;
  using std::sqrt;
  const Scalar epsilon = Eigen::NumTraits<Scalar>::epsilon();
  axes.setIdentity();
  for (int sweep = 0; sweep < 32; ++sweep) {
    bool diagonal = true;
    for (int p = 0; p < 2; ++p) {
      for (int q = p + 1; q < 3; ++q) {
        if (!(abs(I(p, q)) > epsilon * sqrt(abs(I(p, p))) * sqrt(abs(I(q, q))))) { continue; }
        diagonal = false;
        // t = tan of the angle that makes I(p, q) zero, the smaller of the two
        const Scalar theta = (I(q, q) - I(p, p)) / (Scalar(2) * I(p, q));
        const Scalar root = sqrt(theta * theta + Scalar(1));
        const Scalar t = theta > Scalar(0) ? Scalar(1) / (theta + root) : Scalar(1) / (theta - root);
        const Scalar c = Scalar(1) / sqrt(t * t + Scalar(1));
        const Scalar s = t * c;
        Matrix3<Scalar> J = Matrix3<Scalar>::Identity();
        J(p, p) = c, J(q, q) = c, J(p, q) = s, J(q, p) = -s;
        I = Matrix3<Scalar>(J.transpose() * I * J);
        axes = Matrix3<Scalar>(axes * J);
      }
    }
    if (diagonal) { break; }
  }
  moment = I.diagonal();
}

/// The rigid body that one frame carries, by its principal axes: constants of N_b and z_b.
template <class Scalar>
struct BodyRoot {
  static constexpr int most_rows = 6;
  Scalar root_mass = Scalar(0);                           ///< √m
  Vector3<Scalar> com = Vector3<Scalar>::Zero();          ///< in the frame
  Matrix3<Scalar> axes = Matrix3<Scalar>::Identity();     ///< principal axes, right-handed, in the frame
  Matrix3<Scalar> to_axes = Matrix3<Scalar>::Identity();  ///< its transpose
  Vector3<Scalar> root_moment = Vector3<Scalar>::Zero();  ///< √θ, zeros last
  Vector3<Scalar> gyration = Vector3<Scalar>::Zero();     ///< (θ_j − θ_i) / √θ_k, k, i, j cyclic
  Vector3<Scalar> linear = Vector3<Scalar>::Zero();   ///< N_b S of an own_twist(): the first three, in the frame's axes
  Vector3<Scalar> angular = Vector3<Scalar>::Zero();  ///< and the other three
  Scalar own_scale = Scalar(0);                       ///< Σ of both if nothing cancelled
  /// θ_j − θ_i of an axis without row, which the body then needs a moment to turn about: of Body::any_moments, or of
  /// what is less than the roundings of a file.
  Vector3<Scalar> beside = Vector3<Scalar>::Zero();
  bool has_beside = false;
  int rows = 0;

  BodyRoot() = default;
  explicit BodyRoot(const FrameMass<Scalar>& body)
  {
    using std::abs;
    using std::sqrt;
    if (!body.present) { return; }
    root_mass = sqrt(body.mass);
    com = body.centre;
    Vector3<Scalar> moment = body.central_inertia.diagonal();
    const Matrix3<Scalar> diagonal = moment.asDiagonal();
    Scalar roundings(0);
    if (body.central_inertia != diagonal) {
      principal_axes(body.central_inertia, moment, axes);
      // A rotor across its axis has two moments; the third is what the matrix rounds, and of a small body beside it
      // many times.
      roundings = Scalar(4) * Eigen::NumTraits<Scalar>::epsilon() * moment.maxCoeff();
    }
    for (int pass = 0; pass < 2; ++pass) {  // largest first
      for (int k = 0; k < 2; ++k) {
        if (moment(k) < moment(k + 1)) {
          std::swap(moment(k), moment(k + 1));
          axes.col(k).swap(axes.col(k + 1));
        }
      }
    }
    axes.col(2) = axes.col(0).cross(axes.col(1));
    to_axes = axes.transpose();
    rows = 3;
    for (int k = 0; k < 3; ++k) {
      const Scalar difference = moment((k + 2) % 3) - moment((k + 1) % 3);
      if (moment(k) > roundings) {
        root_moment(k) = sqrt(moment(k));
        gyration(k) = difference / root_moment(k);
        ++rows;
      } else if (abs(difference) > Scalar(64) * Eigen::NumTraits<Scalar>::epsilon() * moment(0)) {
        beside(k) = difference;
        has_beside = true;
      }
    }
  }

  void set_own_twist(const Vector6<Scalar>& S)
  {
    using std::abs;
    const Vector3<Scalar> v = S.template head<3>(), w = S.template tail<3>();
    linear = root_mass * (v + cross(w, com));
    own_scale = Scalar(0);
    for (int k = 0; k < 3; ++k) {
      const int i = (k + 1) % 3, j = (k + 2) % 3;
      angular(k) = root_moment(k) * axes.col(k).dot(w);
      own_scale += root_mass * (abs(v(k)) + abs(w(i) * com(j)) + abs(w(j) * com(i)));
      own_scale += root_moment(k) * axes.col(k).cwiseAbs().dot(w.cwiseAbs());
    }
  }
};

/// Moment (world axes) that the body needs to turn about axes where it has no row.
template <class Scalar>
[[gnu::noinline]] Vector3<Scalar> moment_beside(const BodyRoot<Scalar>& body, const Matrix3<Scalar>& R,
                                                const Vector3<Scalar>& omega)
{
  Matrix3<Scalar> p;
  multiply(R, body.axes, p);
  Vector3<Scalar> spin, m(Scalar(0), Scalar(0), Scalar(0));
  for (int k = 0; k < 3; ++k) { spin(k) = p(0, k) * omega(0) + p(1, k) * omega(1) + p(2, k) * omega(2); }
  for (int k = 0; k < 3; ++k) {
    const Scalar along = body.beside(k) * spin((k + 1) % 3) * spin((k + 2) % 3);
    for (int i = 0; i < 3; ++i) { m(i) += p(i, k) * along; }
  }
  return m;
}

/// Part of z in the rows of moments that a moment m on a body is, N_bᵀ z = −m; takes from m what these rows carry. As a
/// wrench beside N, m would act by its roundings on what turns freely about the axis where the body has no row, be that
/// ever so light.
template <class Scalar>
Vector3<Scalar> moment_of_rows(const BodyRoot<Scalar>& body, const Matrix3<Scalar>& R, Vector3<Scalar>& m)
{
  using std::abs;
  Vector3<Scalar> z(Scalar(0), Scalar(0), Scalar(0)), left = m;
  Matrix3<Scalar> p;
  multiply(R, body.axes, p);
  for (int k = 0; k < body.rows - 3; ++k) {
    const Scalar along = p(0, k) * m(0) + p(1, k) * m(1) + p(2, k) * m(2);
    z(k) = -along / body.root_moment(k);
    for (int i = 0; i < 3; ++i) { left(i) -= along * p(i, k); }
  }
  // m is at right angles to the rotor's axis, about which its body has no row; the roundings of I − a aᵀ turn the
  // body's axes.
  const Scalar roundings = Scalar(256) * Eigen::NumTraits<Scalar>::epsilon() * (abs(m(0)) + abs(m(1)) + abs(m(2)));
  for (int i = 0; i < 3; ++i) { m(i) = abs(left(i)) > roundings ? left(i) : Scalar(0); }
  return z;
}

}  // namespace iim::detail
