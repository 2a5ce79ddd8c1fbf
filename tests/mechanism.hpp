// A subsystem with what the library's own types do not have: several frames and velocities, springs, a rotor that rides
// on a moving frame, a mass on the inlet. And a robot of two of them, on which the methods are compared.
#pragma once

#include <iim/global_inverse.hpp>
#include <iim/iim.hpp>
#include <iim/recursive_inverse.hpp>
#include <iim/unit_force.hpp>

#include "catch.hpp"
#include "random_tree.hpp"

#include <array>
#include <cmath>
#include <cstdint>
#include <string>

namespace iim::test {

/// A cross on a joint about x, carrying a joint about its y; a slider along z of the inlet beside it; a rotor on the
/// cross that the second joint drives; a housing on the inlet; springs on all three.
struct Mechanism {
  using Scalar = double;
  static constexpr int n_q = 3;
  static constexpr int n_i = 3;
  static constexpr int n_u = 2;
  static constexpr int n_frames = 3;
  static constexpr MotionPattern pattern{};

  std::array<Body<double>, 4> parts{};
  double stiffness = 0;

  void prepare(const std::string& name)
  {
    for (const Body<double>& part : parts) { validate(part, name); }
  }

  bool motion(const Matrix3<double>& R, const Eigen::Vector3d& q, const Eigen::Vector3d& qd,
              std::array<FrameMotion<double, 3>, 3>& frames) const
  {
    const Eigen::Vector3d x = R.col(0), z = R.col(2);
    const Matrix3<double> cross = R * Eigen::AngleAxisd(q(0), Eigen::Vector3d::UnitX()).toRotationMatrix();
    const Eigen::Vector3d y = cross.col(1);
    // The cross stands at the coupling point, the arm's axis 0.2 m out on it.
    const Eigen::Vector3d p = 0.2 * cross.col(2);
    frames[0].R = cross;
    frames[0].S.col(0) << 0, 0, 0, x;
    frames[1].R = cross * Eigen::AngleAxisd(q(1), Eigen::Vector3d::UnitY()).toRotationMatrix();
    frames[1].r = p;
    frames[1].S.col(0) << 0, 0, 0, x;
    frames[1].S.col(1) << p.cross(y), y;  // at the coupling point: −ω × p
    frames[1].bias << bias_of_arm(x, y, p, qd), qd(0) * qd(1) * x.cross(y);
    frames[2].R = R;
    frames[2].r = q(2) * z;
    frames[2].S.col(2) << z, 0, 0, 0;
    return true;
  }

  /// Acceleration, for q̈ = 0, of the arm's point that is at the coupling point now. p: from there to the arm's axis.
  static Eigen::Vector3d bias_of_arm(const Eigen::Vector3d& x, const Eigen::Vector3d& y, const Eigen::Vector3d& p,
                                     const Eigen::Vector3d& qd)
  {
    const Eigen::Vector3d cross_rate = qd(0) * x, arm_rate = cross_rate + qd(1) * y;
    const Eigen::Vector3d turning = qd(0) * qd(1) * x.cross(y);
    // The arm's origin moves as a point of the cross; back from there to the coupling point as a point of the arm.
    return cross_rate.cross(cross_rate.cross(p)) - turning.cross(p) - arm_rate.cross(arm_rate.cross(p));
  }

  std::array<CarriedBody<double>, 4> bodies() const
  {
    return {{{0, parts[0]}, {1, parts[1]}, {2, parts[2]}, {-1, parts[3]}}};
  }

  std::array<Rotor<double, 3>, 2> rotors() const
  {
    return {{{0, Eigen::Vector3d(0.6, 0, 0.8), 2e-4, {0, 40, 0}, true},
             {-1, Eigen::Vector3d::UnitY(), 1e-4, {0, 0, 60}, false}}};
  }

  Eigen::Matrix<double, 3, 2> Bbar(const Eigen::Vector3d& q) const
  {
    Eigen::Matrix<double, 3, 2> B;
    B << 30, 0, std::cos(q(0)), 40, 0, -1;
    return B;
  }

