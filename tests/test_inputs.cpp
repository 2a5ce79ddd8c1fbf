// PROGRAM: tests_methods
// Blocks of columns: their order, their switching, and what they mean.
#include "catch.hpp"
#include "random_tree.hpp"

#include <iim/models.hpp>
#include <iim/task.hpp>

#include <limits>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace test_inputs {

using namespace iim;
using test::Vec3;

namespace {

constexpr double eps = std::numeric_limits<double>::epsilon();
using Tree = decltype(DynamicTree(std::declval<StandardAssembly<double>>()));

/// base – arm – hand, and a rigid post on the world; "tip" turned on the hand.
Tree robot()
{
  test::Random draw(1);
  StandardAssembly<double> assembly;
  assembly.add("hand", {.parent = "arm", .p = draw.vector(1)}, RevoluteLink<double>{{draw.unit()}, draw.body()});
  assembly.add("base", {}, FloatingBase<double>{draw.body()});
  assembly.add("arm", {.parent = "base", .p = draw.vector(1)},
               MotorArm<double>{{draw.unit()}, draw.body(), draw.motor()});
  assembly.add("post", {}, FixedLink<double>{{}, draw.body()});
  assembly.add_frame("tip", {.parent = "hand", .R = draw.rotation(), .p = draw.vector(1)});
  return Tree(assembly);
}

}  // namespace

static_assert(!std::is_copy_assignable_v<Tree> && !std::is_move_assignable_v<Tree>);
static_assert(std::is_copy_constructible_v<Tree> && std::is_copy_assignable_v<Inputs<Tree>>);
static_assert(!std::is_constructible_v<Inputs<Tree>, Tree, Start>);

TEST_CASE("all motors stand first, in the order of subsystems", "[inputs]")
{
  const Tree tree = robot();
  Inputs inputs(tree);
  REQUIRE(inputs.blocks() == 2);
  CHECK(inputs.block(0).name == "arm");
  CHECK(inputs.block(1).name == "hand");
  CHECK(inputs.columns() == 2);
  CHECK(inputs.columns() == tree.n_motors());
}

TEST_CASE("columns of inactive blocks do not exist, and those after them move up", "[inputs]")
{
  const Tree tree = robot();
  Inputs inputs(tree, Start::empty);
  CHECK(inputs.columns() == 0);
  const auto wrench = inputs.add_wrench("tip");
  const auto hand = inputs.add_motor("hand");
  const auto force = inputs.add_force("base");
  const auto arm = inputs.add_motor("arm");
  const std::vector<Index> widths{6, 1, 3, 1};
  for (unsigned choice = 0; choice < 16; ++choice) {
    Index column = 0;
    for (const auto id : {wrench, hand, force, arm}) { inputs.set_active(id, (choice >> id & 1u) != 0); }
    for (const auto id : {wrench, hand, force, arm}) {
      const bool active = (choice >> id & 1u) != 0;
      CHECK(inputs.column(id) == (active ? column : -1));
      column += active ? widths[static_cast<std::size_t>(id)] : 0;
    }
    CHECK(inputs.columns() == column);
    CHECK(inputs.max_columns() == 11);
  }
}

TEST_CASE("no point, {} and three numbers", "[inputs]")
{
  const Tree tree = robot();
  Inputs inputs(tree, Start::empty);
  Tasks tasks(tree, inputs);
  const Vec3 origin = tree.frame("tip").at.p;
  for (const auto id : {inputs.add_force("tip", {}, Axes::body), inputs.add_force("tip", Axes::body),
                        inputs.add_wrench("tip", {}, Axes::body), inputs.add_wrench("tip", Axes::body)}) {
    CHECK(inputs.block(id).point == origin);
    CHECK(inputs.block(id).axes == Axes::body);
  }
  for (const auto id : {tasks.add_point("tip", {}, Axes::body), tasks.add_point("tip", Axes::body),
                        tasks.add_frame("tip", {}, Axes::body), tasks.add_frame("tip", Axes::body)}) {
    CHECK(tasks.block(id).point == origin);
    CHECK(tasks.block(id).axes == Axes::body);
  }
  CHECK(inputs.block(inputs.add_force("hand", {1, 0, -2})).point == Vec3(1, 0, -2));
  CHECK(inputs.block(inputs.add_force("hand", {})).point == Vec3::Zero());
  CHECK_THROWS_WITH(inputs.add_force("world"), "the world is no frame of the robot");
  const Eigen::VectorXd flat = Eigen::VectorXd::Ones(2), point = Eigen::VectorXd::Ones(3);
  CHECK_THROWS_WITH(inputs.add_force("hand", flat), "a point of a frame must have 3 coordinates, got 2");
  CHECK_THROWS_AS(tasks.add_point("hand", flat), ModelError);
  CHECK(inputs.block(inputs.add_force("hand", point)).point == Vec3::Ones());
}

