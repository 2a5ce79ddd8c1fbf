// PROGRAM: tests_methods
// Laws of q̈ = q̈₀ + B̂u that hold whatever the formulas: superposition, order, place in the world, symmetry, limits.
#include "catch.hpp"
#include "random_tree.hpp"

#include <Eigen/Cholesky>

#include <algorithm>
#include <limits>
#include <string>
#include <utility>
#include <vector>

namespace test_law {

using namespace iim;
using test::RandomRobot;

namespace {

constexpr double eps = std::numeric_limits<double>::epsilon();
using Tree = decltype(DynamicTree(std::declval<StandardAssembly<double>>()));

struct Result {
  Eigen::MatrixXd Bhat;
  Eigen::VectorXd qdd0;
};

Result solve(const Tree& tree, const Inputs<Tree>& inputs, const Eigen::VectorXd& q, const Eigen::VectorXd& qd)
{
  Workspace ws(tree);
  ImplicitInversion method(tree, inputs);
  const auto result = method(forward_dynamics(q, qd, ws));
  REQUIRE(result.ok());
  return {result.Bhat, result.qdd0};
}

double apart(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b)
{
  REQUIRE(a.rows() == b.rows());
  REQUIRE(a.cols() == b.cols());
  const double scale = std::max(a.norm(), b.norm());
  return scale > 0 ? (a - b).norm() / scale : 0;
}

/// The same robot with its parts changed by `edit`.
template <class Edit>
StandardAssembly<double> edited(const StandardAssembly<double>& assembly, Edit&& edit)
{
  StandardAssembly<double> other;
  other.set_gravity(assembly.gravity());
  for (auto part : assembly.parts()) {
    edit(part);
    std::visit([&](const auto& s) { other.add(part.name, part.on, s); }, part.part);
  }
  for (const auto& frame : assembly.named_frames()) { other.add_frame(frame.name, frame.on); }
  return other;
}

test::RandomOptions everything()
{
  test::RandomOptions options;
  options.floating_inside = 0.1;
  return options;
}

// Two results with the relative error that test_reference_library allows the projected update.
constexpr double twice = 2 * 800 * eps;

}  // namespace

TEST_CASE("q̈ is affine in u, and forward dynamics with u is that affine function", "[law]")
{
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    INFO("seed " << seed);
    const RandomRobot random = test::random_robot(seed, everything());
    const Tree tree(random.assembly);
    const Inputs inputs = test::make_inputs(tree, random.inputs);
    test::Random draw(seed);
    const test::RandomState state = test::random_state(tree, inputs.columns(), draw);
    const Result result = solve(tree, inputs, state.q, state.qd);
    Workspace ws(tree);
    for (double size : {0.0, 1.0, -30.0}) {
      const Eigen::VectorXd u = size * state.u;
      const auto acceleration = forward_dynamics(state.q, state.qd, inputs, u, ws);
      REQUIRE(acceleration.status == Status::ok);
      const Eigen::VectorXd affine = result.qdd0 + result.Bhat * u;
      CHECK((acceleration.qdd - affine).norm() <= twice * (result.qdd0.norm() + (result.Bhat * u).norm()));
    }
  }
}

TEST_CASE("the order of adding permutes rows and nothing else", "[law]")
{
  for (std::uint64_t seed = 1; seed <= 100; ++seed) {
    INFO("seed " << seed);
    RandomRobot random = test::random_robot(seed, everything());
    const Tree tree(random.assembly);
    const Inputs inputs = test::make_inputs(tree, random.inputs);
    test::Random draw(seed);
    const test::RandomState state = test::random_state(tree, inputs.columns(), draw);
    const Result result = solve(tree, inputs, state.q, state.qd);

    auto parts = random.assembly.parts();
    draw.shuffle(parts);
    StandardAssembly<double> shuffled;
    shuffled.set_gravity(random.assembly.gravity());
    for (const auto& frame : random.assembly.named_frames()) { shuffled.add_frame(frame.name, frame.on); }
    for (const auto& part : parts) {
      std::visit([&](const auto& s) { shuffled.add(part.name, part.on, s); }, part.part);
    }
    const Tree other(shuffled);
    REQUIRE(other.n_v() == tree.n_v());

    // Where each coordinate and velocity of the other tree is in the first.
    Eigen::VectorXd q(tree.n_q()), qd(tree.n_v());
    Eigen::VectorXi row(tree.n_v());
    other.outward([&]<class N, class S>(const N& node, const S&) {
      const Node& first = tree.node(tree.index(other.name(node.index)));
      q.template segment<S::n_q>(node.q) = state.q.template segment<S::n_q>(first.q);
      for (Index d = 0; d < S::n_i; ++d) {
        row(node.v + d) = static_cast<int>(first.v + d);
        qd(node.v + d) = state.qd(first.v + d);
      }
    });
    const Result permuted = solve(other, test::make_inputs(other, random.inputs), q, qd);
    CHECK(apart(permuted.Bhat, result.Bhat(row, Eigen::indexing::all)) < twice);
    CHECK(apart(permuted.qdd0, result.qdd0(row)) < twice);
  }
}

