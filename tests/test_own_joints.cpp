// PROGRAM: tests_drives
// Types of one's own that the library has none like: coordinates in other units than rad and m, wheels that move no
// frame, more velocities than a frame can have, a fixed part that says nothing of how it moves. By products
// and by sweeps, against M⁻¹B and −M⁻¹h of the equations of motion in long double.
#include "catch.hpp"
#include "random_tree.hpp"
#include "worst.hpp"

#include <iim/equations_of_motion.hpp>
#include <iim/iim.hpp>
#include <iim/unit_force.hpp>

#include <Eigen/Cholesky>

#include <array>
#include <cstdint>
#include <limits>
#include <string>
#include <type_traits>

namespace test_own_joints {

using namespace iim;

namespace {

template <class T>
Matrix3<T> about_z(const T& angle)
{
  return Eigen::AngleAxis<T>(angle, Vector3<T>::UnitZ()).toRotationMatrix();
}

/// Turns by `turning` rad about its z axis and slides by `sliding` m per unit of its coordinate.
template <class T>
struct Screw {
  using Scalar = T;
  static constexpr int n_q = 1, n_i = 1, n_u = 1, n_frames = 1;
  static constexpr MotionPattern pattern{.bias = false};
  using Number = Eigen::Matrix<T, 1, 1>;

  T turning{1}, sliding{1};
  Body<T> body{};

  void prepare(const std::string& name) { validate(body, name); }
  bool motion(const Matrix3<T>& R, const Number& q, const Number&, std::array<FrameMotion<T, 1>, 1>& frame) const
  {
    const Vector3<T> axis = R.col(2);
    frame[0].R = R * about_z(T(turning * q(0)));
    frame[0].r = axis * (sliding * q(0));
    frame[0].S.col(0) << axis * sliding, axis * turning;
    return true;
  }
  Vector6<T> own_twist() const
  {
    Vector6<T> twist;
    twist << T(0), T(0), sliding, T(0), T(0), turning;
    return twist;
  }
  std::array<CarriedBody<T>, 1> bodies() const { return {{{0, body}}}; }
  Number Bbar(const Number&) const { return Number(T(1)); }
  template <class U>
  Screw<U> cast() const
  {
    return {U(turning), U(sliding), body.template cast<U>()};
  }
};

/// A hinge about z whose coordinate is counted in parts of `turning` rad.
template <class T>
struct Counted {
  using Scalar = T;
  static constexpr int n_q = 1, n_i = 1, n_u = 1, n_frames = 1;
  static constexpr MotionPattern pattern{.linear = false, .offset = false, .bias = false};
  using Number = Eigen::Matrix<T, 1, 1>;

  T turning{1};
  Body<T> body{};

  void prepare(const std::string& name) { validate(body, name); }
  bool motion(const Matrix3<T>& R, const Number& q, const Number&, std::array<FrameMotion<T, 1>, 1>& frame) const
  {
    frame[0].R = R * about_z(T(turning * q(0)));
    frame[0].S.col(0).template tail<3>() = R.col(2) * turning;
    return true;
  }
  std::array<CarriedBody<T>, 1> bodies() const { return {{{0, body}}}; }
  Number Bbar(const Number&) const { return Number(T(1)); }
  template <class U>
  Counted<U> cast() const
  {
    return {U(turning), body.template cast<U>()};
  }
};

/// A fixed housing with n wheels in it.
template <class T, int n>
struct Wheels {
  using Scalar = T;
  static constexpr int n_q = n, n_i = n, n_u = n, n_frames = 1;
  static constexpr MotionPattern pattern{.linear = false, .angular = false, .offset = false, .bias = false};
  using Numbers = Eigen::Matrix<T, n, 1>;

  Body<T> body{};

  void prepare(const std::string& name) { validate(body, name); }
  bool motion(const Matrix3<T>& R, const Numbers&, const Numbers&, std::array<FrameMotion<T, n>, 1>& frame) const
  {
    frame[0].R = R;
    return true;
  }
  std::array<CarriedBody<T>, 1> bodies() const { return {{{0, body}}}; }
  std::array<Rotor<T, n>, n> rotors() const
  {
    std::array<Rotor<T, n>, n> rotors;
    for (int k = 0; k < n; ++k) {
      auto& rotor = rotors[static_cast<std::size_t>(k)];
      rotor = {0, Vector3<T>::Unit(k % 3), T(1 + k) / T(128), {}, true};
      rotor.ratio.setZero();
      rotor.ratio(k) = T(1);
    }
    return rotors;
  }
  Eigen::Matrix<T, n, n> Bbar(const Numbers&) const { return Eigen::Matrix<T, n, n>::Identity(); }
  template <class U>
  Wheels<U, n> cast() const
  {
    return {body.template cast<U>()};
  }
};

/// A fixed part with a pattern that excludes nothing.
template <class T>
struct Stand {
  using Scalar = T;
  static constexpr int n_q = 0, n_i = 0, n_u = 0, n_frames = 1;
  static constexpr MotionPattern pattern{};
  using Numbers = Eigen::Matrix<T, 0, 1>;

