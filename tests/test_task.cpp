// PROGRAM: tests_several
// Task rows (3) on random robots: V̇_t = J_t B̂ u + V̇_t0 against accelerations of another pass, momentum balance,
// switching, bad names. What J_t and J̇_t q̇ are is held against kinematics in test_task_kinematics.cpp.
#include "catch.hpp"
#include "random_tree.hpp"

#include <iim/iim.hpp>
#include <iim/task.hpp>

#include <limits>

namespace test_task {

using namespace iim;
using namespace iim::test;
using Tree = DynamicTree<RevoluteLink<double>, MotorArm<double>, FloatingBase<double>, PrismaticLink<double>,
                         FixedLink<double>, LinearMotorArm<double>>;

namespace {

constexpr double eps = std::numeric_limits<double>::epsilon();

/// One task of every kind, points with and without a named frame, both choices of axes.
Tasks<Tree> some_tasks(const Tree& tree, const Inputs<Tree>& inputs, Random& random)
{
  Tasks<Tree> tasks(tree, inputs);
  const auto part = [&] { return tree.name(random.below(static_cast<int>(tree.size()))); };
  tasks.add_point(part(), random.vector(0.5));
  tasks.add_com();
  tasks.add_frame("f0");
  tasks.add_point("f0", random.vector(0.5), Axes::body);
  tasks.add_momentum();
  tasks.add_frame(part(), random.vector(0.5), Axes::body);
  return tasks;
}

}  // namespace

TEST_CASE("task accelerations are affine in the inputs", "[task]")
{
  for (std::uint64_t seed = 1; seed <= 300; ++seed) {
    CAPTURE(seed);
    RandomOptions options;
    options.most = 20;
    const RandomRobot robot = random_robot(seed, options);
    const Tree tree(robot.assembly);
    const Inputs<Tree> inputs = make_inputs(tree, robot.inputs);
    Random random(seed + 1000);
    const RandomState state = random_state(tree, inputs.columns(), random);
    Tasks<Tree> tasks = some_tasks(tree, inputs, random);
    Workspace ws(tree);
    ImplicitInversion<Tree> method(tree, inputs);

    const auto fd = forward_dynamics(state.q, state.qd, ws);
    const AffineDynamics<double> affine = method(fd);
    REQUIRE(affine.ok());
    const TaskRows<double> rows = tasks(fd, affine);
    REQUIRE(rows.ok());
    REQUIRE(rows.J.rows() == 27);
    REQUIRE(rows.JB.cols() == inputs.columns());

    const double n = static_cast<double>(tree.n_v()) + 1;
    // Each entry is a sum of n products; the scale is that of the sum's terms.
    const Eigen::MatrixXd JB = rows.J * affine.Bhat;
    const Eigen::MatrixXd JB_scale = rows.J.cwiseAbs() * affine.Bhat.cwiseAbs();
    for (Index j = 0; j < JB.cols(); ++j) {
      for (Index i = 0; i < JB.rows(); ++i) {
        REQUIRE(std::abs(rows.JB(i, j) - JB(i, j)) <= 4 * n * eps * JB_scale(i, j));
      }
    }

    // V̇_t0 of points comes out of the pass, by sums along the path with terms of the path's size.
    const Eigen::VectorXd Vdot0 = rows.J * affine.qdd0 + rows.Jdot_qd;
    const double scale0 = (rows.J.cwiseAbs() * affine.qdd0.cwiseAbs() + rows.Jdot_qd.cwiseAbs()).maxCoeff() + n * 10;
    REQUIRE((rows.Vdot0 - Vdot0).cwiseAbs().maxCoeff() <= 40 * n * eps * scale0);

    // q̈ under u by a pass of its own. Masses and gears differ by 10², so two ways to q̈ agree to that many digits less.
    Workspace other(tree);
    const auto acceleration = forward_dynamics(state.q, state.qd, inputs, state.u, other);
    REQUIRE(acceleration.status == Status::ok);
    const Eigen::VectorXd with_u = rows.J * acceleration.qdd + rows.Jdot_qd;
    const double scale = rows.J.norm() * ((affine.Bhat.cwiseAbs() * state.u.cwiseAbs()).norm() + affine.qdd0.norm()) +
                         rows.Jdot_qd.norm();
    REQUIRE((rows.JB * state.u + rows.Vdot0 - with_u).norm() <= 1e4 * n * eps * scale);
  }
}

TEST_CASE("momentum of a robot in the air changes by gravity and external wrenches alone", "[task]")
{
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    CAPTURE(seed);
    RandomOptions options;
    options.root = 0.1;
    options.floating_root = 1;
    const RandomRobot robot = random_robot(seed, options);
    const Tree tree(robot.assembly);
    const Inputs<Tree> inputs = make_inputs(tree, robot.inputs);
    Random random(seed + 2000);
    const RandomState state = random_state(tree, inputs.columns(), random);
    Tasks<Tree> tasks(tree, inputs);
    const Index com = tasks.add_com();
    tasks.add_momentum();
    Workspace ws(tree);
    ImplicitInversion<Tree> method(tree, inputs);
    const auto fd = forward_dynamics(state.q, state.qd, ws);
    const AffineDynamics<double> affine = method(fd);
    const TaskRows<double> rows = tasks(fd, affine);
    REQUIRE(rows.ok());
    const Vec3 centre = tasks.placement(com).p;

    // Where frames are in the world: by tasks at points, whose positions test_task_kinematics.cpp checks.
    Tasks<Tree> contacts(tree, inputs);
    std::vector<Index> contact_of(static_cast<std::size_t>(inputs.blocks()), -1);
    for (Index id = 0; id < inputs.blocks(); ++id) {
      const NamedInput& named = robot.inputs[static_cast<std::size_t>(id)];
      if (named.kind != InputKind::motor) {
        contact_of[static_cast<std::size_t>(id)] = contacts.add_frame(named.name, named.point);
      }
    }
    REQUIRE(contacts(fd).ok());

    Vector6<double> wrench = Vector6<double>::Zero();
    wrench.head<3>() = tasks.mass() * tree.gravity();
    double scale = wrench.norm();
    for (Index id = 0; id < inputs.blocks(); ++id) {
      const Input<double>& input = inputs.block(id);
      if (!input.active || input.kind == InputKind::motor) { continue; }
      const Placement<double>& at = contacts.placement(contact_of[static_cast<std::size_t>(id)]);
      const Mat3 axes = input.axes == Axes::body ? at.R : Mat3(Mat3::Identity());
      const Vec3 force = axes * state.u.segment<3>(inputs.column(id));
      wrench.head<3>() += force;
      wrench.tail<3>() += (at.p - centre).cross(force);
      if (input.kind == InputKind::wrench) { wrench.tail<3>() += axes * state.u.segment<3>(inputs.column(id) + 3); }
      scale += force.norm() * (1 + (at.p - centre).norm()) + 2;
    }
    // q̈ multiplies A_G; what the balance cancels is of that size.
    const Eigen::VectorXd qdd = affine.qdd0.cwiseAbs() + affine.Bhat.cwiseAbs() * state.u.cwiseAbs();
    scale += (rows.J.bottomRows(6).cwiseAbs() * qdd + rows.Jdot_qd.tail(6).cwiseAbs()).norm();
    const double n = static_cast<double>(tree.n_v());
    const Vector6<double> rate = rows.JB.bottomRows(6) * state.u + rows.Vdot0.tail(6);
    REQUIRE((rate - wrench).norm() <= 100 * n * eps * scale);
    const Vec3 com_rate = tasks.mass() * (rows.JB.topRows(3) * state.u + rows.Vdot0.head(3));
    REQUIRE((com_rate - wrench.head<3>()).norm() <= 100 * n * eps * scale);
  }
}

