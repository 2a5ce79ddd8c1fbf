// FLAGS: -DNDEBUG
// What does not belong together is a status or a ModelError, never a number, where assertions are off.
#include "catch.hpp"
#include "random_tree.hpp"

#include <iim/equations_of_motion.hpp>
#include <iim/global_inverse.hpp>
#include <iim/iim.hpp>
#include <iim/recursive_inverse.hpp>
#include <iim/several_states.hpp>
#include <iim/subsystem/compound.hpp>
#include <iim/task.hpp>
#include <iim/unit_force.hpp>

#include <limits>
#include <string>
#include <utility>
#include <vector>

#ifndef NDEBUG
#error "this test is about programs without assertions"
#endif

namespace test_mismatch {

using namespace iim;

namespace {

using Parts = Assembly<RevoluteLink<double>>;  // one type: this file is compiled by itself
using Tree = Parts::Tree;

Parts chain(int links)
{
  Parts assembly;
  Attachment<double> on;
  for (int k = 0; k < links; ++k) {
    const std::string name = "link" + std::to_string(k);
    assembly.add(name, on,
                 RevoluteLink<double>{{Vector3<double>::UnitY()},
                                      {1, {0, 0, -0.5}, Vector3<double>(0.1, 0.1, 0.01).asDiagonal()}});
    on = {name, Matrix3<double>::Identity(), {0, 0, -1}};
  }
  return assembly;
}

Parts robot(double mass, int links = 3)
{
  Parts assembly = chain(links);
  RevoluteLink<double> hand{{Vector3<double>::UnitX()}, {}};
  hand.body.mass = mass;
  hand.body.com = {0, 0, 0.1};
  assembly.add("hand", {"link" + std::to_string(links - 1)}, hand);
  return assembly;
}

/// Tree, inputs, workspace and a state.
struct Robot {
  Tree tree;
  Inputs<Tree> inputs{tree};
  Workspace<Tree> ws{tree};
  test::RandomState state;

  explicit Robot(const Tree& t) : tree(t)
  {
    test::Random random(3);
    inputs.add_force("hand");
    state = test::random_state(tree, inputs.columns(), random);
  }
  Robot(const Robot&) = delete;