  Vector3<T> to_frame = Vector3<T>::Zero();
  Body<T> body{};

  void prepare(const std::string& name) { validate(body, name); }
  bool motion(const Matrix3<T>& R, const Numbers&, const Numbers&, std::array<FrameMotion<T, 0>, 1>& frame) const
  {
    frame[0].R = R;
    frame[0].r = R * to_frame;
    return true;
  }
  std::array<CarriedBody<T>, 1> bodies() const { return {{{0, body}}}; }
  Eigen::Matrix<T, 0, 0> Bbar(const Numbers&) const { return {}; }
  template <class U>
  Stand<U> cast() const
  {
    return {to_frame.template cast<U>(), body.template cast<U>()};
  }
};

using Parts = Assembly<Screw<double>, Counted<double>, Wheels<double, 1>, Wheels<double, 8>, Stand<double>,
                       RevoluteLink<double>, FloatingBase<double>>;
using Exact = long double;

/// q̈₀ and B̂ side by side.
template <class Dynamics>
MatrixX<Exact> joined(const Dynamics& dynamics)
{
  MatrixX<Exact> all(dynamics.qdd0.size(), dynamics.Bhat.cols() + 1);
  all << dynamics.qdd0.template cast<Exact>(), dynamics.Bhat.template cast<Exact>();
  return all;
}

MatrixX<Exact> exact(const Parts& parts, const test::RandomState& state)
{
  const DynamicTree tree(parts.cast<Exact>());
  Inputs inputs(tree);
  inputs.add_wrench("last");
  Workspace ws(tree);
  EquationsOfMotion equations(tree, inputs);
  const auto motion = equations(VectorX<Exact>(state.q.cast<Exact>()), VectorX<Exact>(state.qd.cast<Exact>()), ws);
  REQUIRE(motion.ok());
  const VectorX<Exact> scale = motion.M.diagonal().cwiseSqrt().cwiseInverse();
  MatrixX<Exact> right(motion.h.size(), motion.B.cols() + 1);
  right << -motion.h, motion.B;
  const Eigen::LDLT<MatrixX<Exact>> scaled(scale.asDiagonal() * motion.M * scale.asDiagonal());
  return scale.asDiagonal() * scaled.solve(scale.asDiagonal() * right);
}

/// The largest error of a column of B̂, or of q̈₀, in ε.
struct Errors {
  double by_product = 0, by_sweep = 0;
};

template <Update update, class Tree>
void add_errors(const Tree& tree, const test::RandomState& state, const MatrixX<Exact>& right, Errors& errors)
{
  Inputs<Tree> inputs(tree);
  inputs.add_wrench("last");
  Workspace<Tree, update> ws(tree);
  ImplicitInversion<Tree> product(tree, inputs);
  REQUIRE(product.product_from() <= inputs.columns());
  UnitForce<Tree> sweep(tree, inputs);
  const auto fd = forward_dynamics(state.q, state.qd, ws);
  const auto add = [&](const auto& dynamics, double& worst) {
    REQUIRE(dynamics.ok());
    const MatrixX<Exact> off = joined(dynamics) - right;
    for (Index j = 0; j < right.cols(); ++j) {
      const double error = static_cast<double>(off.col(j).norm() / right.col(j).norm());
      test::keep_worst(worst, error / std::numeric_limits<double>::epsilon());
    }
  };
  add(product(fd), errors.by_product);
  add(sweep(fd), errors.by_sweep);
}

/// make(random): the robot, whose last link is "last". Its coordinates are as much smaller than 1 as `unit` is larger.
template <class Make>
void check(Make&& make, double unit)
{
  Errors projected, root;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    test::Random random(seed);
    const Parts parts = make(random);
    const DynamicTree tree(parts);
    test::RandomState state = test::random_state(tree, 0, random);
    tree.outward([&]<class S>(const Node& node, const S&) {
      if constexpr (S::n_i == 1 && !std::is_same_v<S, RevoluteLink<double>>) {
        state.q(node.q) /= unit;
        state.qd(node.v) /= unit;
      }
    });
    const MatrixX<Exact> right = exact(parts, state);
    add_errors<Update::projected>(tree, state, right, projected);
    add_errors<Update::square_root>(tree, state, right, root);
  }
  CHECK(projected.by_product < 512);  // 170 where the screws hardly turn, else 106
  CHECK(projected.by_sweep < 512);
  CHECK(root.by_product < 512);  // there 50 to 171 by compiler, else 41
  CHECK(root.by_sweep < 512);
}

/// On a free base or on the world, joints about, or along, one direction that lies obliquely in the world.
template <class Add>
Parts chain(int joints, test::Random& random, Add&& add)
{
  Parts parts;
  Attachment<double> on;
  if (random.chance(0.5)) {
    parts.add("base", on, FloatingBase<double>{random.body()});
    on.parent = "base";
  }
  on.R = random.rotation();
  for (int k = 0; k < joints; ++k) {
    const std::string name = k + 1 < joints ? "link" + std::to_string(k) : "last";
    on.p = random.vector(0.4);
    add(parts, name, on);
    on.parent = name;
    on.R.setIdentity();
  }
  return parts;
}

}  // namespace