TEST_CASE("the columns of B̂ are the blocks in the order of adding, less the inactive ones", "[law]")
{
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    INFO("seed " << seed);
    RandomRobot random = test::random_robot(seed, everything());
    for (test::NamedInput& input : random.inputs) { input.active = true; }
    const Tree tree(random.assembly);
    Inputs inputs = test::make_inputs(tree, random.inputs);
    test::Random draw(seed);
    const test::RandomState state = test::random_state(tree, 0, draw);
    const Result all = solve(tree, inputs, state.q, state.qd);
    Workspace ws(tree);
    ImplicitInversion method(tree, inputs);  // one method for all choices
    for (int choice = 0; choice < 4; ++choice) {
      std::vector<Index> columns;
      for (Index id = 0; id < inputs.blocks(); ++id) { inputs.set_active(id, true); }
      std::vector<Index> first;
      for (Index id = 0; id < inputs.blocks(); ++id) { first.push_back(inputs.column(id)); }
      for (Index id = 0; id < inputs.blocks(); ++id) {
        const bool active = draw.chance(0.5);
        inputs.set_active(id, active);
        for (Index j = 0; active && j < inputs.block(id).size; ++j) {
          columns.push_back(first[static_cast<std::size_t>(id)] + j);
        }
      }
      const auto some = method(forward_dynamics(state.q, state.qd, ws));
      REQUIRE(some.Bhat.cols() == inputs.columns());
      REQUIRE(inputs.columns() == static_cast<Index>(columns.size()));
      // The same products in the same order, but for the tiles that columns are treated in.
      for (std::size_t k = 0; k < columns.size(); ++k) {
        CHECK(apart(some.Bhat.col(static_cast<Index>(k)), all.Bhat.col(columns[k])) < 64 * eps);
      }
    }
  }
}

TEST_CASE("the place of the robot in the world does not matter", "[law]")
{
  for (std::uint64_t seed = 1; seed <= 100; ++seed) {
    INFO("seed " << seed);
    RandomRobot random = test::random_robot(seed, everything());
    for (test::NamedInput& input : random.inputs) { input.axes = Axes::body; }
    const Tree tree(random.assembly);
    const Inputs inputs = test::make_inputs(tree, random.inputs);
    test::Random draw(seed);
    const test::RandomState state = test::random_state(tree, inputs.columns(), draw);
    const Result result = solve(tree, inputs, state.q, state.qd);

    // A floating base's q and q̇ are relative to its coupling point on the world, so that they stay.
    const test::Mat3 R = draw.rotation();
    const test::Vec3 p = draw.vector(1e6);  // nothing is computed about the world's origin
    auto moved = edited(random.assembly, [&](auto& part) {
      if (part.on.parent == "world") {
        part.on.R = R * part.on.R;
        part.on.p = R * part.on.p + p;
      }
    });
    moved.set_gravity(R * random.assembly.gravity());
    const Tree elsewhere(moved);
    const Result same = solve(elsewhere, test::make_inputs(elsewhere, random.inputs), state.q, state.qd);
    CHECK(apart(same.Bhat, result.Bhat) < twice);
    CHECK(apart(same.qdd0, result.qdd0) < twice);
  }
}

TEST_CASE("a force in world axes is the same force in body axes, turned", "[law]")
{
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    INFO("seed " << seed);
    const RandomRobot random = test::random_robot(seed, everything());
    const Tree tree(random.assembly);
    test::Random draw(seed);
    const test::RandomState state = test::random_state(tree, 0, draw);
    const FrameReference<double>& frame = tree.frame("f0");
    Inputs inputs(tree, Start::empty);
    const test::Vec3 x = draw.vector(0.5);
    inputs.add_wrench("f0", x, Axes::world);
    inputs.add_wrench("f0", x, Axes::body);
    inputs.add_force("f0", x, Axes::world);
    const Result result = solve(tree, inputs, state.q, state.qd);
    Workspace ws(tree);
    REQUIRE(forward_dynamics(state.q, state.qd, ws).ok());
    const test::Mat3 R = ws.frame(frame.frame).R * frame.at.R;
    CHECK(apart(result.Bhat.middleCols<3>(6), result.Bhat.middleCols<3>(0) * R) < 64 * eps);
    CHECK(apart(result.Bhat.middleCols<3>(9), result.Bhat.middleCols<3>(3) * R) < 64 * eps);
    CHECK(apart(result.Bhat.middleCols<3>(12), result.Bhat.middleCols<3>(0)) < 64 * eps);
  }
}

