// X between a link and its parent, in each of three frames.
#pragma once

#include <iim/iim.hpp>

namespace bench {

/// Axes and origin of the link; axes of the world, origin of the link; axes and origin of the world.
enum class Frames { body_fixed, own_origin, common_origin };

template <class Scalar, Frames frames>
struct Shift {
  using Vector3 = iim::Vector3<Scalar>;
  using Matrix3 = iim::Matrix3<Scalar>;
  using Vector6 = iim::Vector6<Scalar>;
  using Matrix6 = iim::Matrix6<Scalar>;

  Matrix3 E;  ///< link to parent (body-fixed)
  Vector3 r;  ///< from the parent's origin, in the parent's axes, or the world's (own origin)

  /// X m: the parent's motion vector seen from the link.
  Vector6 from_parent(const Vector6& m) const
  {
    if constexpr (frames == Frames::common_origin) { return m; }
    const Vector3 w = m.template tail<3>();
    const Vector3 v = m.template head<3>() + iim::detail::cross(w, r);
    Vector6 seen;
    if constexpr (frames == Frames::own_origin) {
      seen << v, w;
    } else {
      seen << E.transpose() * v, E.transpose() * w;
    }
    return seen;
  }

  /// Xᵀ f: the link's force vector seen from the parent.
  Vector6 to_parent(const Vector6& f) const
  {
    if constexpr (frames == Frames::common_origin) { return f; }
    Vector3 force = f.template head<3>();
    Vector3 moment = f.template tail<3>();
    if constexpr (frames == Frames::body_fixed) {
      force = E * force;
      moment = E * moment;
    }
    Vector6 seen;
    seen << force, moment + iim::detail::cross(r, force);
    return seen;
  }

  /// Xᵀ A X, by blocks [ M H ; Hᵀ J ].
  Matrix6 to_parent(const Matrix6& A) const
  {
    if constexpr (frames == Frames::common_origin) { return A; }
    Matrix3 M = A.template topLeftCorner<3, 3>();
    Matrix3 H = A.template topRightCorner<3, 3>();
    Matrix3 J = A.template bottomRightCorner<3, 3>();
    if constexpr (frames == Frames::body_fixed) {
      M = Matrix3(E * M) * E.transpose();
      H = Matrix3(E * H) * E.transpose();
      J = Matrix3(E * J) * E.transpose();
    }
    const Matrix3 rx = iim::skew(r);
    const Matrix3 S = H - M * rx;
    Matrix6 B;
    B << M, S, S.transpose(), J + rx * S - H.transpose() * rx;
    return B;
  }

  /// N X, row by row; the seventh column stays.
  Eigen::Matrix<Scalar, 6, 7> to_parent(Eigen::Matrix<Scalar, 6, 7> rows) const
  {
    for (int k = 0; k < 6; ++k) {
      const Vector6 row = rows.row(k).template head<6>().transpose();
      rows.row(k).template head<6>() = to_parent(row).transpose();
    }
    return rows;
  }
};

}  // namespace bench
