// Articulated bodies in other frames than the library's, for the curve of error against run time only.
//
// The O(n) pass and B̂ by unit forces in spatial vectors (linear before angular), one text for three frames per link:
//
//     body_fixed     axes and origin of the link: X rotates and shifts, inertias and axes are constants
//     own_origin     axes of the world, origin of the link: X shifts (the library's choice; here as a check)
//     common_origin  axes and origin of the world: X = 1, inertias hold m r² of the distance from the origin
//
// v_i = X v_p + S q̇,   a_i = X a_p + v_i × S q̇ + S q̈,   with a the true spatial acceleration: no Ẋ anywhere.
#pragma once

#include "../common/pool.hpp"
#include "frame_conventions_root.hpp"
#include "frame_conventions_shift.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>
#include <type_traits>
#include <vector>

namespace bench {

/// Trees of revolute and prismatic links and motor-arms and floating bases (on the world); rotors without own mass.
template <class Scalar, Frames frames, iim::Update update>
class FrameConvention {
  static constexpr bool by_roots = update == iim::Update::square_root;

public:
  using TreeType = Tree<Scalar>;
  using Vector3 = iim::Vector3<Scalar>;
  using Matrix3 = iim::Matrix3<Scalar>;
  using Vector6 = iim::Vector6<Scalar>;
  using Matrix6 = iim::Matrix6<Scalar>;

  FrameConvention(const TreeType& tree, const iim::Inputs<TreeType>& inputs)
      : gravity_(tree.gravity()), qdd0_(tree.n_v()), Bhat_(tree.n_v(), inputs.columns())
  {
    tree.outward([&]<class N, class S>(const N& node, const S& s) { add_link(tree, node, s); });
    std::vector<std::vector<Column>> of_link(links_.size());
    inputs.for_each_active([&](const auto& input, Index first) {
      for (Index j = 0; j < input.size; ++j) {
        if (input.kind == iim::InputKind::wrench || input.axes == iim::Axes::body) {
          throw std::invalid_argument("only motors, and forces in world axes");
        }
        of_link[at(input.subsystem)].push_back({first + j, j, input.kind == iim::InputKind::motor, input.point});
      }
    });
    for (std::size_t i = 0; i < links_.size(); ++i) {
      links_[i].first = static_cast<Index>(columns_.size());
      columns_.insert(columns_.end(), of_link[i].begin(), of_link[i].end());
      links_[i].own_end = static_cast<Index>(columns_.size());
    }
    for (Link& link : links_) { link.end = links_[at(link.last)].own_end; }
    for (Link& link : links_) {
      link.P.resize(6, inputs.columns());
      link.acceleration.resize(6, inputs.columns());
      link.tau.resize(link.n_i, inputs.columns());
    }
  }

  template <class Q, class V>
  iim::AffineDynamics<Scalar> operator()(const Q& q, const V& qd)
  {
    status_ = iim::Status::ok;
    for (Link& link : links_) { link.n_i == 6 ? outward<6>(link, q, qd) : outward<1>(link, q, qd); }
    for (auto link = links_.rbegin(); link != links_.rend(); ++link) {
      link->n_i == 6 ? inward<6>(*link) : inward<1>(*link);
    }
    for (Link& link : links_) { link.n_i == 6 ? accelerate<6>(link) : accelerate<1>(link); }
    const bool finite = iim::detail::all_finite(qdd0_) && iim::detail::all_finite(Bhat_);
    if (status_ == iim::Status::ok && !finite) { status_ = iim::Status::not_finite; }
    const Eigen::OuterStride<> stride(Bhat_.rows());
    return {{qdd0_.data(), qdd0_.size()}, {Bhat_.data(), Bhat_.rows(), Bhat_.cols(), stride}, status_, -1};
  }

private:
  struct Link {
    Index parent, q, first_v, last;  ///< last: of the subtree
    int n_i;
    bool turns;
    Vector3 axis, p0;  ///< joint axis in the link, coupling point in the parent
    Matrix3 R0;
    Scalar mass{0};
    Vector3 com = Vector3::Zero();
    Matrix3 inertia = Matrix3::Zero();
    Matrix3 principal_axes = Matrix3::Identity();
    Vector3 principal_moments = Vector3::Zero();
    Scalar ratio{1}, J{0};
    Vector3 rotor = Vector3::Zero();  ///< axis of a coupled rotor in inlet axes
    Index first, own_end, end;        ///< columns on the link, and on its subtree