TEST_CASE("with a unit force on every velocity B̂ is M⁻¹: symmetric and positive definite", "[law]")
{
  test::RandomOptions options;
  options.motor_arm = 0;
  options.floating_root = 0;
  options.floating_inside = 0;
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    INFO("seed " << seed);
    const RandomRobot random = test::random_robot(seed, options);
    const Tree tree(random.assembly);
    const Inputs inputs(tree);  // all motors, in the order of velocities
    REQUIRE(inputs.columns() == tree.n_v());
    if (tree.n_v() == 0) { continue; }
    test::Random draw(seed);
    const test::RandomState state = test::random_state(tree, 0, draw);
    const Eigen::MatrixXd M_inv = solve(tree, inputs, state.q, state.qd).Bhat;
    const Eigen::VectorXd root = M_inv.diagonal().cwiseSqrt();
    // Scaled by its diagonal all entries are at most one; L β sums at most n_v of them.
    const Eigen::MatrixXd scaled = root.cwiseInverse().asDiagonal() * M_inv * root.cwiseInverse().asDiagonal();
    CHECK((scaled - scaled.transpose()).cwiseAbs().maxCoeff() < 8 * static_cast<double>(tree.n_v()) * eps);
    CHECK(Eigen::LLT<Eigen::MatrixXd>(M_inv).info() == Eigen::Success);
  }
}

TEST_CASE("a motor of ratio zero moves nothing; on the world, armature and full coupling are one", "[law]")
{
  test::RandomOptions options;
  options.motor_arm = 1;
  options.fixed = 0;
  options.armature = 0;
  const auto with_motors = [](const StandardAssembly<double>& assembly, const auto& edit) {
    return Tree(edited(assembly, [&](auto& part) {
      std::visit(
          [&](auto& s) {
            if constexpr (requires { s.motor; }) { edit(part.on.parent, s.motor); }
          },
          part.part);
    }));
  };
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    INFO("seed " << seed);
    const RandomRobot random = test::random_robot(seed, options);
    test::Random draw(seed);
    const Tree tree(random.assembly);
    const test::RandomState state = test::random_state(tree, 0, draw);

    const Tree locked =
        with_motors(random.assembly, [](const std::string&, Motor<double>& motor) { motor.gear_ratio = 0; });
    CHECK(solve(locked, Inputs(locked), state.q, state.qd).Bhat.isZero(0.0));

    const auto only_on_world = [&](bool armature) {
      return with_motors(random.assembly, [&](const std::string& parent, Motor<double>& motor) {
        if (parent == "world") {
          motor.armature = armature;
        } else {
          motor.axial_inertia = 0;  // neither coupling nor k²J
        }
      });
    };
    const Tree full = only_on_world(false), armature = only_on_world(true);
    const Result a = solve(full, Inputs(full), state.q, state.qd);
    const Result b = solve(armature, Inputs(armature), state.q, state.qd);
    CHECK(a.Bhat == b.Bhat);
    CHECK(a.qdd0 == b.qdd0);
  }
}

TEST_CASE("in a planar chain a rotor across the plane's normal couples nothing", "[law]")
{
  // All joints about y, rotors about x or z: aᵀω = 0, and the gyroscopic moment lies in the plane.
  const auto chain = [](bool armature) {
    test::Random draw(3);
    StandardAssembly<double> assembly;
    std::string parent = "world";
    for (int k = 0; k < 8; ++k) {
      MotorArm<double> arm{{test::Vec3::UnitY()}, draw.body(), draw.motor()};
      arm.motor.axis = k % 2 == 0 ? test::Vec3::UnitX() : test::Vec3::UnitZ();
      arm.motor.mass = 0;
      arm.motor.armature = armature;
      Attachment<double> on;
      on.parent = parent;
      on.p = test::Vec3(0.1, 0.05, -0.5);
      parent = "arm" + std::to_string(k);
      assembly.add(parent, on, arm);
    }
    return Tree(assembly);
  };
  const Tree full = chain(false), armature = chain(true);
  test::Random draw(4);
  const test::RandomState state = test::random_state(full, 0, draw);
  const Result a = solve(full, Inputs(full), state.q, state.qd);
  const Result b = solve(armature, Inputs(armature), state.q, state.qd);
  CHECK(apart(a.Bhat, b.Bhat) < 64 * eps);
  CHECK(apart(a.qdd0, b.qdd0) < 64 * eps);
}

TEST_CASE("a scene without velocity or gravity is the full one at zero", "[law]")
{
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    INFO("seed " << seed);
    const RandomRobot random = test::random_robot(seed, everything());
    auto weightless = random.assembly;
    weightless.set_gravity(test::Vec3::Zero());
    const Tree tree(random.assembly), free(weightless);
    test::Random draw(seed);
    const test::RandomState state = test::random_state(tree, 0, draw);
    const Eigen::VectorXd rest = Eigen::VectorXd::Zero(tree.n_v());
    Workspace ws(tree), ws_free(free);
    const Eigen::VectorXd at_rest = forward_dynamics(state.q, rest, ws).qdd0();
    const Eigen::VectorXd still = forward_dynamics<Scene{.velocity = false}>(state.q, rest, ws).qdd0();
    CHECK(apart(still, at_rest) < 64 * eps);
    const Eigen::VectorXd drifting = forward_dynamics(state.q, state.qd, ws_free).qdd0();
    const Eigen::VectorXd falling = forward_dynamics<Scene{.gravity = false}>(state.q, state.qd, ws).qdd0();
    CHECK(apart(falling, drifting) < 64 * eps);
  }
}

}  // namespace test_law
