// PROGRAM: tests_implicit
// The linearly implicit step: against M + h C + h² K put together densely, with every update and method.
#include "catch.hpp"

#include <iim/equations_of_motion.hpp>
#include <iim/global_inverse.hpp>
#include <iim/recursive_inverse.hpp>
#include <iim/subsystem/elastic_motor_arm.hpp>
#include <iim/subsystem/sprung.hpp>
#include <iim/subsystem_matrices.hpp>
#include <iim/unit_force.hpp>

#include "random_tree.hpp"

#include <array>
#include <cmath>
#include <limits>

using namespace iim;

namespace {

using Link = Sprung<RevoluteLink<double>>;
using Drive = ElasticMotorArm<double>;
using Robot = Assembly<FloatingBase<double>, Link, Drive, RevoluteLink<double>>;

struct Sample {
  Robot robot;
  Eigen::MatrixXd K, C;  // by the tree's velocities
};

/// A floating base with limbs of sprung links, elastic drives and plain links, without a special order.
Sample sample(std::uint64_t seed, double stiffest)
{
  test::Random draw(seed);
  Sample s;
  const auto on = [&](const std::string& parent) {
    return Attachment<double>{parent, draw.rotation(), draw.vector(0.5)};
  };
  s.robot.add("base", {}, FloatingBase<double>{draw.body()});
  const auto stiffness = [&] { return std::pow(10.0, draw.uniform(0, std::log10(stiffest))); };
  std::vector<std::string> parents{"base"};
  for (int k = 0; k < 9; ++k) {
    const std::string name = "part " + std::to_string(k);
    const std::string parent = parents[static_cast<std::size_t>(draw.below(static_cast<int>(parents.size())))];
    if (k % 3 == 0) {
      Link link;
      link.joint.axis = draw.axis();
      link.body = draw.body();
      link.stiffness(0) = stiffness();
      link.damping(0) = std::pow(10.0, draw.uniform(-2, 2));
      link.rest(0) = draw.uniform(-1, 1);
      s.robot.add(name, on(parent), link);
    } else if (k % 3 == 1) {
      Drive drive;
      drive.joint.axis = draw.axis();
      drive.body = draw.body();
      drive.motor = draw.motor();
      drive.stiffness = stiffness();
      drive.damping = std::pow(10.0, draw.uniform(-2, 2));
      s.robot.add(name, on(parent), drive);
    } else {
      RevoluteLink<double> link;
      link.joint.axis = draw.axis();
      link.body = draw.body();
      s.robot.add(name, on(parent), link);
    }
    parents.push_back(name);
  }
  const DynamicTree tree(s.robot);
  s.K = s.C = Eigen::MatrixXd::Zero(tree.n_v(), tree.n_v());
  for (Index i = 0; i < tree.size(); ++i) {
    tree.visit(i, [&]<class N, class S>(const N& node, const S& part) {
      if constexpr (std::is_same_v<S, Link>) {
        s.K(node.v, node.v) = part.stiffness(0);
        s.C(node.v, node.v) = part.damping(0);
      } else if constexpr (std::is_same_v<S, Drive>) {
        const Eigen::RowVector2d twist(-1 / part.motor.gear_ratio, 1);
        s.K.block<2, 2>(node.v, node.v) = part.stiffness * twist.transpose() * twist;
        s.C.block<2, 2>(node.v, node.v) = part.damping * twist.transpose() * twist;
      }
    });
  }
  return s;
}

double apart(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) { return (a - b).norm() / b.norm(); }

/// B̂ and q̈₀ of a step h from the explicit ones: with M⁻¹ from unit forces on every velocity.
struct Dense {
  Eigen::MatrixXd Bhat;
  Eigen::VectorXd qdd0;
};

template <class Tree>
Dense dense_step(const Tree& tree, const Inputs<Tree>& inputs, const Sample& s, const Eigen::VectorXd& q,
                 const Eigen::VectorXd& qd, double h)
{
  Workspace<Tree, Update::square_root> ws(tree);
  RecursiveInverse method(tree, inputs);
  const auto fd = forward_dynamics(q, qd, ws);
  const auto now = method(fd);
  REQUIRE(now.ok());
  // (1 + M⁻¹ (h C + h² K)) q̈ = q̈₀ − M⁻¹ h K q̇
  const Eigen::MatrixXd Minv = method.Minv();
  const Eigen::MatrixXd G = Eigen::MatrixXd::Identity(tree.n_v(), tree.n_v()) + Minv * (h * s.C + h * h * s.K);
  const auto solver = G.fullPivLu();
  return {solver.solve(now.Bhat), solver.solve(now.qdd0 - Minv * (h * s.K * qd))};
}

template <Update update>
void check_update(double bound)
{
  constexpr Scene implicit{.implicit = true};
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    INFO("seed " << seed);
    const Sample s = sample(seed, 1e4);
    const DynamicTree tree(s.robot);
    using Tree = std::remove_const_t<decltype(tree)>;
    Inputs inputs(tree);
    inputs.add_force("part 4");
    test::Random draw(seed);
    const test::RandomState state = test::random_state(tree, inputs.columns(), draw, 3.0);
    const double h = 0.01;
    const Dense expected = dense_step(tree, inputs, s, state.q, state.qd, h);

    Workspace<Tree, update> ws(tree);
    ImplicitInversion method(tree, inputs);
    const auto fd = implicit_step(state.q, state.qd, h, ws);
    CHECK(fd.step() == h);
    const auto result = method(fd);
    REQUIRE(result.ok());
    CHECK(apart(result.Bhat, expected.Bhat) < bound);
    CHECK(apart(result.qdd0, expected.qdd0) < bound);

    Workspace<Tree, update> other(tree);
    const auto with_inputs = implicit_step(state.q, state.qd, h, inputs, state.u, other);
    REQUIRE(with_inputs.status == Status::ok);
    CHECK(apart(with_inputs.qdd, expected.qdd0 + expected.Bhat * state.u) < bound);

    if constexpr (update != Update::projected) { continue; }
    // The rivals on the same receipt, or with the same scene.
    UnitForce on_workspace(tree, inputs);
    RecursiveInverse recursive(tree, inputs);
    GlobalInverse<Tree, Factorization::branch_sparse, implicit> global(tree, inputs);
    EquationsOfMotion<Tree, implicit> equations(tree, inputs);
    const auto of_step = equations(fd);
    CHECK(apart(of_step.M.llt().solve(of_step.B), expected.Bhat) < bound);
    CHECK(apart(of_step.M.llt().solve(-of_step.h), expected.qdd0) < bound);
    UnitForcePublished<Tree, update, implicit> published(tree, inputs);
    CHECK(apart(on_workspace(fd).Bhat, expected.Bhat) < bound);
    CHECK(apart(recursive(fd).Bhat, expected.Bhat) < bound);
    CHECK(apart(global(fd).Bhat, expected.Bhat) < bound);
    CHECK(apart(global(fd).qdd0, expected.qdd0) < bound);
    // (21) subtracts accelerations that are larger than the columns.
    const double cancelled = 1 + result.qdd0.norm() / result.Bhat.colwise().norm().minCoeff();
    CHECK(apart(published(fd, state.q, state.qd).Bhat, expected.Bhat) < bound * cancelled);
  }
}

