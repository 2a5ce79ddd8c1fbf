// PROGRAM: tests_methods
// M, h and B of random robots against energy, power and differences of positions, which share no formula with them.
// In long double, where a difference quotient leaves 13 digits.
#include <iim/equations_of_motion.hpp>
#include <iim/iim.hpp>

#include "catch.hpp"
#include "random_tree.hpp"
#include "worst.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iostream>
#include <limits>
#include <type_traits>
#include <vector>

namespace test_equations_of_motion {

using namespace iim;
using iim::test::keep_worst;

namespace {

using Real = long double;
using Tree = std::remove_cvref_t<decltype(DynamicTree(StandardAssembly<Real>()))>;
using Vector = VectorX<Real>;

constexpr std::uint64_t first_seed = 500;
constexpr int robots = 40;

/// Central differences with step δ: truncation δ²/6 times third derivatives, rounding ε/δ; both about ε^(2/3) = 2·10⁻¹³
/// at δ = ε^(1/3). Third derivatives are first ones times the square of angular velocities, here of some rad/s: 20.
const Real delta = std::cbrt(Eigen::NumTraits<Real>::epsilon());
const Real tolerance = 20 * delta * delta;

/// A robot in long double with its inputs and a state.
struct Setting {
  test::RandomRobot robot;
  Tree tree;
  Inputs<Tree> inputs;
  Vector q, qd;

  explicit Setting(std::uint64_t seed)
      : robot(test::random_robot(seed, options(seed))), tree(test::in<Real>(robot.assembly)),
        inputs(test::make_inputs(tree, robot.inputs))
  {
    test::Random random(seed + 77);
    const test::RandomState state = test::random_state(tree, 0, random);
    q = state.q.cast<Real>();
    qd = state.qd.cast<Real>();
  }
  Setting(const Setting&) = delete;  // inputs refer to the tree
  Setting& operator=(const Setting&) = delete;