TEST_CASE("tasks are switched on and off, and a bad state leaves no numbers behind", "[task]")
{
  const RandomRobot robot = random_robot(7, {.fewest = 8, .most = 8});
  const Tree tree(robot.assembly);
  const Inputs<Tree> inputs = make_inputs(tree, robot.inputs);
  Random random(8);
  RandomState state = random_state(tree, inputs.columns(), random);
  Tasks<Tree> tasks = some_tasks(tree, inputs, random);
  Workspace ws(tree);
  ImplicitInversion<Tree> method(tree, inputs);

  const auto fd = forward_dynamics(state.q, state.qd, ws);
  const TaskRows<double> all = tasks(fd, method(fd));
  REQUIRE(all.ok());
  const Eigen::MatrixXd J = all.J, JB = all.JB;
  const Eigen::VectorXd Jdot_qd = all.Jdot_qd, Vdot0 = all.Vdot0;

  for (int mask = 0; mask < 64; ++mask) {
    std::vector<Index> first;
    Index row = 0;
    for (Index id = 0; id < 6; ++id) {
      first.push_back(row);
      row += tasks.block(id).size;
      tasks.set_active(id, (mask >> id & 1) != 0);
    }
    const auto again = forward_dynamics(state.q, state.qd, ws);
    const TaskRows<double> rows = tasks(again, method(again));
    REQUIRE(rows.ok());
    REQUIRE(rows.J.rows() == tasks.rows());
    for (Index id = 0; id < 6; ++id) {
      CAPTURE(mask, id);
      const Index at = tasks.row(id), from = first[static_cast<std::size_t>(id)], size = tasks.block(id).size;
      REQUIRE((at >= 0) == tasks.block(id).active);
      if (at < 0) { continue; }
      // The same operations in another place: the same bits, except that a compiler may fuse the product differently.
      REQUIRE(rows.J.middleRows(at, size) == J.middleRows(from, size));
      REQUIRE(rows.Jdot_qd.segment(at, size) == Jdot_qd.segment(from, size));
      REQUIRE(rows.Vdot0.segment(at, size) == Vdot0.segment(from, size));
      REQUIRE((rows.JB.middleRows(at, size) - JB.middleRows(from, size)).norm() <= 8 * eps * JB.norm());
    }
    // Without B̂: the same but for JB.
    const TaskRows<double> alone = tasks(again);
    REQUIRE(alone.JB.cols() == 0);
    REQUIRE(alone.J.rows() == tasks.rows());
  }

  for (Index id = 0; id < 6; ++id) { tasks.set_active(id, true); }
  const Eigen::VectorXd good = state.q;
  state.q(0) = std::numeric_limits<double>::quiet_NaN();
  const auto bad = forward_dynamics(state.q, state.qd, ws);
  const TaskRows<double> rows = tasks(bad, method(bad));
  REQUIRE(rows.status == Status::invalid_state);
  REQUIRE(rows.subsystem == bad.subsystem());
  REQUIRE((rows.J.array().isNaN().all() && rows.JB.array().isNaN().all() && rows.Vdot0.array().isNaN().all() &&
           rows.Jdot_qd.array().isNaN().all()));
  const auto recovered = forward_dynamics(good, state.qd, ws);
  const TaskRows<double> after = tasks(recovered, method(recovered));
  REQUIRE(after.ok());
  REQUIRE(after.J == J);
  REQUIRE(after.JB == JB);
  REQUIRE(after.Vdot0 == Vdot0);
  for (Index id = 0; id < 6; ++id) {
    REQUIRE(tasks.placement(id).p.allFinite());
    REQUIRE(tasks.placement(id).R.allFinite());
  }
}