  auto pass() { return forward_dynamics(state.q, state.qd, ws); }
  auto implicit() { return implicit_step(state.q, state.qd, 1e-3, ws); }
};

template <class Result>
bool is_mismatch(const Result& result)
{
  return result.status == Status::mismatch && result.subsystem == -1 && !result.ok();
}

template <class Result>
bool is_nan(const Result& result)
{
  return result.qdd0.array().isNaN().all() && result.Bhat.array().isNaN().all();
}

/// f(method made from inputs of the robot) for each of them.
template <class F>
void for_each_method(Robot& robot, F&& f)
{
  ImplicitInversion product(robot.tree, robot.inputs);
  UnitForce unit_force(robot.tree, robot.inputs);
  RecursiveInverse recursive(robot.tree, robot.inputs);
  GlobalInverse<Tree> global(robot.tree, robot.inputs);
  GlobalInverse<Tree, Factorization::dense> dense(robot.tree, robot.inputs);
  f(product);
  f(unit_force);
  f(recursive);
  f(global);
  f(dense);
}

}  // namespace

TEST_CASE("M⁻¹ of a state without a result is NaN, and that of the next is not")
{
  Parts assembly = robot(1);
  assembly.add("beside", {}, RevoluteLink<double>{{}, {1, Vector3<double>::UnitX(), Matrix3<double>::Identity()}});
  Robot a{Tree(assembly)};
  RecursiveInverse recursive(a.tree, a.inputs);
  CHECK(recursive(a.pass()).ok());
  const Eigen::MatrixXd before = recursive.Minv();
  CHECK(before.allFinite());
  CHECK(!recursive(forward_dynamics(a.state.q.head(1), a.state.qd, a.ws)).ok());
  CHECK(recursive.Minv().array().isNaN().all());
  CHECK(recursive(a.pass()).ok());
  CHECK(recursive.Minv() == before);
}

TEST_CASE("a receipt of another robot, or from before the workspace's last use")
{
  Robot a{Tree(robot(1))}, b{Tree(robot(2))};
  Robot copy{a.tree};
  CHECK(a.tree.id() == copy.tree.id());
  CHECK(a.tree.id() != b.tree.id());
  for_each_method(a, [&](auto& method) {
    CHECK(method(a.pass()).ok());
    CHECK(method(copy.pass()).ok());
    const auto other = method(b.pass());
    CHECK(is_mismatch(other));
    CHECK(is_nan(other));
    const auto receipt = a.pass();
    CHECK(method(receipt).ok());
    static_cast<void>(a.pass());
    CHECK(is_mismatch(method(receipt)));
    VectorX<double> q = a.state.q;
    q(1) = std::numeric_limits<double>::quiet_NaN();
    const auto failed = forward_dynamics(q, a.state.qd, a.ws);
    CHECK(method(failed).subsystem == 1);
    static_cast<void>(a.pass());
    CHECK(is_mismatch(method(failed)));
  });
  ImplicitInversion method(a.tree, a.inputs);
  CHECK(is_mismatch(method(b.state.q, b.state.qd, b.ws)));
  CHECK(method(a.state.q, a.state.qd, a.ws).ok());
  GlobalInverse global(a.tree, a.inputs);
  CHECK(is_mismatch(global(b.state.q, b.state.qd, b.ws)));
  UnitForcePublished published(a.tree, a.inputs);
  CHECK(published(a.pass(), a.state.q, a.state.qd).ok());
  CHECK(is_mismatch(published(b.pass(), a.state.q, a.state.qd)));
  Tasks tasks(a.tree, a.inputs);
  tasks.add_point("hand");
  CHECK(tasks(a.pass()).ok());
  CHECK(is_mismatch(tasks(b.pass())));
  CHECK(is_mismatch(tasks(b.pass(), method(a.pass()))));
  CHECK(is_mismatch(forward_dynamics(b.state.q, b.state.qd, a.inputs, b.state.u, b.ws)));
}

TEST_CASE("a receipt from before the workspace was assigned, or moved from")
{
  Robot a{Tree(robot(1))};
  Workspace<Tree> other(a.tree);
  ImplicitInversion method(a.tree, a.inputs);
  const auto receipt = a.pass();
  static_cast<void>(forward_dynamics(a.state.q, a.state.qd, other));
  CHECK(other.uses() == a.ws.uses());
  a.ws = other;
  CHECK(is_mismatch(method(receipt)));
  const auto of_other = forward_dynamics(a.state.q, a.state.qd, other);
  a.ws = std::move(other);
  CHECK(is_mismatch(method(of_other)));
  CHECK(method(a.pass()).ok());
}

TEST_CASE("a receipt of another Scene, for a method that computes terms of it")
{
  Robot a{Tree(robot(1))};
  constexpr Scene in_step{.implicit = true};
  CHECK(ImplicitInversion(a.tree, a.inputs).product_from() >= 0);
  ImplicitInversion method(a.tree, a.inputs);
  CHECK(method(a.implicit()).ok());  // takes what the pass has left
  GlobalInverse<Tree> global(a.tree, a.inputs);
  GlobalInverse<Tree, Factorization::branch_sparse, in_step> global_in_step(a.tree, a.inputs);
  CHECK(is_mismatch(global(a.implicit())));
  CHECK(global_in_step(a.implicit()).ok());
  CHECK(is_mismatch(global_in_step(a.pass())));
  EquationsOfMotion<Tree> equations(a.tree, a.inputs);
  EquationsOfMotion<Tree, in_step> equations_in_step(a.tree, a.inputs);
  CHECK(is_mismatch(equations(a.implicit())));
  CHECK(equations(a.pass()).ok());
  CHECK(equations_in_step(a.implicit()).ok());
  UnitForcePublished<Tree> published(a.tree, a.inputs);
  CHECK(is_mismatch(published(a.implicit(), a.state.q, a.state.qd)));
  Tasks<Tree> tasks(a.tree, a.inputs);
  Tasks<Tree, in_step> tasks_in_step(a.tree, a.inputs);
  tasks.add_point("hand");
  tasks_in_step.add_point("hand");
  CHECK(is_mismatch(tasks(a.implicit())));
  const auto fd = a.implicit();
  CHECK(is_mismatch(tasks(fd, method(fd))));
  CHECK(tasks_in_step(fd, method(fd)).ok());
  // Each of the three parts of a scene counts.
  constexpr Scene weightless{.gravity = false}, at_rest{.velocity = false};
  Tasks<Tree, weightless> tasks_without_weight(a.tree, a.inputs);
  Tasks<Tree, at_rest> tasks_at_rest(a.tree, a.inputs);
  tasks_without_weight.add_point("hand");
  tasks_at_rest.add_point("hand");
  CHECK(is_mismatch(tasks_without_weight(a.pass())));
  CHECK(is_mismatch(tasks_at_rest(a.pass())));
  CHECK(tasks_without_weight(forward_dynamics<weightless>(a.state.q, a.state.qd, a.ws)).ok());
  CHECK(is_mismatch(tasks_without_weight(forward_dynamics<at_rest>(a.state.q, a.state.qd, a.ws))));
  CHECK(tasks_at_rest(forward_dynamics<at_rest>(a.state.q, a.state.qd, a.ws)).ok());
}

TEST_CASE("sizes of q, q̇ and u")
{
  Robot a{Tree(robot(1))};
  ImplicitInversion method(a.tree, a.inputs);
  const Eigen::VectorXd short_q = a.state.q.head(2), long_u = Eigen::VectorXd::Zero(99);
  for (int k = 0; k < 2; ++k) {  // of a workspace that holds nothing, and of one that holds a pass
    const auto fd = forward_dynamics(short_q, a.state.qd, a.ws);
    CHECK(fd.status() == Status::mismatch);
    CHECK(fd.qdd0().array().isNaN().all());
    CHECK(is_mismatch(method(fd)));
    CHECK(forward_dynamics(a.state.q, short_q, a.ws).status() == Status::mismatch);
    CHECK(is_mismatch(method(short_q, a.state.qd, a.ws)));
    const auto result = forward_dynamics(a.state.q, a.state.qd, a.inputs, long_u, a.ws);
    CHECK(is_mismatch(result));
    CHECK(result.qdd.array().isNaN().all());
    GlobalInverse global(a.tree, a.inputs);
    CHECK(is_mismatch(global(short_q, a.state.qd, a.ws)));
    constexpr Scene at_rest{.velocity = false};
    CHECK(forward_dynamics<at_rest>(a.state.q, short_q, a.ws).ok());  // q̇ is not read
    CHECK(a.pass().ok());
  }
}

TEST_CASE("a failed pass leaves no number")
{
  Robot a{Tree(robot(1))};
  Eigen::VectorXd q = a.state.q;
  q(1) = std::numeric_limits<double>::infinity();
  const auto fd = forward_dynamics(q, a.state.qd, a.ws);
  CHECK(fd.status() == Status::invalid_state);
  CHECK(fd.qdd0().array().isNaN().all());
  const auto result = forward_dynamics(q, a.state.qd, a.inputs, a.state.u, a.ws);
  CHECK(!result.ok());
  CHECK(result.qdd.array().isNaN().all());
  CHECK(forward_dynamics(a.state.q, a.state.qd, a.inputs, a.state.u, a.ws).ok());
}

TEST_CASE("inputs of another robot, and inputs that were added too late")
{
  Robot a{Tree(robot(1))}, b{Tree(robot(2))};
  CHECK_THROWS_AS(ImplicitInversion(a.tree, b.inputs), ModelError);
  CHECK_THROWS_AS(UnitForce(a.tree, b.inputs), ModelError);
  CHECK_THROWS_AS(UnitForcePublished(a.tree, b.inputs), ModelError);
  CHECK_THROWS_AS(RecursiveInverse(a.tree, b.inputs), ModelError);
  CHECK_THROWS_AS(GlobalInverse(a.tree, b.inputs), ModelError);
  CHECK_THROWS_AS(EquationsOfMotion(a.tree, b.inputs), ModelError);
  CHECK_THROWS_AS(Tasks(a.tree, b.inputs), ModelError);
  Robot larger{Tree(robot(1, 40))};
  CHECK_THROWS_AS(ImplicitInversion(a.tree, larger.inputs), ModelError);
  CHECK_THROWS_AS(UnitForce(a.tree, larger.inputs), ModelError);
  CHECK_THROWS_AS(RecursiveInverse(a.tree, larger.inputs), ModelError);
  CHECK_THROWS_AS(GlobalInverse(a.tree, larger.inputs), ModelError);
  CHECK_THROWS_AS(EquationsOfMotion(a.tree, larger.inputs), ModelError);
  ImplicitInversion before(a.tree, a.inputs);
  EquationsOfMotion equations(a.tree, a.inputs);
  Tasks tasks(a.tree, a.inputs);
  tasks.add_point("hand");
  const Index columns = a.inputs.columns();
  for_each_method(a, [&](auto& method) {
    a.inputs.add_wrench("hand");
    const auto late = method(a.pass());
    CHECK(is_mismatch(late));
    CHECK(late.Bhat.cols() == columns);
    CHECK(is_mismatch(before(a.state.q, a.state.qd, a.ws)));
    CHECK(is_mismatch(equations(a.state.q, a.state.qd, a.ws)));
  });
  ImplicitInversion after(a.tree, a.inputs);
  const auto fd = a.pass();
  CHECK(after(fd).ok());
  CHECK(is_mismatch(tasks(fd, after(fd))));
}

TEST_CASE("inputs that others are assigned to")
{
  Robot a{Tree(robot(1))}, b{Tree(robot(2))};
  Inputs<Tree> wrist(a.tree, Start::empty), hand(a.tree, Start::empty);
  wrist.add_motor("link1");
  hand.add_motor("hand");
  REQUIRE(wrist.max_columns() == hand.max_columns());
  Inputs<Tree> inputs = wrist;
  ImplicitInversion method(a.tree, inputs);
  CHECK(method(a.pass()).ok());
  inputs = hand;
  CHECK(is_mismatch(method(a.pass())));
  CHECK(is_mismatch(method(a.state.q, a.state.qd, a.ws)));
  inputs = wrist;
  CHECK(method(a.pass()).ok());
  Inputs<Tree> theirs(b.tree, Start::empty);
  theirs.add_motor("link1");
  inputs = theirs;
  CHECK(is_mismatch(method(b.pass())));
  CHECK(is_mismatch(method(b.state.q, b.state.qd, b.ws)));
}

TEST_CASE("several states: sizes of q, q̇ and u, and inputs that were added too late")
{
  Robot a{Tree(robot(1))};
  SeveralStates several(robot(1), a.inputs);
  constexpr Index count = 11;
  const Index n = a.tree.n_v(), m = a.inputs.columns();
  const Eigen::MatrixXd q = a.state.q.replicate(1, count), qd = a.state.qd.replicate(1, count),
                        u = a.state.u.replicate(1, count);
  std::vector<Outcome> outcomes(count);
  Eigen::MatrixXd qdd(n, count), Bhat(n * m, count);
  const auto refused = [&](const Eigen::MatrixXd& q_k, const Eigen::MatrixXd& qd_k) {
    CHECK(several.evaluate(q_k, qd_k, qdd, Bhat, outcomes) == count);
    CHECK(outcomes == std::vector<Outcome>(count, {Status::mismatch, -1}));
    CHECK(qdd.array().isNaN().all());
    CHECK(Bhat.array().isNaN().all());
    Index seen = 0;
    several.for_each(q_k, qd_k, [&](Index, const auto& dynamics) {
      ++seen;
      CHECK(is_mismatch(dynamics));
      CHECK(is_nan(dynamics));
    });
    CHECK(seen == count);
    CHECK(several.accelerations(q_k, qd_k, u, qdd, outcomes) == count);
    CHECK(qdd.array().isNaN().all());
  };
  REQUIRE(several.evaluate(q, qd, qdd, Bhat, outcomes) == 0);
  refused(Eigen::MatrixXd::Zero(a.tree.n_q() + 99, count), qd);
  refused(q.topRows(1), qd);
  refused(q, qd.topRows(1));
  refused(q, qd.leftCols(1));
  CHECK(several.accelerations(q, qd, Eigen::MatrixXd::Zero(m + 99, count), qdd, outcomes) == count);
  CHECK(several.accelerations(q, qd, u.leftCols(1), qdd, outcomes) == count);
  CHECK(outcomes == std::vector<Outcome>(count, {Status::mismatch, -1}));

  // Nothing is written beyond what is too small.
  Eigen::MatrixXd few(n, count - 1), narrow(n * (m - 3), count);
  std::vector<Outcome> some(count - 1);
  CHECK(several.evaluate(q, qd, few, Bhat, outcomes) == count);
  CHECK(several.evaluate(q, qd, qdd, narrow, outcomes) == count);
  CHECK(several.evaluate(q, qd, qdd, Bhat, some) == count);
  CHECK(several.accelerations(q, qd, u, few, outcomes) == count);
  CHECK(several.accelerations(q, qd, u, qdd, some) == count);
  CHECK(few.array().isNaN().all());
  CHECK(narrow.array().isNaN().all());
  CHECK(some == std::vector<Outcome>(count - 1, {Status::mismatch, -1}));
  CHECK(several.accelerations(q, qd, u, qdd, outcomes) == 0);
  REQUIRE(several.evaluate(q, qd, qdd, Bhat, outcomes) == 0);
  a.inputs.add_wrench("hand");
  refused(q, qd);
}

TEST_CASE("tasks of one robot, and another's B̂")
{
  Robot a{Tree(robot(1))};
  Tasks tasks(a.tree, a.inputs), none(a.tree, a.inputs);
  tasks.add_point("hand");
  const auto fd = a.pass();
  ImplicitInversion method(a.tree, a.inputs);
  const auto dynamics = method(fd);
  CHECK(tasks(fd, dynamics).ok());
  CHECK(none(fd, dynamics).ok());
  const auto at_once = method(a.state.q, a.state.qd, a.ws);
  CHECK(tasks(at_once).ok());
  CHECK(tasks(at_once).JB == tasks(at_once.fd, at_once).JB);
  tasks.set_active(7, false);  // none of its blocks
  CHECK(tasks.rows() == 3);
  const Tree small(chain(2));
  const Inputs<Tree> inputs(small);
  Workspace<Tree> ws(small);
  ImplicitInversion other(small, inputs);
  const Eigen::VectorXd q = Eigen::VectorXd::Ones(2);
  const auto theirs = other(q, q, ws);
  REQUIRE(theirs.ok());
  CHECK(tasks.placement(0).p.allFinite());
  CHECK(is_mismatch(tasks(at_once.fd, theirs)));
  CHECK(tasks.placement(0).p.array().isNaN().all());
}

TEST_CASE("several states of an assembly with frames on frames, which are multiplied out")
{
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    test::Random random(seed);
    Parts assembly = robot(1);
    assembly.add_frame("mount", {"hand", random.rotation(), random.vector(0.5)});
    assembly.add_frame("flange", {"mount", random.rotation(), random.vector(0.5)});
    assembly.add("tool", {"flange", random.rotation(), random.vector(0.5)},
                 RevoluteLink<double>{{random.unit()}, random.body()});
    const DynamicTree tree(assembly);
    const Inputs inputs(tree);
    SeveralStates several(assembly, inputs);
    const MatrixX<double> q = MatrixX<double>::Random(tree.n_q(), 3);
    MatrixX<double> qdd0(tree.n_v(), 3), Bhat(tree.n_v() * inputs.columns(), 3);
    std::vector<Outcome> outcomes(3);
    // Without velocity q̇ is not read.
    CHECK(several.evaluate<Scene{.velocity = false}>(q, MatrixX<double>(), qdd0, Bhat, outcomes) == 0);
    CHECK(several.evaluate(q, MatrixX<double>(), qdd0, Bhat, outcomes) == 3);
  }
}