  static test::RandomOptions options(std::uint64_t seed)
  {
    test::RandomOptions options;
    options.most = 20;
    options.inactive = 0;
    options.floating_inside = seed % 3 == 0 ? 0.2 : 0;
    return options;
  }
};

/// The outward loop alone: all that M, h and B need.
template <Scene scene = Scene{}>
void kinematics(const Vector& q, const Vector& qd, Workspace<Tree>& ws)
{
  detail::Diagnosis diagnosis;
  ws.load().setZero();
  detail::kinematics<scene>(q, qd, ws, diagnosis);
  REQUIRE(diagnosis.status == Status::ok);
}

/// q a time t later at the constant rate q̇, to second order in t (central differences see no more): quaternions by
/// the rate of the coordinates at mid-step, then to unit length.
Vector moved(const Tree& tree, const Vector& q, const Vector& qd, Real t)
{
  Vector result = q;
  tree.outward([&]<class N, class S>(const N& node, const S& s) {
    if constexpr (S::n_q > 0) {
      const detail::Coordinates<S> q_i = q.segment<S::n_q>(node.q);
      const detail::Velocities<S> qd_i = qd.segment<S::n_i>(node.v);
      detail::Coordinates<S> mid = q_i + t / 2 * coordinate_rate(s, q_i, qd_i);
      if constexpr (detail::is_free<S>()) { mid.template tail<4>().normalize(); }
      detail::Coordinates<S> end = q_i + t * coordinate_rate(s, mid, qd_i);
      if constexpr (detail::is_free<S>()) { end.template tail<4>().normalize(); }
      result.segment<S::n_q>(node.q) = end;
    }
  });
  return result;
}

/// Position and orientation of every frame in the world, and orientation of every inlet.
struct Pose {
  std::vector<Matrix3<Real>> R, inlet_R;
  std::vector<Vector3<Real>> p, inlet_p;
};

Pose pose(const Tree& tree, const Vector& q)
{
  Pose pose;
  Workspace ws(tree);
  kinematics(q, Vector::Zero(tree.n_v()), ws);
  tree.outward([&]<class N, class S>(const N& node, const S&) {
    // From the tree's placements and the joints' own motion only.
    const Placement<Real>& at = tree.placement(node.index);
    Placement<Real> inlet = at;
    if (node.inlet >= 0) {
      const Placement<Real> parent{pose.R[static_cast<std::size_t>(node.inlet)],
                                   pose.p[static_cast<std::size_t>(node.inlet)]};
      inlet = parent * at;
    }
    const NodeState<S>& state = ws.template node<S>(node);
    pose.inlet_R.push_back(ws.inlet_axes(node, state));
    pose.inlet_p.push_back(inlet.p);
    for (int k = 0; k < S::n_frames; ++k) {
      const FrameState<Real>& f = ws.frame(node.frame + k);
      pose.R.push_back(f.R);
      if constexpr (detail::is_free<S>()) {
        pose.p.push_back(inlet.p + inlet.R * q.template segment<3>(node.q));
      } else {
        pose.p.push_back(inlet.p + f.r);
      }
    }
  });
  return pose;
}

/// Velocity of a point and angular velocity, from two poses.
struct Twist {
  Vector3<Real> v, omega;
};

Twist twist(const Matrix3<Real>& R0, const Vector3<Real>& p0, const Matrix3<Real>& R1, const Vector3<Real>& p1,
            const Vector3<Real>& point, Real dt)
{
  const Vector3<Real> v = ((R1 * point + p1) - (R0 * point + p0)) / dt;
  const Matrix3<Real> turn = (R1 - R0) * ((R0 + R1) / 2).transpose() / dt;  // ω~ up to O(dt²)
  return {v, Vector3<Real>(turn(2, 1) - turn(1, 2), turn(0, 2) - turn(2, 0), turn(1, 0) - turn(0, 1)) / 2};
}

/// What difference quotients say of a robot that moves: kinetic energy, and power of gravity.
struct Mechanics {
  Real kinetic = 0, gravity_power = 0;
};

Mechanics mechanics(const Setting& s)
{
  const Real dt = 2 * delta;
  const Pose before = pose(s.tree, moved(s.tree, s.q, s.qd, -delta));
  const Pose after = pose(s.tree, moved(s.tree, s.q, s.qd, delta));
  const Pose now = pose(s.tree, s.q);
  Mechanics sum;
  const auto add_body = [&](const FrameMass<Real>& body, const Matrix3<Real>& R, const Twist& t) {
    if (!body.present) { return; }
    const Matrix3<Real> I = R * body.central_inertia * R.transpose();
    sum.kinetic += (body.mass * t.v.squaredNorm() + t.omega.dot(I * t.omega)) / 2;
    sum.gravity_power += body.mass * s.tree.gravity().dot(t.v);
  };
  s.tree.outward([&]<class N, class S>(const N& node, const S& subsystem) {
    const auto twist_of = [&](Index frame, const Vector3<Real>& point) {
      const auto f = static_cast<std::size_t>(frame);
      return twist(before.R[f], before.p[f], after.R[f], after.p[f], point, dt);
    };
    const auto i = static_cast<std::size_t>(node.index);
    const Vector3<Real>& com = s.tree.inlet_mass(node.index).com;
    const Twist at_inlet = twist(before.inlet_R[i], before.inlet_p[i], after.inlet_R[i], after.inlet_p[i], com, dt);
    for (int k = 0; k < S::n_frames; ++k) {
      const FrameMass<Real>& body = s.tree.frame_mass(node.frame + k);
      add_body(body, now.R[static_cast<std::size_t>(node.frame + k)], twist_of(node.frame + k, body.com));
    }
    if (node.inlet >= 0) { add_body(s.tree.inlet_mass(node.index), now.inlet_R[i], at_inlet); }
    if constexpr (detail::rotor_count<S>() > 0) {
      for (const auto& rotor : subsystem.rotors()) {
        const Real relative = rotor.ratio(0) * s.qd(node.v);
        const Real carried = rotor.coupled ? (now.inlet_R[i] * rotor.axis).dot(at_inlet.omega) : Real(0);
        sum.kinetic += rotor.inertia * (carried + relative) * (carried + relative) / 2;
      }
    }
  });
  return sum;
}

}  // namespace

TEST_CASE("M is the kinetic energy, h the power of gravity and the rate of M")
{
  std::cout << robots << " robots from seed " << first_seed << '\n';
  Real worst_energy = 0, worst_gravity = 0, worst_rate = 0;
  for (std::uint64_t seed = first_seed; seed < first_seed + robots; ++seed) {
    CAPTURE(seed);
    const Setting s(seed);
    if (s.tree.n_v() == 0) { continue; }
    Workspace ws(s.tree);
    EquationsOfMotion equations(s.tree, s.inputs);
    const auto M_at = [&](const Vector& q) { return MatrixX<Real>(equations(q, s.qd, ws).M); };
    const MatrixX<Real> M = M_at(s.q);
    const Mechanics seen = mechanics(s);
    const Real kinetic = s.qd.dot(M * s.qd) / 2;
    keep_worst(worst_energy, std::abs(kinetic - seen.kinetic) / seen.kinetic);

    // q̇ = 0 in the pass: h is gravity alone, and its power on q̇ is minus that of the weights.
    EquationsOfMotion<Tree, Scene{.velocity = false}> at_rest(s.tree, s.inputs);
    const auto resting = at_rest(s.q, s.qd, ws);
    Real weight = 0;
    for (Index f = 0; f < s.tree.n_frames(); ++f) { weight += s.tree.frame_mass(f).mass * s.tree.gravity().norm(); }
    keep_worst(worst_gravity, std::abs(resting.h.dot(s.qd) + seen.gravity_power) / (weight * s.qd.norm()));

    // In free fall q̇ᵀM q̇ is constant: q̇ᵀh = ½ q̇ᵀṀq̇.
    EquationsOfMotion<Tree, Scene{.gravity = false}> falling(s.tree, s.inputs);
    const Vector h = falling(s.q, s.qd, ws).h;
    const MatrixX<Real> rate =
        (M_at(moved(s.tree, s.q, s.qd, delta)) - M_at(moved(s.tree, s.q, s.qd, -delta))) / (2 * delta);
    const Real scale = s.qd.squaredNorm() * s.qd.norm() * M.norm();
    keep_worst(worst_rate, std::abs(h.dot(s.qd) - s.qd.dot(rate * s.qd) / 2) / scale);
  }
  std::cout << "relative differences: kinetic energy " << worst_energy << ", gravity " << worst_gravity
            << ", rate of M " << worst_rate << "; tolerance " << tolerance << '\n';
  CHECK(worst_energy < tolerance);
  CHECK(worst_gravity < tolerance);
  CHECK(worst_rate < tolerance);
}

TEST_CASE("B is the power of the inputs")
{
  Real worst = 0;
  int columns = 0;
  for (std::uint64_t seed = first_seed; seed < first_seed + robots; ++seed) {
    CAPTURE(seed);
    const Setting s(seed);
    if (s.tree.n_v() == 0) { continue; }
    Workspace ws(s.tree);
    EquationsOfMotion equations(s.tree, s.inputs);
    const auto result = equations(forward_dynamics(s.q, s.qd, ws));
    REQUIRE(result.ok());
    REQUIRE(result.B.cols() == s.inputs.columns());
    const Vector power = result.B.transpose() * s.qd;  // of a unit of every input
    const Pose before = pose(s.tree, moved(s.tree, s.q, s.qd, -delta));
    const Pose after = pose(s.tree, moved(s.tree, s.q, s.qd, delta));
    const Pose now = pose(s.tree, s.q);
    s.inputs.for_each_active([&](const Input<Real>& input, Index first) {
      Vector expected(input.size);
      if (input.kind == InputKind::motor) {
        s.tree.visit(input.subsystem, [&]<class N, class S>(const N& node, const S& subsystem) {
          if constexpr (S::n_u == 1) {
            const detail::Coordinates<S> q_i = s.q.segment<S::n_q>(node.q);
            expected(0) = subsystem.Bbar(q_i)(0, 0) * s.qd(node.v);
          }
        });
      } else {
        const auto f = static_cast<std::size_t>(input.frame);
        const Twist t = twist(before.R[f], before.p[f], after.R[f], after.p[f], input.point, 2 * delta);
        const Matrix3<Real> axes =
            input.axes == Axes::body ? Matrix3<Real>(now.R[f] * input.R) : Matrix3<Real>::Identity();
        expected.head(3) = axes.transpose() * t.v;
        if (input.kind == InputKind::wrench) { expected.tail(3) = axes.transpose() * t.omega; }
      }
      keep_worst(worst, (power.segment(first, input.size) - expected).norm() / (s.qd.norm() + expected.norm()));
      columns += static_cast<int>(input.size);
    });
  }
  std::cout << columns << " columns; largest difference of a power " << worst << '\n';
  CHECK(columns > 300);
  CHECK(worst < tolerance);
}

TEST_CASE("M q̈₀ + h = 0 and M B̂ = B, and what fails is a status")
{
  Real worst = 0;
  for (std::uint64_t seed = first_seed; seed < first_seed + robots; ++seed) {
    CAPTURE(seed);
    Setting s(seed);
    if (s.tree.n_v() == 0) { continue; }
    for (Index id = 0; id < s.inputs.blocks(); id += 3) { s.inputs.set_active(id, false); }
    Workspace ws(s.tree);
    EquationsOfMotion equations(s.tree, s.inputs);
    ImplicitInversion method(s.tree, s.inputs);
    const auto dynamics = method(s.q, s.qd, ws);
    const auto result = equations(dynamics.fd);
    REQUIRE(dynamics.ok());
    REQUIRE(result.ok());
    CHECK(result.M == result.M.transpose());
    REQUIRE(result.B.cols() == s.inputs.columns());
    keep_worst(worst, (result.M * dynamics.qdd0 + result.h).norm() / (result.M.norm() * dynamics.qdd0.norm()));
    keep_worst(worst,
               (result.M * dynamics.Bhat - result.B).norm() / (result.M.norm() * dynamics.Bhat.norm() + 1e-4000L));

    Vector q = s.q;
    q(s.tree.n_q() - 1) = std::numeric_limits<Real>::infinity();
    const auto failed = equations(q, s.qd, ws);
    CHECK(failed.status == Status::invalid_state);
    CHECK(failed.M.array().isNaN().all());
    CHECK(failed.h.array().isNaN().all());
    CHECK(failed.B.array().isNaN().all());
  }
  std::cout << "largest residual " << worst << '\n';
  CHECK(worst < 1000 * Eigen::NumTraits<Real>::epsilon());
}

}  // namespace test_equations_of_motion
