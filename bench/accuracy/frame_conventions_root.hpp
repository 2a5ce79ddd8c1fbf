// The square-root form in any frames: rows [ N | z ] with A = NᵀN, of which a body or a subtree minimises |N a − z|².
#pragma once

#include <iim/iim.hpp>

#include <Eigen/Householder>
#include <Eigen/QR>

#include <algorithm>
#include <array>
#include <cmath>

namespace bench {

template <class Scalar>
using RootRows = Eigen::Matrix<Scalar, 6, 7>;

/// Of one body with twist v. s: its centre of mass; columns of `axes`: its principal axes.
template <class Scalar>
RootRows<Scalar> body_rows(const Scalar& mass, const iim::Vector3<Scalar>& s, const iim::Matrix3<Scalar>& axes,
                           const iim::Vector3<Scalar>& moments, const iim::Vector6<Scalar>& v)
{
  using std::sqrt;
  const iim::Vector3<Scalar> w = v.template tail<3>();
  const iim::Vector3<Scalar> w_in_axes = axes.transpose() * w;
  const Scalar root = sqrt(mass);
  RootRows<Scalar> rows = RootRows<Scalar>::Zero();
  rows.template topLeftCorner<3, 3>().diagonal().setConstant(root);
  rows.template block<3, 3>(0, 3) = -root * iim::skew(s);
  const iim::Vector3<Scalar> v_of_centre = v.template head<3>() + iim::detail::cross(w, s);
  rows.col(6).template head<3>() = -root * iim::detail::cross(w, v_of_centre);
  for (int k = 0; k < 3; ++k) {
    if (!(moments(k) > Scalar(0))) { continue; }
    const int i = (k + 1) % 3;
    const int j = (k + 2) % 3;
    const Scalar root_k = sqrt(moments(k));
    rows.row(3 + k).template segment<3>(3) = root_k * axes.col(k).transpose();
    rows(3 + k, 6) = (moments(i) - moments(j)) / root_k * w_in_axes(i) * w_in_axes(j);
  }
  return rows;
}

/// Two sets of rows as one of six: QR with rows sorted by size and pivoted columns.
template <class Scalar>
RootRows<Scalar> compressed(const RootRows<Scalar>& a, const RootRows<Scalar>& b)
{
  std::array<Eigen::Index, 12> order;
  std::array<Scalar, 12> size;
  const auto row = [&](Eigen::Index k) { return k < 6 ? a.row(k) : b.row(k - 6); };
  for (std::size_t k = 0; k < 12; ++k) {
    order[k] = static_cast<Eigen::Index>(k);
    size[k] = row(order[k]).template head<6>().cwiseAbs().maxCoeff();
  }
  std::stable_sort(order.begin(), order.end(), [&](auto i, auto j) {
    return size[static_cast<std::size_t>(i)] > size[static_cast<std::size_t>(j)];
  });
  Eigen::Matrix<Scalar, 12, 6> N;
  Eigen::Matrix<Scalar, 12, 1> z;
  for (Eigen::Index k = 0; k < 12; ++k) {
    N.row(k) = row(order[static_cast<std::size_t>(k)]).template head<6>();
    z(k) = row(order[static_cast<std::size_t>(k)])(6);
  }
  const Eigen::ColPivHouseholderQR<Eigen::Matrix<Scalar, 12, 6>> qr(N);
  z.applyOnTheLeft(qr.householderQ().adjoint());
  Eigen::Matrix<Scalar, 6, 6> R = qr.matrixQR().template topRows<6>();
  R.template triangularView<Eigen::StrictlyLower>().setZero();
  RootRows<Scalar> rows;
  rows.template leftCols<6>() = R * qr.colsPermutation().transpose();
  rows.col(6) = z.template head<6>();
  return rows;
}

/// Rows [ v | N | z ], reflected so that only the first has a v; the row with the largest v is the pivot.
template <class Scalar>
void reflect(Eigen::Matrix<Scalar, 7, 8>& rows)
{
  Eigen::Index pivot = 0;
  rows.col(0).cwiseAbs().maxCoeff(&pivot);
  rows.row(0).swap(rows.row(pivot));
  Eigen::Matrix<Scalar, 6, 1> essential;
  Scalar factor, length;
  rows.col(0).makeHouseholder(essential, factor, length);
  Eigen::Matrix<Scalar, 7, 1> memory;
  rows.template rightCols<7>().applyHouseholderOnTheLeft(essential, factor, memory.data());
  rows.col(0).setZero();
  rows(0, 0) = length;
}

}  // namespace bench
