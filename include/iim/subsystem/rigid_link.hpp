// Rigid link: one body behind one joint.
#pragma once

#include <iim/subsystem/joint.hpp>

#include <array>
#include <string>

namespace iim {

/// One rigid body on a joint; its inputs are the generalised forces on the joint's velocities (B̄_i = (0; 1)).
/// The link's frame is the inlet frame after the joint's motion; the body is given in it.
template <class Joint>
struct RigidLink {
  using Scalar = typename Joint::Scalar;
  static constexpr int n_q = Joint::n_q;
  static constexpr int n_i = Joint::n_i;
  static constexpr int n_u = Joint::n_i;
  static constexpr int n_frames = 1;
  static constexpr MotionPattern pattern = Joint::pattern;
  static constexpr bool is_fixed = detail::is_fixed<Joint>();

  Joint joint{};
  Body<Scalar> body{};

  [[gnu::cold]] void prepare(const std::string& name)
  {
    joint.prepare(name);
    validate(body, name);
  }

  bool motion(const Matrix3<Scalar>& R, const Eigen::Matrix<Scalar, n_q, 1>& q, const Eigen::Matrix<Scalar, n_i, 1>& qd,
              std::array<FrameMotion<Scalar, n_i>, 1>& frames) const
  {
    return joint.motion(R, q, qd, frames[0]);
  }

  [[gnu::always_inline]] bool motion(const Matrix3<Scalar>& R, const Turn<Scalar>& q,
                                     const Eigen::Matrix<Scalar, n_i, 1>& qd,
                                     std::array<FrameMotion<Scalar, n_i>, 1>& frames) const
    requires requires(const Joint& j) { j.motion(R, q, qd, frames[0]); }
  {
    return joint.motion(R, q, qd, frames[0]);
  }

  Vector6<Scalar> own_twist() const
    requires requires(const Joint& j) { j.own_twist(); }
  {
    return joint.own_twist();
  }

  auto inlet_twists() const
    requires requires(const Joint& j) { j.inlet_twists(); }
  {
    return joint.inlet_twists();
  }

  auto neutral() const
    requires requires(const Joint& j) { j.neutral(); }
  {
    return joint.neutral();
  }

  void normalize(Eigen::Matrix<Scalar, n_q, 1>& q) const
    requires requires(const Joint& j) { j.normalize(q); }
  {
    joint.normalize(q);
  }

  auto coordinate_rate(const Eigen::Matrix<Scalar, n_q, 1>& q, const Eigen::Matrix<Scalar, n_i, 1>& qd) const
    requires requires(const Joint& j) { j.coordinate_rate(q, qd); }
  {
    return joint.coordinate_rate(q, qd);
  }

  Body<Scalar>& fixed_body() { return body; }
  std::array<CarriedBody<Scalar>, 1> bodies() const { return {{{0, body}}}; }

  Eigen::Matrix<Scalar, n_i, n_u> Bbar(const Eigen::Matrix<Scalar, n_q, 1>&) const
  {
    return Eigen::Matrix<Scalar, n_i, n_u>::Identity();
  }

  template <class T>
  auto cast() const
  {
    return RigidLink<decltype(joint.template cast<T>())>{joint.template cast<T>(), body.template cast<T>()};
  }
};

template <class Joint, class BodyType>
RigidLink(Joint, BodyType) -> RigidLink<Joint>;

template <class Scalar>
using RevoluteLink = RigidLink<Revolute<Scalar>>;
template <class Scalar>
using PrismaticLink = RigidLink<Prismatic<Scalar>>;
/// A body fixed on a frame. On a link, a motor-arm, a floating base or another FixedLink it is part of that body in a
/// tree, and its name that of a frame (Assembly::merged): it costs nothing. On the world and on types without
/// fixed_body() it is a subsystem without coordinates, of some 40 ns.
template <class Scalar>
using FixedLink = RigidLink<Fixed<Scalar>>;

static_assert(Subsystem<RevoluteLink<double>>);
static_assert(Subsystem<PrismaticLink<double>>);
static_assert(Subsystem<FixedLink<double>>);

}  // namespace iim
