// Random robots, inputs and states from a seed: every type of subsystem, several roots, branching, any order of adding.
//
// Numbers are drawn in double and the same on every machine (no std distributions). `in<T>` gives the robot in another
// Scalar with rotations and unit vectors that are exact in that Scalar.
#pragma once

#include <iim/iim.hpp>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <random>
#include <string>
#include <utility>
#include <vector>

namespace iim::test {

using Vec3 = Vector3<double>;
using Mat3 = Matrix3<double>;

/// Uniform numbers, vectors, rotations and bodies.
class Random {
public:
  explicit Random(std::uint64_t seed) : bits_(seed) {}

  double uniform(double low, double high) { return low + (high - low) * static_cast<double>(bits_() >> 11) * 0x1p-53; }
  int below(int n) { return static_cast<int>(bits_() % static_cast<std::uint64_t>(n)); }
  bool chance(double p) { return uniform(0, 1) < p; }

  Vec3 vector(double size)
  {
    Vec3 v;
    for (Index i = 0; i < 3; ++i) { v(i) = uniform(-size, size); }
    return v;
  }

  Vec3 unit()
  {
    for (;;) {
      const Vec3 v = vector(1);
      const double norm = v.norm();
      if (norm > 0.1 && norm < 1) { return v / norm; }
    }
  }

  /// A coordinate axis with either sign, or any direction.
  Vec3 axis()
  {
    if (!chance(0.5)) { return unit(); }
    return (chance(0.5) ? 1.0 : -1.0) * Vec3::Unit(below(3));
  }

  Eigen::Vector4d quaternion()
  {
    for (;;) {
      const Eigen::Vector4d q(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1), uniform(-1, 1));
      const double norm = q.norm();
      if (norm > 0.1 && norm < 1) { return q / norm; }
    }
  }

  Mat3 rotation()
  {
    const Eigen::Vector4d q = quaternion();
    return Eigen::Quaterniond(q(3), q(0), q(1), q(2)).toRotationMatrix();
  }

  /// A homogeneous box of 0.1–10 kg with edges of 0.1–1 m, somewhere near the frame's origin.
  Body<double> body()
  {
    Body<double> body;
    body.mass = std::pow(10.0, uniform(-1, 1));
    body.com = vector(0.5);
    const Vec3 a(uniform(0.1, 1), uniform(0.1, 1), uniform(0.1, 1));
    const Vec3 moments = (body.mass / 12) * Vec3(a.y() * a.y() + a.z() * a.z(), a.z() * a.z() + a.x() * a.x(),
                                                 a.x() * a.x() + a.y() * a.y());
    const Mat3 R = rotation();
    const Mat3 inertia = R * moments.asDiagonal() * R.transpose();
    body.inertia = (inertia + inertia.transpose()) / 2;
    return body;
  }

  Motor<double> motor(double armature = 0.3)
  {
    Motor<double> motor;
    motor.gear_ratio = (chance(0.5) ? 1 : -1) * std::pow(10.0, uniform(0, 2));
    motor.axial_inertia = std::pow(10.0, uniform(-5, -3));
    motor.axis = axis();
    if (chance(0.5)) {
      motor.mass = uniform(0.1, 1);
      motor.com = vector(0.3);
      motor.transverse_inertia = motor.axial_inertia * uniform(0.6, 2);
    }
    motor.armature = chance(armature);
    return motor;
  }

  template <class T>
  void shuffle(std::vector<T>& items)
  {
    for (int k = static_cast<int>(items.size()) - 1; k > 0; --k) {
      std::swap(items[static_cast<std::size_t>(k)], items[static_cast<std::size_t>(below(k + 1))]);
    }
  }

private:
  std::mt19937_64 bits_;
};

/// An input by name, before there is a tree.
struct NamedInput {
  InputKind kind;
  std::string name;
  Vec3 point = Vec3::Zero();
  Axes axes = Axes::world;
  bool active = true;
};

struct RandomRobot {
  StandardAssembly<double> assembly;
  std::vector<NamedInput> inputs;
};

/// What may occur in a random robot.
struct RandomOptions {
  int fewest = 1;
  int most = 12;
  double root = 0.12;             ///< chance that a part beyond the first hangs on the world
  double chain = 0.5;             ///< chance that it hangs on the part before it, else on any
  double floating_root = 0.5;     ///< chance that a part on the world is a floating base
  double floating_inside = 0.05;  ///< the same for other parts
  double motor_arm = 0.4;         ///< chance of a motor-arm among the other types
  double armature = 0.3;          ///< chance that a motor-arm's rotor is armature only
  double fixed = 0.1;
  double prismatic = 0.3;
  bool identity_placements = true;  ///< some coupling points without a turn or without an offset
  double inactive = 0.2;            ///< chance that an input is switched off
};

