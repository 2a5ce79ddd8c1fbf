// PROGRAM: tests_several
// What J_t and J̇_t q̇ are: derivatives along a motion, on random robots, by differences in long double.
//
// The motion: all q̇ constant, which for a floating base is a screw motion. Positions come from a forward kinematics
// written here from the parts themselves; the library's is not used. Differences of sixth order,
//
//     x'(0) = Σ_k w_k (x(kh) − x(−kh)) / h,   w = (3/4, −3/20, 1/60);   error h⁶/140·x⁽⁷⁾ + ε/h
#include "catch.hpp"
#include "random_tree.hpp"

#include <iim/task.hpp>

#include <array>
#include <limits>
#include <map>
#include <vector>

namespace test_task_kinematics {

using namespace iim;
using namespace iim::test;
using Real = long double;
using Vector = Vector3<Real>;
using Matrix = Matrix3<Real>;

namespace {

/// Sixth-order derivative at 0 of f: Real → a matrix.
template <class F>
auto derivative(F&& f)
{
  // h⁶ = ε/h: speeds of some rad/s make x⁽⁷⁾ large, so that h is somewhat below.
  const Real h = Real(1) / 1024;
  auto sum = (f(h) - f(-h)).eval();
  sum *= Real(3) / 4;
  sum -= (f(2 * h) - f(-2 * h)).eval() * (Real(3) / 20);
  sum += (f(3 * h) - f(-3 * h)).eval() / 60;
  sum /= h;
  return sum;
}

Matrix turn(const Vector& axis, Real angle) { return Eigen::AngleAxis<Real>(angle, axis).toRotationMatrix(); }

/// q after the time t with constant q̇: q + t q̇, and for a floating base the exact screw motion.
template <class Tree>
VectorX<Real> moved(const Tree& tree, const VectorX<Real>& q, const VectorX<Real>& qd, Real t)
{
  VectorX<Real> at = q;
  tree.outward([&]<class N, class S>(const N& node, const S&) {
    if constexpr (detail::is_free<S>()) {
      const Eigen::Quaternion<Real> Q(q(node.q + 6), q(node.q + 3), q(node.q + 4), q(node.q + 5));
      const Vector v = qd.template segment<3>(node.v), w = qd.template segment<3>(node.v + 3);
      const Real speed = w.norm(), angle = speed * t;
      const Vector a = w / speed;
      // ∫ exp(ω̃ s) v ds
      const Vector path = v * (sin(angle) / speed) + a.cross(v) * ((1 - cos(angle)) / speed) +
                          a * (a.dot(v) * (t - sin(angle) / speed));
      at.template segment<3>(node.q) += Q.toRotationMatrix() * path;
      at.template segment<4>(node.q + 3) = (Q * Eigen::Quaternion<Real>(Eigen::AngleAxis<Real>(angle, a))).coeffs();
    } else {
      for (Index k = 0; k < S::n_i; ++k) { at(node.q + k) += t * qd(node.v + k); }
    }
  });
  return at;
}

struct Pose {
  Matrix R = Matrix::Identity();
  Vector p = Vector::Zero();
};

/// A rotor, as far as momentum is concerned.
struct Spin {
  Vector axis;
  Real momentum;  ///< of the rotation relative to its carrier, J·ratio·q̇
  Real inertia;
  std::size_t carrier;
};

/// Poses of all subsystems, of all bodies, and the rotors' spins.
struct Kinematics {
  std::vector<Pose> frames;          ///< by subsystem
  std::vector<Pose> bodies;          ///< axes of its carrier, centre of mass
  std::vector<std::size_t> carrier;  ///< of a body: place in `carriers`
  std::vector<Pose> carriers;        ///< subsystem i: its inlet at 2i, its frame at 2i + 1
  std::vector<Body<Real>> body;
  std::vector<Spin> spins;
};

template <class Tree>
Kinematics kinematics(const Tree& tree, const VectorX<Real>& q, const VectorX<Real>& qd)
{
  Kinematics all;
  tree.outward([&]<class N, class S>(const N& node, const S& s) {
    Pose pose = node.parent < 0 ? Pose{} : all.frames[static_cast<std::size_t>(node.parent)];
    const auto carry = [&](const Body<Real>& body) {
      all.bodies.push_back({pose.R, pose.p + pose.R * body.com});
      all.carrier.push_back(all.carriers.size() - 1);
      all.body.push_back(body);
    };
    pose.p += pose.R * tree.placement(node.index).p;
    pose.R = pose.R * tree.placement(node.index).R;
    all.carriers.push_back(pose);
    if constexpr (requires { s.motor; }) {
      const Motor<Real>& motor = s.motor;
      if (motor.mass > 0) {
        Body<Real> rotor{motor.mass, motor.com};
        rotor.inertia = motor.transverse_inertia * (Matrix::Identity() - motor.axis * motor.axis.transpose());
        carry(rotor);
      }
      if (!motor.armature) {
        all.spins.push_back({pose.R * motor.axis, motor.axial_inertia * motor.gear_ratio * qd(node.v),
                             motor.axial_inertia, all.carriers.size() - 1});
      }
    }
    if constexpr (detail::is_free<S>()) {
      pose.p += pose.R * q.template segment<3>(node.q);
      pose.R = pose.R * Eigen::Quaternion<Real>(q(node.q + 6), q(node.q + 3), q(node.q + 4), q(node.q + 5))
                            .normalized()
                            .toRotationMatrix();
    } else if constexpr (S::pattern.angular) {
      pose.R = pose.R * turn(s.joint.axis.normalized(), q(node.q));
    } else if constexpr (S::pattern.linear) {
      pose.p += pose.R * s.joint.axis.normalized() * q(node.q);
    }
    all.carriers.push_back(pose);
    all.frames.push_back(pose);
    carry(s.body);
  });
  return all;
}

/// Angular velocity from R and Ṙ.
Vector angular_velocity(const Matrix& R, const Matrix& Rdot)
{
  const Matrix w = Rdot * R.transpose();
  return {(w(2, 1) - w(1, 2)) / 2, (w(0, 2) - w(2, 0)) / 2, (w(1, 0) - w(0, 1)) / 2};
}

}  // namespace

TEST_CASE("task rows are the derivatives of positions and momenta", "[task]")
{
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    CAPTURE(seed);
    RandomOptions options;
    options.most = 10;
    options.floating_inside = 0.1;
    const DynamicTree tree(in<Real>(random_robot(seed, options).assembly));
    using Tree = std::remove_const_t<decltype(tree)>;
    Random random(seed + 3000);
    const RandomState state = random_state(tree, 0, random);
    const VectorX<Real> qd = state.qd.cast<Real>();
    VectorX<Real> q = state.q.cast<Real>();
    tree.outward([&]<class N, class S>(const N& node, const S&) {
      if constexpr (detail::is_free<S>()) { q.template segment<4>(node.q + 3).normalize(); }
    });

    const Inputs<Tree> inputs(tree);
    Tasks<Tree> tasks(tree, inputs);
    const Index last = tree.size() - 1;
    const Vector point = random.vector(0.5).cast<Real>();
    const FrameReference<Real> named = tree.frame("f0");
    const Index frame = named.frame < 0 ? -1 : tasks.add_frame("f0", point);
    const Index tip = tasks.add_point(tree.name(last), point);
    const Index com = tasks.add_com();
    const Index momentum = tasks.add_momentum();
    Workspace ws(tree);
    const auto rows_at = [&](Real t) { return tasks(forward_dynamics(moved(tree, q, qd, t), qd, ws)); };
    const auto velocity_at = [&](Real t) { return VectorX<Real>(rows_at(t).J * qd); };
    const TaskRows<Real> rows = rows_at(0);
    REQUIRE(rows.ok());
    const VectorX<Real> V = rows.J * qd, Jdot_qd = rows.Jdot_qd;
    const Placement<Real> tip_at = tasks.placement(tip), com_at = tasks.placement(com);
    const MatrixX<Real> J = rows.J;

    // Positions and velocities.
    const auto tip_position = [&](Real t) {
      const Pose pose = kinematics(tree, moved(tree, q, qd, t), qd).frames.back();
      return Vector(pose.p + pose.R * point);
    };
    const auto com_position = [&](Real t) {
      const Kinematics all = kinematics(tree, moved(tree, q, qd, t), qd);
      Vector sum = Vector::Zero();
      Real mass = 0;
      for (std::size_t b = 0; b < all.bodies.size(); ++b) {
        sum += all.body[b].mass * all.bodies[b].p;
        mass += all.body[b].mass;
      }
      return Vector(sum / mass);
    };
    const auto frame_rotation = [&](Real t) {
      const Pose pose = kinematics(tree, moved(tree, q, qd, t), qd).frames[static_cast<std::size_t>(named.subsystem)];
      return Matrix(pose.R * named.at.R);
    };
    const auto frame_position = [&](Real t) {
      const Pose pose = kinematics(tree, moved(tree, q, qd, t), qd).frames[static_cast<std::size_t>(named.subsystem)];
      return Vector(pose.p + pose.R * (named.at.p + named.at.R * point));
    };
    // Lengths are a few metres, speeds some m/s: roundings of kinematics of depth 10, and h⁶ = 1e-18 of x⁽⁷⁾ ~ 10⁴.
    const Real eps = std::numeric_limits<Real>::epsilon();
    const Real position_error = 1000 * eps;
    const Real rate_error = 1e6 * eps + 1e-13;
    REQUIRE((tip_at.p - tip_position(0)).norm() <= position_error);
    REQUIRE((com_at.p - com_position(0)).norm() <= position_error);
    REQUIRE((V.segment<3>(tasks.row(tip)) - derivative(tip_position)).norm() <= rate_error);
    REQUIRE((V.segment<3>(tasks.row(com)) - derivative(com_position)).norm() <= rate_error);
    if (frame >= 0) {
      const Index row = tasks.row(frame);
      REQUIRE((tasks.placement(frame).p - frame_position(0)).norm() <= position_error);
      REQUIRE((tasks.placement(frame).R - frame_rotation(0)).norm() <= position_error);
      REQUIRE((V.segment<3>(row) - derivative(frame_position)).norm() <= rate_error);
      REQUIRE((V.segment<3>(row + 3) - angular_velocity(frame_rotation(0), derivative(frame_rotation))).norm() <=
              rate_error);
    }

    // Column by column: q̇ with one of its entries changed by one (moved() wants a base that turns).
    for (Index v = 0; v < tree.n_v(); ++v) {
      const auto along = [&](Real t) {
        const VectorX<Real> other = VectorX<Real>::Unit(tree.n_v(), v) + qd;
        const Pose pose = kinematics(tree, moved(tree, q, other, t), other).frames.back();
        return Vector(pose.p + pose.R * point);
      };
      const Vector column = J.block<3, 1>(tasks.row(tip), v);
      REQUIRE((column - (derivative(along) - V.segment<3>(tasks.row(tip)))).norm() <= 2 * rate_error);
    }

    // Momentum by its definition, bodies and rotors one by one.
    const Kinematics now = kinematics(tree, q, qd);
    Vector6<Real> p = Vector6<Real>::Zero();
    const auto carrier_omega = [&](std::size_t k) {
      const auto rotation = [&](Real t) { return Matrix(kinematics(tree, moved(tree, q, qd, t), qd).carriers[k].R); };
      return angular_velocity(rotation(0), derivative(rotation));
    };
    for (std::size_t b = 0; b < now.bodies.size(); ++b) {
      const auto centre = [&](Real t) { return Vector(kinematics(tree, moved(tree, q, qd, t), qd).bodies[b].p); };
      const Matrix R = now.bodies[b].R;
      const Vector mv = now.body[b].mass * derivative(centre);
      p.head<3>() += mv;
      p.tail<3>() += (now.bodies[b].p - com_at.p).cross(mv) +
                     R * now.body[b].inertia * R.transpose() * carrier_omega(now.carrier[b]);
    }
    for (const Spin& spin : now.spins) {
      p.tail<3>() += (spin.momentum + spin.inertia * spin.axis.dot(carrier_omega(spin.carrier))) * spin.axis;
    }
    // Ten bodies of up to 10 kg.
    REQUIRE((V.segment<6>(tasks.row(momentum)) - p).norm() <= 100 * rate_error);

    // J̇q̇ = d(Jq̇)/dt, for all rows.
    const VectorX<Real> acceleration = derivative(velocity_at);
    REQUIRE((Jdot_qd - acceleration).norm() <= 100 * rate_error);
  }
}

}  // namespace test_task_kinematics