// The dense solution loses cond(1 + M⁻¹(…)) of its own, and the matrix forms what rotors a million times lighter than
// their springs' h²K cost.
constexpr double roundoff = std::numeric_limits<double>::epsilon();

}  // namespace

TEST_CASE("implicit step, projected update") { check_update<Update::projected>(1e6 * roundoff); }
TEST_CASE("implicit step, update as printed") { check_update<Update::printed>(1e6 * roundoff); }
TEST_CASE("implicit step, square-root form") { check_update<Update::square_root>(1e6 * roundoff); }

TEST_CASE("a step of length 0 is forward dynamics")
{
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {  // with weak pivots among them
    const Sample s = sample(seed, 1e4);
    const DynamicTree tree(s.robot);
    test::Random draw(seed);
    Workspace now(tree), step(tree);
    const test::RandomState state = test::random_state(tree, 0, draw, 3.0);
    CHECK(forward_dynamics(state.q, state.qd, now).qdd0() == implicit_step(state.q, state.qd, 0.0, step).qdd0());
  }
}

TEST_CASE("the matrices of a subsystem have what the step adds")
{
  const Sample s = sample(3, 1e4);
  const DynamicTree tree(s.robot);
  test::Random draw(3);
  const test::RandomState state = test::random_state(tree, 0, draw, 3.0);
  const double h = 0.01;
  Workspace now(tree), step(tree);
  const auto explicit_fd = forward_dynamics(state.q, state.qd, now);
  const auto implicit_fd = implicit_step(state.q, state.qd, h, step);
  for (Index i = 0; i < tree.size(); ++i) {
    const auto before = subsystem_matrices(explicit_fd, i);
    const auto after = subsystem_matrices(implicit_fd, i);
    const Index v = tree.node(i).v, n_i = before.F.cols();
    Eigen::MatrixXd added = Eigen::MatrixXd::Zero(6 + n_i, 6 + n_i);
    added.bottomRightCorner(n_i, n_i) = (h * s.C + h * h * s.K).block(v, v, n_i, n_i);
    CHECK((after.Mbar - before.Mbar - added).norm() <= 16 * roundoff * after.Mbar.norm());
    const Eigen::VectorXd stretched = h * s.K.block(v, v, n_i, n_i) * state.qd.segment(v, n_i);
    CHECK((after.hbar.tail(n_i) - before.hbar.tail(n_i) - stretched).norm() <= 16 * roundoff * (1 + after.hbar.norm()));
  }
}