TEST_CASE("a wrench is its force, and moments are pairs of forces", "[inputs]")
{
  const Tree tree = robot();
  Inputs inputs(tree, Start::empty);
  const Vec3 x(0.1, -0.2, 0.3);
  inputs.add_wrench("tip", x, Axes::body);                 // 0
  inputs.add_force("tip", x, Axes::body);                  // 6
  inputs.add_force("tip", x + Vec3::UnitX(), Axes::body);  // 9
  inputs.add_force("post");                                // 12
  inputs.add_motor("arm");                                 // 15
  Workspace ws(tree);
  ImplicitInversion method(tree, inputs);
  test::Random draw(2);
  for (int k = 0; k < 20; ++k) {
    const test::RandomState state = test::random_state(tree, inputs.columns(), draw);
    const auto result = method(forward_dynamics(state.q, state.qd, ws));
    REQUIRE(result.ok());
    const Eigen::MatrixXd B = result.Bhat;
    const double tolerance = 64 * eps * B.norm();
    CHECK((B.middleCols(6, 3) - B.middleCols(0, 3)).norm() < tolerance);
    // At a lever of one along x a force along y is a moment about z, and one along z a moment about −y.
    CHECK((B.col(10) - B.col(7) - B.col(5)).norm() < tolerance);
    CHECK((B.col(11) - B.col(8) + B.col(4)).norm() < tolerance);
    CHECK((B.col(9) - B.col(6)).norm() < tolerance);
    CHECK(B.middleCols(12, 3).isZero(0.0));  // the world holds the post
    CHECK(B.middleCols(0, 6).norm() > 0.01);
    CHECK(B.col(15).norm() > 0.01);
  }
}

TEST_CASE("a force through the centre of a free body moves it as Newton says", "[inputs]")
{
  test::Random draw(3);
  FloatingBase<double> stone{draw.body()};
  stone.body.mass = 4;
  StandardAssembly<double> assembly;
  assembly.add("stone", {}, stone);
  const Tree tree(assembly);
  Inputs inputs(tree);
  inputs.add_force("stone", stone.body.com, Axes::body);
  Workspace ws(tree);
  ImplicitInversion method(tree, inputs);
  const test::RandomState state = test::random_state(tree, 3, draw);
  const auto result = method(forward_dynamics(state.q, state.qd, ws));
  REQUIRE(result.ok());
  CHECK((result.Bhat.topRows(3) - Eigen::Matrix3d::Identity() / 4).norm() < 64 * eps);
  CHECK(result.Bhat.bottomRows(3).norm() < 64 * eps);
}

TEST_CASE("a method follows inputs that others are assigned to, however often either was switched", "[inputs]")
{
  const Tree tree = robot();
  test::Random draw(4);
  const test::RandomState state = test::random_state(tree, 0, draw);
  Workspace workspace(tree);
  const auto fd = forward_dynamics(state.q, state.qd, workspace);
  Inputs<Tree> inputs(tree);
  inputs.add_force("tip");
  const Inputs<Tree> all = inputs;
  inputs.set_active(0, false);
  Inputs<Tree> other = all;
  other.set_active(1, false);
  ImplicitInversion method(tree, inputs);
  const Eigen::MatrixXd without_first = method(fd).Bhat;
  CHECK(without_first.cols() == 4);
  inputs = other;
  const Eigen::MatrixXd without_second = method(fd).Bhat;
  inputs = all;
  const Eigen::MatrixXd Bhat = method(fd).Bhat;
  REQUIRE(Bhat.cols() == 5);
  CHECK((without_first - Bhat.rightCols(4)).norm() <= 64 * eps * Bhat.norm());
  CHECK((without_second.col(0) - Bhat.col(0)).norm() <= 64 * eps * Bhat.norm());
  CHECK((without_second.rightCols(3) - Bhat.rightCols(3)).norm() <= 64 * eps * Bhat.norm());
}