    Matrix3 R;  ///< link to world
    Vector3 o;  ///< origin in the world
    Shift<Scalar, frames> X;
    Matrix6 S, U, W_T, D_inv;
    Vector3 a, moment;  ///< rotor axis, and moment of its turning spin
    Vector6 v, c, p, acc;
    Matrix6 A;
    RootRows<Scalar> root;  ///< in place of A and most of p
    Vector6 psi;
    Eigen::Matrix<Scalar, 6, Eigen::Dynamic> P, acceleration;
    Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic> tau;
  };
  struct Column {
    Index bhat, component;
    bool motor;
    Vector3 point;
  };

  static std::size_t at(Index i) { return static_cast<std::size_t>(i); }

  template <class N, class S>
  void add_link(const TreeType& tree, const N& node, const S& s)
  {
    Link link;
    link.parent = node.parent;
    link.q = node.q;
    link.first_v = node.v;
    link.last = node.subtree_end - 1;
    link.n_i = S::n_i;
    link.turns = true;
    link.R0 = tree.placement(node.index).R;
    link.p0 = tree.placement(node.index).p;
    link.axis.setZero();
    if constexpr (requires { s.joint.axis; }) {
      link.turns = std::is_same_v<std::remove_cvref_t<decltype(s.joint)>, iim::Revolute<Scalar>>;
      link.axis = s.joint.axis.normalized();
    } else if (S::n_i != 6 || node.parent >= 0) {
      throw std::invalid_argument("no such subsystem in other frames");
    }
    if (!s.body.is_massless) {
      link.mass = s.body.mass;
      link.com = s.body.com;
      link.inertia = s.body.inertia;
      const Eigen::SelfAdjointEigenSolver<Matrix3> principal(link.inertia);
      link.principal_axes = principal.eigenvectors();
      if (link.principal_axes.determinant() < Scalar(0)) { link.principal_axes.col(0) *= Scalar(-1); }
      link.principal_moments = principal.eigenvalues();
    }
    if constexpr (requires { s.motor; }) {
      if (s.motor.mass > Scalar(0)) { throw std::invalid_argument("no rotors with mass in other frames"); }
      link.ratio = s.motor.gear_ratio;
      link.J = s.motor.axial_inertia;
      if (!s.motor.armature) { link.rotor = s.motor.axis; }
    }
    links_.push_back(link);
  }

  static Vector3 cross(const Vector3& a, const Vector3& b) { return iim::detail::cross(a, b); }

  static Vector6 motion(const Vector3& linear, const Vector3& angular)
  {
    Vector6 m;
    m << linear, angular;
    return m;
  }

  static Vector6 cross_motion(const Vector6& v, const Vector6& m)
  {
    const Vector3 w = v.template tail<3>();
    const Vector3 mw = m.template tail<3>();
    return motion(cross(w, m.template head<3>()) + cross(v.template head<3>(), mw), cross(w, mw));
  }
  static Vector6 cross_force(const Vector6& v, const Vector6& f)
  {
    const Vector3 w = v.template tail<3>();
    const Vector3 force = f.template head<3>();
    return motion(cross(w, force), cross(w, f.template tail<3>()) + cross(v.template head<3>(), force));
  }

  // --- the three loops ---------------------------------------------------------------------------------------------