TEST_CASE("screws and hinges whose coordinates have other units than rad and m")
{
  for (const double unit : {0.1, 1.0, 6.25, 57.0, 628.0}) {
    for (const int joints : {4, 7}) {  // so many parallel ones are a group
      CAPTURE(unit, joints);
      const auto of_screws = [&](test::Random& random) {
        return chain(joints, random, [&](Parts& parts, const std::string& name, const auto& on) {
          parts.add(name, on, Screw<double>{unit, random.uniform(-1, 1), random.body()});
        });
      };
      check(of_screws, unit);
      const auto of_hinges = [&](test::Random& random) {
        return chain(joints, random, [&](Parts& parts, const std::string& name, const auto& on) {
          parts.add(name, on, Counted<double>{unit, random.body()});
        });
      };
      check(of_hinges, unit);
    }
  }
}

TEST_CASE("of which unit a coordinate is does not matter to a bit")
{
  for (const double load : {1.0, 1e3, 1e7}) {
    for (std::uint64_t seed = 1; seed <= 20; ++seed) {
      CAPTURE(load, seed);
      const auto dynamics = [&](double unit) {
        test::Random random(seed);
        const Parts parts = chain(7, random, [&](Parts& all, const std::string& name, const auto& on) {
          Body<double> body = random.body();
          if (name == "last") {
            body.mass *= load;
            body.inertia *= load;
          }
          if (random.chance(0.5)) {
            all.add(name, on, Screw<double>{unit, unit * random.uniform(-1, 1), body});
          } else {
            all.add(name, on, Counted<double>{unit, body});
          }
        });
        const DynamicTree tree(parts);
        Inputs inputs(tree);
        inputs.add_wrench("last");
        Workspace ws(tree);
        ImplicitInversion method(tree, inputs);
        test::RandomState state = test::random_state(tree, 0, random);
        const Index joints = 7;
        state.q.tail(joints) /= unit;
        state.qd.tail(joints) /= unit;
        const auto result = method(forward_dynamics(state.q, state.qd, ws));
        REQUIRE(result.ok());
        // In the units of the first: q̈ of joints times `unit`, columns of their motors as well.
        Eigen::MatrixXd all(tree.n_v(), 1 + result.Bhat.cols());
        all << result.qdd0, result.Bhat;
        all.bottomRows(joints) *= unit;
        all.middleCols(1, joints) *= unit;
        return all;
      };
      const Eigen::MatrixXd right = dynamics(2);  // of columns of length 1 some sums are others
      CHECK((dynamics(0x1p20) - right).norm() == 0);
      CHECK((dynamics(0x1p-20) - right).norm() == 0);
    }
  }
}

TEST_CASE("wheels that move no frame, and a fixed part of any pattern")
{
  const auto robot = [](test::Random& random) {
    Parts parts;
    Attachment<double> on;
    const auto add = [&](const std::string& name, const auto& part) {
      on.p = random.vector(0.3);
      on.R = random.rotation();
      parts.add(name, on, part);
      on.parent = name;
    };
    if (random.chance(0.5)) { add("base", FloatingBase<double>{random.body()}); }
    add("arm", RevoluteLink<double>{{random.unit()}, random.body()});
    add("wheel", Wheels<double, 1>{random.body()});
    add("stand", Stand<double>{random.vector(0.3), random.body()});
    add("forearm", RevoluteLink<double>{{random.unit()}, random.body()});
    add("wheels", Wheels<double, 8>{random.body()});
    for (const char* name : {"finger", "thumb"}) {
      parts.add(name, {.parent = "wheels", .p = random.vector(0.3)},
                RevoluteLink<double>{{random.unit()}, random.body()});
    }
    add("last", RevoluteLink<double>{{random.unit()}, random.body()});
    return parts;
  };
  check(robot, 1);
}

}  // namespace test_own_joints