  Eigen::Vector3d internal_force(const Eigen::Vector3d& q, const Eigen::Vector3d& qd) const
  {
    return stiffness * q + 0.1 * qd;
  }
};
static_assert(Subsystem<Mechanism>);

using MechanismParts = Assembly<Mechanism, FloatingBase<double>, MotorArm<double>, FixedLink<double>>;

inline Mechanism mechanism(test::Random& random)
{
  Mechanism m;
  for (Body<double>& part : m.parts) { part = random.body(); }
  m.stiffness = random.uniform(0, 50);
  return m;
}

/// base – mechanism – (arm on its arm, arm on its slider, fixed link on its cross – mechanism – arm on its arm).
inline MechanismParts mechanism_robot(test::Random& random)
{
  MechanismParts parts;
  parts.add("base", {}, FloatingBase<double>{random.body()});
  const auto on = [&](const char* parent, int outlet) {
    return Attachment<double>{parent, random.rotation(), random.vector(0.4), outlet};
  };
  parts.add("first", on("base", 0), mechanism(random));
  parts.add("arm", on("first", 1), MotorArm<double>{{random.axis()}, random.body(), random.motor()});
  parts.add("held", on("first", 2), MotorArm<double>{{random.axis()}, random.body(), random.motor()});
  parts.add("plate", on("first", 0), FixedLink<double>{{}, random.body()});
  parts.add("second", on("plate", 0), mechanism(random));
  parts.add("tip", on("second", 1), MotorArm<double>{{random.axis()}, random.body(), random.motor()});
  parts.set_gravity(random.vector(10));
  return parts;
}

inline constexpr std::uint64_t first_seed = 9000;
inline constexpr int states = 200;
// Seven subsystems, some ten roundings each; Cholesky's error times a condition number of up to 10⁶.
inline constexpr double recursive_tolerance = 70 * Eigen::NumTraits<double>::epsilon() * 10;
inline constexpr double cholesky_tolerance = 1e-10;

inline double difference(const Eigen::Ref<const MatrixX<double>>& value,
                         const Eigen::Ref<const MatrixX<double>>& reference)
{
  return (value - reference).norm() / reference.norm();
}

/// The recursions against each other, and against the global inverse, which shares none with them; returns q̈₀ and B̂ of
/// it.
template <Update update, class Tree>
MatrixX<double> compare(const Tree& tree, test::Random& random)
{
  Inputs<Tree> inputs(tree);
  inputs.add_force("arm", random.vector(0.5), Axes::body);
  inputs.add_wrench("held", random.vector(0.5));
  inputs.add_force("first", random.vector(0.5));
  inputs.add_wrench("tip", random.vector(0.5), Axes::body);
  inputs.add_force("plate");
  const test::RandomState state = test::random_state(tree, inputs.columns(), random);
  Workspace<Tree, update> ws(tree);
  GlobalInverse<Tree> global_inverse(tree, inputs);
  UnitForce<Tree> unit_force(tree, inputs);
  RecursiveInverse<Tree> recursive_inverse(tree, inputs);
  ImplicitInversion<Tree> implicit_inversion(tree, inputs);
  const auto fd = forward_dynamics(state.q, state.qd, ws);
  REQUIRE(fd.ok());
  const auto reference = unit_force(fd);
  REQUIRE(reference.ok());
  CHECK(difference(recursive_inverse(fd).Bhat, reference.Bhat) < recursive_tolerance);
  CHECK(difference(implicit_inversion(fd).Bhat, reference.Bhat) < recursive_tolerance);
  const auto global = global_inverse(fd);
  REQUIRE(global.ok());
  CHECK(difference(global.Bhat, reference.Bhat) < cholesky_tolerance);
  CHECK(difference(global.qdd0, reference.qdd0) < cholesky_tolerance);
  const auto in_one_call = implicit_inversion(state.q, state.qd, ws);
  CHECK(difference(in_one_call.Bhat, reference.Bhat) < recursive_tolerance);
  CHECK(difference(in_one_call.qdd0, reference.qdd0) < recursive_tolerance);
  MatrixX<double> result(tree.n_v(), 1 + inputs.columns());
  result << global.qdd0, global.Bhat;
  return result;
}

}  // namespace iim::test