inline RandomRobot random_robot(std::uint64_t seed, const RandomOptions& options = {})
{
  Random random(seed);
  struct Planned {
    std::string name;
    Attachment<double> on;
    StandardAssembly<double>::Part part;
  };
  std::vector<Planned> plan;
  const auto place = [&](Attachment<double>& on) {
    if (!options.identity_placements || random.chance(0.7)) { on.R = random.rotation(); }
    if (!options.identity_placements || random.chance(0.8)) { on.p = random.vector(0.5); }
  };
  const int size = options.fewest + random.below(options.most - options.fewest + 1);
  for (int k = 0; k < size; ++k) {
    Planned next{"s" + std::to_string(k), {}, {}};
    if (k > 0 && !random.chance(options.root)) {
      next.on.parent = "s" + std::to_string(random.chance(options.chain) ? k - 1 : random.below(k));
    }
    place(next.on);
    if (random.chance(next.on.parent == "world" ? options.floating_root : options.floating_inside)) {
      next.part = FloatingBase<double>{random.body()};
    } else if (random.chance(options.fixed)) {
      next.part = FixedLink<double>{{}, random.body()};
    } else if (random.chance(options.motor_arm)) {
      if (random.chance(options.prismatic)) {
        next.part = LinearMotorArm<double>{{random.axis()}, random.body(), random.motor(options.armature)};
      } else {
        next.part = MotorArm<double>{{random.axis()}, random.body(), random.motor(options.armature)};
      }
    } else if (random.chance(options.prismatic)) {
      next.part = PrismaticLink<double>{{random.axis()}, random.body()};
    } else {
      next.part = RevoluteLink<double>{{random.axis()}, random.body()};
    }
    plan.push_back(next);
  }

  RandomRobot robot;
  const auto part_name = [&] { return "s" + std::to_string(random.below(size)); };
  const int points = 1 + random.below(4);
  std::vector<std::pair<std::string, Attachment<double>>> frames;
  for (int k = 0; k < points; ++k) {
    Attachment<double> on;
    on.parent = part_name();
    place(on);
    frames.emplace_back("f" + std::to_string(k), on);
  }
  for (const Planned& part : plan) {
    const bool has_motor =
        std::visit([](const auto& s) { return std::remove_cvref_t<decltype(s)>::n_u > 0; }, part.part);
    if (has_motor && random.chance(0.8)) { robot.inputs.push_back({InputKind::motor, part.name}); }
  }
  for (int k = random.below(6); k > 0; --k) {
    NamedInput input{random.chance(0.6) ? InputKind::force : InputKind::wrench, part_name()};
    if (random.chance(0.5)) { input.name = "f" + std::to_string(random.below(points)); }
    if (random.chance(0.7)) { input.point = random.vector(0.5); }
    if (random.chance(0.5)) { input.axes = Axes::body; }
    robot.inputs.push_back(input);
  }
  for (NamedInput& input : robot.inputs) { input.active = !random.chance(options.inactive); }
  random.shuffle(robot.inputs);

  random.shuffle(plan);
  for (const Planned& part : plan) {
    std::visit([&](const auto& s) { robot.assembly.add(part.name, part.on, s); }, part.part);
  }
  for (const auto& [name, on] : frames) { robot.assembly.add_frame(name, on); }
  robot.assembly.set_gravity(random.vector(10));
  return robot;
}

/// The rotation next to R that is one to the last digit of T (R ← R (3 − RᵀR)/2 converges quadratically).
template <class T>
Matrix3<T> exact_rotation(const Mat3& R)
{
  Matrix3<T> exact = R.cast<T>();
  for (int k = 0; k < 4; ++k) {
    const Matrix3<T> gram = exact.transpose() * exact;
    exact = Matrix3<T>(exact * (T(3) * Matrix3<T>::Identity() - gram) / T(2));
  }
  return exact;
}

/// The same robot in another Scalar, with couplings that are rotations in that Scalar.
template <class T>
StandardAssembly<T> in(const StandardAssembly<double>& assembly)
{
  StandardAssembly<T> other;
  const auto attachment = [](const Attachment<double>& on) {
    return Attachment<T>{on.parent, exact_rotation<T>(on.R), on.p.template cast<T>(), on.outlet};
  };
  for (const auto& part : assembly.parts()) {
    std::visit([&](const auto& s) { other.add(part.name, attachment(part.on), s.template cast<T>()); }, part.part);
  }
  for (const auto& frame : assembly.named_frames()) { other.add_frame(frame.name, attachment(frame.on)); }
  other.set_gravity(assembly.gravity().template cast<T>());
  return other;
}

/// The robot's inputs on a tree, in their order; inactive ones switched off.
template <class Tree>
Inputs<Tree> make_inputs(const Tree& tree, const std::vector<NamedInput>& named)
{
  using Scalar = typename Tree::Scalar;
  Inputs<Tree> inputs(tree, Start::empty);
  for (const NamedInput& input : named) {
    Index id = -1;
    const Vector3<Scalar> point = input.point.template cast<Scalar>();
    switch (input.kind) {
      case InputKind::motor: id = inputs.add_motor(input.name); break;
      case InputKind::force: id = inputs.add_force(input.name, point, input.axes); break;
      case InputKind::wrench: id = inputs.add_wrench(input.name, point, input.axes); break;
    }
    inputs.set_active(id, input.active);
  }
  return inputs;
}

struct RandomState {
  Eigen::VectorXd q, qd, u;
};

/// A state of the tree (unit quaternions) and values of its active inputs.
template <class Tree>
RandomState random_state(const Tree& tree, Index columns, Random& random, double speed = 1)
{
  RandomState state{Eigen::VectorXd(tree.n_q()), Eigen::VectorXd(tree.n_v()), Eigen::VectorXd(columns)};
  tree.outward([&]<class N, class S>(const N& node, const S&) {
    for (Index k = 0; k < S::n_q; ++k) { state.q(node.q + k) = random.uniform(-1.5, 1.5); }
    if constexpr (iim::detail::is_free<S>()) { state.q.template segment<4>(node.q + 3) = random.quaternion(); }
  });
  for (double& x : state.qd) { x = speed * random.uniform(-1, 1); }
  for (double& x : state.u) { x = random.uniform(-1, 1); }
  return state;
}

}  // namespace iim::test