TEST_CASE("a part, and a frame, on a named frame", "[inputs]")
{
  test::Random draw(5);
  const Placement<double> wrist{draw.rotation(), draw.vector(1)}, tip{draw.rotation(), draw.vector(1)};
  const Placement<double> at{draw.rotation(), draw.vector(1)}, whole = wrist * tip * at;
  const RevoluteLink<double> arm{{draw.unit()}, draw.body()}, hand{{draw.unit()}, draw.body()};
  StandardAssembly<double> by_name, direct;
  by_name.add("hand", {"tip", at.R, at.p}, hand).add_frame("tip", {"wrist", tip.R, tip.p});
  by_name.add("arm", {"post"}, arm)
      .add_frame("wrist", {"arm", wrist.R, wrist.p})
      .add_frame("post", {"world", at.R, at.p});
  direct.add("arm", {"world", at.R, at.p}, arm).add("hand", {"arm", whole.R, whole.p}, hand);
  const Tree tree(by_name), expected(direct);
  REQUIRE(tree.size() == 2);
  CHECK(tree.node(1).parent == 0);
  CHECK(tree.placement(0).p == at.p);
  CHECK((tree.placement(1).p - whole.p).norm() < 4 * eps);
  CHECK((tree.placement(1).R - whole.R).norm() < 4 * eps);
  CHECK(tree.frame("tip").frame == tree.frame("arm").frame);
  CHECK((tree.frame("tip").at.p - (wrist * tip).p).norm() < 4 * eps);
  CHECK(tree.frame("post").frame == -1);
  const test::RandomState state = test::random_state(tree, 0, draw);
  Workspace ws(tree), expected_ws(expected);
  const auto fd = forward_dynamics(state.q, state.qd, ws),
             expected_fd = forward_dynamics(state.q, state.qd, expected_ws);
  REQUIRE(fd.ok());
  CHECK((fd.qdd0() - expected_fd.qdd0()).norm() < 256 * eps * expected_fd.qdd0().norm());
}

TEST_CASE("in neutral coordinates every part is in its reference position", "[inputs]")
{
  const Tree tree = robot();
  const Eigen::VectorXd q = neutral(tree);
  CHECK(q == (Eigen::VectorXd(9) << 0, 0, 0, 0, 0, 0, 1, 0, 0).finished());
  Workspace ws(tree);
  REQUIRE(forward_dynamics(q, Eigen::VectorXd::Zero(tree.n_v()), ws).ok());
  for (Index frame = 0; frame < tree.n_frames(); ++frame) { CHECK(ws.frame(frame).R == Eigen::Matrix3d::Identity()); }
}

TEST_CASE("of coordinates, only quaternions are made unit", "[inputs]")
{
  const Tree tree = robot();
  Eigen::VectorXd q(tree.n_q());
  q << 1, 2, 3, 0, 3, 0, 4, 5, 6;
  const Eigen::VectorXd expected = (Eigen::VectorXd(9) << 1, 2, 3, 0, 0.6, 0, 0.8, 5, 6).finished();
  normalize(tree, q);
  CHECK((q - expected).norm() < 4 * eps);
  Eigen::MatrixXd columns(tree.n_q(), 2);
  columns << q, 2 * expected;
  normalize(tree, columns.col(1));
  CHECK(columns(6, 1) == expected(6));
  CHECK(columns(7, 1) == 10);
}

TEST_CASE("the block of a motor, by name", "[inputs]")
{
  const Tree tree = robot();
  Inputs<Tree> inputs(tree);
  inputs.add_force("hand");
  CHECK(inputs.block(inputs.motor("arm")).name == "arm");
  CHECK(inputs.column(inputs.motor("hand")) == 1);
  CHECK_THROWS_AS(inputs.motor("base"), ModelError);  // has none
  CHECK_THROWS_AS(inputs.motor("tip"), ModelError);
}

TEST_CASE("what a status is about, in words", "[inputs]")
{
  const Tree tree = robot();
  const Inputs<Tree> inputs(tree);
  Workspace ws(tree);
  ImplicitInversion method(tree, inputs);
  Eigen::VectorXd q = neutral(tree);
  const Eigen::VectorXd qd = Eigen::VectorXd::Zero(tree.n_v());
  CHECK(describe(method(q, qd, ws), tree) == "ok");
  q(tree.node(tree.index("hand")).q) = std::numeric_limits<double>::infinity();
  const auto fd = forward_dynamics(q, qd, ws);
  CHECK(describe(fd, tree).find("invalid state (") == 0);
  CHECK(describe(fd, tree).find("): subsystem 'hand'") != std::string::npos);
  CHECK(describe(method(fd), tree) == describe(fd, tree));
  CHECK(describe(implicit_step(neutral(tree), qd, -1.0, ws), tree) ==
        "invalid state (a step's length negative or not finite)");
}

TEST_CASE("the same inputs on another tree are switched as these are")
{
  const StandardAssembly<double> assembly = models::chain<double>(3);
  const DynamicTree tree(assembly);
  const DynamicTree in_float(assembly.cast<float>());
  Inputs inputs(tree);
  inputs.set_active(1, false);
  const auto other = inputs.on(in_float);
  CHECK(other.columns() == 2);
  CHECK(other.column(1) == -1);
  CHECK(other.column(2) == 1);
}

}  // namespace test_inputs