TEST_CASE("several states of another assembly")
{
  Robot a{Tree(robot(1))};
  Parts on_the_moon = robot(1);
  on_the_moon.set_gravity({0, 0, -1.6});
  CHECK_THROWS_WITH(SeveralStates(on_the_moon, a.inputs), Catch::Matchers::ContainsSubstring("gravity"));
  CHECK_NOTHROW(SeveralStates(robot(1), a.inputs));
  CHECK_THROWS_WITH(SeveralStates(robot(2), a.inputs), Catch::Matchers::ContainsSubstring("'hand'"));
  CHECK_THROWS_AS(SeveralStates(chain(3), a.inputs), ModelError);
}

TEST_CASE("several states of an assembly with another name, place, or body on an inlet or a second frame")
{
  using Drive = MotorArm<double>;
  using Head = PanTilt<double>;
  struct Machine {
    std::string name = "head";
    Matrix3<double> R = Matrix3<double>::Identity();
    double at = 0.3, rotor = 0.2, tilted = 0.5;

    Assembly<Drive, Head> assembly() const
    {
      const Body<double> body{1, {0, 0, 0.1}, Vector3<double>(0.1, 0.1, 0.01).asDiagonal(), false};
      Assembly<Drive, Head> parts;
      Motor<double> motor{10, 1e-4};
      motor.mass = rotor;
      motor.transverse_inertia = 1e-4;
      parts.add("turret", {}, Drive{{}, body, motor});
      Head head;
      head.mechanism.axis[1] = Vector3<double>::UnitY();
      head.body = {body, body};
      head.body[1].mass = tilted;
      parts.add(name, {"turret", R, {at, 0, 0}}, head);
      return parts;
    }
  };
  const Machine machine;
  const DynamicTree tree(machine.assembly());
  const Inputs inputs(tree);
  CHECK_NOTHROW(SeveralStates(machine.assembly(), inputs));
  const auto is_refused = [&](auto change) {
    Machine other = machine;
    change(other);
    CHECK_THROWS_WITH(SeveralStates(other.assembly(), inputs),
                      Catch::Matchers::ContainsSubstring("another name, place or body"));
  };
  is_refused([](Machine& other) { other.name = "tail"; });
  is_refused([](Machine& other) { other.R = Eigen::AngleAxisd(1e-6, Vector3<double>::UnitX()).toRotationMatrix(); });
  is_refused([](Machine& other) { other.at += 1e-6; });
  is_refused([](Machine& other) { other.rotor += 1e-6; });
  is_refused([](Machine& other) { other.tilted += 1e-6; });
}

}  // namespace test_mismatch