TEST_CASE("a step that is no length of time is a status")
{
  const Sample s = sample(3, 1e4);
  const DynamicTree tree(s.robot);
  const Inputs inputs(tree);
  test::Random draw(3);
  const test::RandomState state = test::random_state(tree, 0, draw, 3.0);
  Workspace ws(tree);
  ImplicitInversion method(tree, inputs);
  for (const double h : {-1e-3, std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    const auto result = method(implicit_step(state.q, state.qd, h, ws));
    CHECK(result.status == Status::invalid_state);
    CHECK(result.Bhat.array().isNaN().all());
  }
  CHECK(method(implicit_step(state.q, state.qd, 1e-3, ws)).ok());
}

TEST_CASE("springs and dampers that cannot be are refused by name")
{
  const auto is_refused = [](double stiffness, double damping, const char* value) {
    Link link;
    link.body.mass = 1;
    link.stiffness(0) = stiffness;
    link.damping(0) = damping;
    CHECK_THROWS_WITH(DynamicTree(Robot().add("knee", {}, link)),
                      Catch::Matchers::ContainsSubstring("knee") && Catch::Matchers::ContainsSubstring(value));
  };
  is_refused(-5, 0, "-5");
  is_refused(0, -7, "-7");
}

TEST_CASE("the matrices of a step are the same after a pass in square-root form, which keeps springs' forces apart")
{
  constexpr Scene implicit{.implicit = true};
  const Sample s = sample(3, 1e4);
  const DynamicTree tree(s.robot);
  using Tree = std::remove_const_t<decltype(tree)>;
  const Inputs<Tree> inputs(tree);
  test::Random draw(3);
  const test::RandomState state = test::random_state(tree, 0, draw, 3.0);
  Workspace<Tree> ws(tree);
  Workspace<Tree, Update::square_root> root(tree);
  const auto fd = implicit_step(state.q, state.qd, 0.01, ws);
  const auto of_root = implicit_step(state.q, state.qd, 0.01, root);
  EquationsOfMotion<Tree, implicit> equations(tree, inputs), equations_of_root(tree, inputs);
  const auto expected = equations(fd), found = equations_of_root(of_root);
  REQUIRE(found.ok());
  CHECK(apart(found.M, expected.M) < 1000 * roundoff);
  CHECK(apart(found.h, expected.h) < 1000 * roundoff);
  GlobalInverse<Tree, Factorization::branch_sparse, implicit> global(tree, inputs), global_of_root(tree, inputs);
  CHECK(apart(global_of_root(of_root).qdd0, global(fd).qdd0) < 1e6 * roundoff);
  for (Index i = 0; i < tree.size(); ++i) {
    const auto of_part = subsystem_matrices(fd, i), of_part_of_root = subsystem_matrices(of_root, i);
    CHECK(apart(of_part_of_root.Mbar, of_part.Mbar) < 1000 * roundoff);
    CHECK(apart(of_part_of_root.hbar, of_part.hbar) < 1000 * roundoff);
  }
}

namespace {

/// A sprung link that rubs, with a spring of constant force: internal forces that springs() does not tell the change
/// of.
struct RubbingLink : Sprung<RevoluteLink<double>> {
  using Sprung::Coordinates;
  static constexpr double pull = 0.3;

  Coordinates internal_force(const Coordinates& q, const Coordinates& qd) const
  {
    return Sprung::internal_force(q, qd) + Coordinates(pull + 0.7 * std::tanh(10 * qd(0)));
  }
  std::array<Spring<double, 1>, 2> springs(const Coordinates& q, const Coordinates& qd) const
  {
    return {Sprung::springs(q, qd)[0], {Coordinates(1), 0, 0, pull}};
  }
};

template <Update update>
void check_rubbing(double h)
{
  RubbingLink link;
  link.joint.axis = test::Vec3::UnitZ();
  link.body = {2, test::Vec3::Zero(), test::Vec3(0.5, 0.5, 0.5).asDiagonal(), false};
  link.stiffness(0) = 300;
  link.damping(0) = 4;
  link.rest(0) = 0.2;
  Assembly<RubbingLink> parts;
  const DynamicTree tree(parts.add("link", {}, link));
  Workspace<std::remove_const_t<decltype(tree)>, update> ws(tree);
  const Eigen::Matrix<double, 1, 1> q(0.5), qd(0.3);
  const auto fd = implicit_step(q, qd, h, ws);
  REQUIRE(fd.ok());
  const double force = 300 * (0.5 - 0.2) + 4 * 0.3 + 0.3 + 0.7 * std::tanh(3.0) + h * 300 * 0.3;
  CHECK(std::abs(fd.qdd0()(0) / (-force / (0.5 + h * 4 + h * h * 300)) - 1) < 16 * roundoff);
}

}  // namespace

TEST_CASE("what springs do not tell of internal forces is there in a step, as it is at its beginning")
{
  for (const double h : {0.0, 0.01}) {
    check_rubbing<Update::projected>(h);
    check_rubbing<Update::printed>(h);
    check_rubbing<Update::square_root>(h);
  }
}