  template <int n, class Q, class V>
  void outward(Link& link, const Q& q, const V& qd)
  {
    const bool root = link.parent < 0;
    Matrix3 turn = Matrix3::Identity();
    Vector3 slide = Vector3::Zero();
    if constexpr (n == 6) {
      turn = Eigen::Quaternion<Scalar>(q(link.q + 6), q(link.q + 3), q(link.q + 4), q(link.q + 5))
                 .normalized()
                 .toRotationMatrix();
      slide = q.template segment<3>(link.q);
    } else if (link.turns) {
      turn = Eigen::AngleAxis<Scalar>(q(link.q), link.axis).toRotationMatrix();
    } else {
      slide = link.axis * q(link.q);
    }
    link.X.E = link.R0 * turn;
    link.X.r = link.p0 + link.R0 * slide;
    if (root) {
      link.R = link.X.E;
      link.o = link.X.r;
    } else {
      const Link& parent = links_[at(link.parent)];
      link.R = parent.R * link.X.E;
      const Vector3 apart = parent.R * link.X.r;
      link.o = parent.o + apart;
      if constexpr (frames == Frames::own_origin) { link.X.r = apart; }
    }
    // Axes of the frame in which everything is written, and the frame's origin seen from the link's.
    Matrix3 axes = link.R;
    Vector3 origin = -link.o;
    if constexpr (frames == Frames::body_fixed) { axes = Matrix3::Identity(); }
    if constexpr (frames != Frames::common_origin) { origin.setZero(); }
    link.S.setZero();
    if constexpr (n == 6) {
      link.S.template topLeftCorner<3, 3>() = axes;
      link.S.template bottomRightCorner<3, 3>() = axes;
      link.S.template topRightCorner<3, 3>() = -iim::skew(origin) * axes;
    } else {
      const Vector3 a = axes * link.axis;
      link.S.col(0) = link.turns ? motion(cross(a, origin), a) : motion(a, Vector3::Zero());
    }
    const Vector6 own = link.S.template leftCols<n>() * qd.template segment<n>(link.first_v);
    link.v = own;
    link.moment.setZero();
    link.a.setZero();
    Vector6 guided = Vector6::Zero();
    if (!root) { guided = link.X.from_parent(links_[at(link.parent)].v); }
    link.v += guided;
    link.c = cross_motion(link.v, own);
    if (link.J > Scalar(0)) {
      // axes · turnᵀ: from inlet axes
      link.a = axes * (turn.transpose() * link.rotor);
      const Vector3 w = guided.template tail<3>();
      link.moment = cross(w, link.a) * (link.J * (link.a.dot(w) + link.ratio * qd(link.first_v)));
    }
    const Vector3 s = axes * link.com - origin;
    if constexpr (by_roots) {
      link.root = body_rows<Scalar>(link.mass, s, axes * link.principal_axes, link.principal_moments, link.v);
      link.p.setZero();
    } else {
      const Matrix3 sx = iim::skew(s);
      link.A.template topLeftCorner<3, 3>() = link.mass * Matrix3::Identity();
      link.A.template topRightCorner<3, 3>() = -link.mass * sx;
      link.A.template bottomLeftCorner<3, 3>() = link.mass * sx;
      link.A.template bottomRightCorner<3, 3>() =
          Matrix3(axes * link.inertia) * axes.transpose() - link.mass * (sx * sx);
      link.p = cross_force(link.v, Vector6(link.A * link.v));
    }
    for (Index j = link.first; j < link.end; ++j) { link.P.col(j).setZero(); }
    for (Index j = link.first; j < link.own_end; ++j) {
      const Column& column = columns_[at(j)];
      if (column.motor) { continue; }
      Vector3 force = Vector3::Unit(column.component);
      if constexpr (frames == Frames::body_fixed) { force = link.R.row(column.component).transpose(); }
      link.P.col(j) = motion(force, cross(axes * column.point - origin, force));
    }
  }

  template <int n>
  void inward(Link& link)
  {
    const auto S = link.S.template leftCols<n>();
    const auto W_T = link.W_T.template leftCols<n>();
    if constexpr (by_roots) {
      eliminate_rows<n>(link);
    } else {
      eliminate<n>(link);
    }
    for (Index j = link.first; j < link.end; ++j) {
      auto tau = link.tau.col(j).template head<n>();
      tau.noalias() = S.transpose() * link.P.col(j);
      if (j < link.own_end && columns_[at(j)].motor) { tau(0) += link.ratio; }
    }
    if (link.parent < 0) { return; }
    Link& parent = links_[at(link.parent)];
    if constexpr (by_roots) {
      parent.root = compressed<Scalar>(parent.root, link.X.to_parent(link.root));
    } else {
      parent.A += link.X.to_parent(link.A);
    }
    link.p.template tail<3>() += link.moment;
    parent.p += link.X.to_parent(link.p);
    for (Index j = link.first; j < link.end; ++j) {
      const Vector6 wrench = link.P.col(j) - W_T * link.tau.col(j).template head<n>();
      parent.P.col(j) += link.X.to_parent(wrench);
    }
  }

  /// W, D⁻¹, psi; then A and p as they are with the joint free to give way.
  template <int n>
  void eliminate(Link& link)
  {
    const auto S = link.S.template leftCols<n>();
    auto U = link.U.template leftCols<n>();
    auto W_T = link.W_T.template leftCols<n>();
    U.noalias() = link.A * S;
    Eigen::Matrix<Scalar, n, n> D = S.transpose() * U;
    if (link.J > Scalar(0)) {
      D(0, 0) += link.J * link.ratio * link.ratio;
      U.template bottomRows<3>().col(0) += link.J * link.ratio * link.a;
    }
    const Vector6 f = link.p + link.A * link.c;
    const Eigen::Matrix<Scalar, n, 1> h = S.transpose() * f;
    auto D_inv = link.D_inv.template topLeftCorner<n, n>();
    if constexpr (n == 1) {
      if (!iim::ScalarTraits<Scalar>::is_positive(D(0, 0))) { status_ = iim::Status::not_positive_definite; }
      D_inv(0, 0) = Scalar(1) / D(0, 0);
      W_T = U * D_inv(0, 0);
    } else {
      const Eigen::LLT<Eigen::Matrix<Scalar, n, n>> llt(D);
      if (llt.info() != Eigen::Success) { status_ = iim::Status::not_positive_definite; }
      D_inv = llt.solve(Eigen::Matrix<Scalar, n, n>::Identity());
      W_T.noalias() = U * D_inv;
    }
    link.psi.template head<n>() = D_inv * h;
    link.p = f - W_T * h;
    if constexpr (update == iim::Update::projected) {
      const Matrix6 T = link.A - (link.A * S).eval() * W_T.transpose();
      link.A = T - W_T * (S.transpose() * T).eval();
      if (link.J > Scalar(0)) {
        const Vector6 w = motion(Vector3::Zero(), link.a) - link.ratio * W_T.col(0);
        link.A += (link.J * w) * w.transpose();
      }
    } else {
      link.A -= U * W_T.transpose();
      if (link.J > Scalar(0)) { link.A.template bottomRightCorner<3, 3>() += (link.J * link.a) * link.a.transpose(); }
    }
  }