TEST_CASE("tasks say what is wrong with them", "[task]")
{
  using Catch::Matchers::ContainsSubstring;
  StandardAssembly<double> assembly;
  RevoluteLink<double> link;
  link.body.mass = 1;
  link.body.com = {0.5, 0, 0};
  assembly.add("arm", {}, link);
  assembly.add_frame("hand", {"arm", Mat3::Identity(), {1, 0, 0}});
  assembly.add_frame("table", {"world", Mat3::Identity(), {1, 0, 0}});
  const Tree tree(assembly);
  const Inputs<Tree> inputs(tree);
  Tasks<Tree> tasks(tree, inputs);
  REQUIRE_THROWS_AS(tasks.add_point("foot"), ModelError);
  REQUIRE_THROWS_WITH(tasks.add_point("foot"), ContainsSubstring("'foot'"));
  REQUIRE_THROWS_WITH(tasks.add_frame("table"), ContainsSubstring("'table'"));
  REQUIRE_THROWS_WITH(tasks.add_point("hand", {0, std::numeric_limits<double>::infinity(), 0}),
                      ContainsSubstring("'hand'") && ContainsSubstring("inf"));
  REQUIRE(tasks.blocks() == 0);
  Workspace<Tree> ws(tree);
  const Eigen::VectorXd q = neutral(tree), qd = Eigen::VectorXd::Ones(1);
  const auto no_rows = tasks(forward_dynamics(q, qd, ws));
  REQUIRE(no_rows.ok());
  REQUIRE((no_rows.J * qd).size() == 0);
  REQUIRE(tasks.add_point("hand") == 0);

  StandardAssembly<double> empty;
  RevoluteLink<double> nothing;
  nothing.body = Body<double>::massless();
  empty.add("nothing", {}, nothing);
  const Tree massless(empty);
  const Inputs<Tree> no_inputs(massless);
  Tasks<Tree> none(massless, no_inputs);
  REQUIRE_THROWS_WITH(none.add_com(), ContainsSubstring("centre of mass"));
  REQUIRE_THROWS_WITH(none.add_momentum(), ContainsSubstring("momentum"));
}

TEST_CASE("an acceleration of a point that overflows is a status", "[task]")
{
  StandardAssembly<double> assembly;
  RevoluteLink<double> link{{Vec3::UnitY()}, {1, {0.5, 0, 0}, Vec3(0.1, 0.1, 0.1).asDiagonal(), false}};
  assembly.add("link", {}, link);
  assembly.set_gravity({0, 0, -1e200});
  const Tree tree(assembly);
  const Inputs<Tree> inputs(tree);
  Tasks<Tree> tasks(tree, inputs);
  const Index far = tasks.add_point("link", {1e120, 0, 0});
  Workspace ws(tree);
  const Eigen::VectorXd zero = Eigen::VectorXd::Zero(1);
  const auto fd = forward_dynamics(zero, zero, ws);
  REQUIRE(fd.ok());
  const TaskRows<double> rows = tasks(fd);
  CHECK(rows.status == Status::not_finite);  // J and J̇q̇ are finite
  CHECK(rows.J.array().isNaN().all());
  CHECK(rows.Vdot0.array().isNaN().all());
  CHECK(tasks.placement(far).p.array().isNaN().all());
}

}  // namespace test_task