  /// The same in square-root form; p has the moments of turning rotors only, all else is in z.
  template <int n>
  void eliminate_rows(Link& link)
  {
    const auto S = link.S.template leftCols<n>();
    auto W_T = link.W_T.template leftCols<n>();
    auto D_inv = link.D_inv.template topLeftCorner<n, n>();
    auto psi = link.psi.template head<n>();
    const Matrix6 N = link.root.template leftCols<6>();
    const Vector6 z = link.root.col(6) - N * link.c;
    const Eigen::Matrix<Scalar, n, 1> h = S.transpose() * link.p;
    if constexpr (n == 1) {
      Eigen::Matrix<Scalar, 7, 8> rows = Eigen::Matrix<Scalar, 7, 8>::Zero();
      rows.template topRows<6>() << N * S, N, z;
      if (link.J > Scalar(0)) {
        const Scalar root = std::sqrt(link.J);
        rows(6, 0) = root * link.ratio;
        rows.template block<1, 3>(6, 4) = root * link.a.transpose();
      }
      reflect(rows);
      const Scalar v = rows(0, 0);
      if (!iim::ScalarTraits<Scalar>::is_positive(v * v)) { status_ = iim::Status::not_positive_definite; }
      D_inv(0, 0) = Scalar(1) / (v * v);
      W_T = rows.template block<1, 6>(0, 1).transpose() / v;
      psi(0) = D_inv(0, 0) * h(0) - rows(0, 7) / v;
      link.root = rows.template bottomRightCorner<6, 7>();
    } else {
      const Eigen::ColPivHouseholderQR<Matrix6> qr(N * S);
      if (!(qr.absDeterminant() > Scalar(0))) { status_ = iim::Status::not_positive_definite; }
      const Matrix6 inverse = qr.solve(Matrix6::Identity());
      D_inv = inverse * inverse.transpose();
      W_T = (inverse * N).transpose();
      psi = D_inv * h - inverse * z;
    }
    link.p -= W_T * h;
  }

  template <int n>
  void accelerate(Link& link)
  {
    const auto S = link.S.template leftCols<n>();
    const auto W_T = link.W_T.template leftCols<n>();
    const bool root = link.parent < 0;
    Vector6 y = motion(-gravity_, Vector3::Zero());
    if (!root) {
      y = link.X.from_parent(links_[at(link.parent)].acc);
    } else if constexpr (frames == Frames::body_fixed) {
      y.template head<3>() = link.X.E.transpose() * Vector3(-gravity_);
    }
    const Eigen::Matrix<Scalar, n, 1> qdd = -link.psi.template head<n>() - W_T.transpose() * y;
    qdd0_.template segment<n>(link.first_v) = qdd;
    link.acc = y + link.c + S * qdd;
    const auto D_inv = link.D_inv.template topLeftCorner<n, n>();
    for (Index j = 0; j < static_cast<Index>(columns_.size()); ++j) {
      Eigen::Matrix<Scalar, n, 1> x = Eigen::Matrix<Scalar, n, 1>::Zero();
      if (j >= link.first && j < link.end) { x.noalias() = D_inv * link.tau.col(j).template head<n>(); }
      if (root) {
        link.acceleration.col(j).noalias() = S * x;
      } else {
        const Vector6 guided = link.X.from_parent(links_[at(link.parent)].acceleration.col(j));
        x.noalias() -= W_T.transpose() * guided;
        link.acceleration.col(j) = guided + S * x;
      }
      Bhat_.col(columns_[at(j)].bhat).template segment<n>(link.first_v) = x;
    }
  }

  Vector3 gravity_;
  std::vector<Link> links_;
  std::vector<Column> columns_;  // sorted along the tree
  iim::VectorX<Scalar> qdd0_;
  iim::MatrixX<Scalar> Bhat_;
  iim::Status status_ = iim::Status::ok;
};

}  // namespace bench
