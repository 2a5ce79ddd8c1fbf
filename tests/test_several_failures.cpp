// PROGRAM: tests_several
// Several states at once: a state without a result has the status and the subsystem of the single-state path, and the
// states beside it in its pack are what they would be without it. Contacts that come and go. No heap in the cycle.
#include "cycle.hpp"
#include "several_states.hpp"

#include <limits>
#include <type_traits>

namespace test_several_failures {

using namespace iim;

namespace {

using T = double;
using test::States;
using Tree = test::Tree<T>;
using Several = SeveralStates<Tree>;
constexpr T NaN = std::numeric_limits<T>::quiet_NaN();

/// The robot with a point on its finger and on its feet.
struct Robot {
  StandardAssembly<T> assembly = test::robot();
  Tree tree{assembly};
  Inputs<Tree> inputs = test::robot_inputs(tree);
  Several several{assembly, inputs};
  test::Random draw{7};
};

constexpr Index many = 3 * Several::lanes + 1;

}  // namespace

TEST_CASE("one bad state in a pack: its status is exact, the others do not notice", "[several]")
{
  Robot robot;
  const States<T> good(robot.tree, robot.inputs.columns(), many, robot.draw);
  const Index n = robot.tree.n_v();
  MatrixX<T> qdd0(n, many), Bhat(n * robot.inputs.columns(), many), qdd(n, many);
  std::vector<Outcome> outcomes(many), with_u(many);
  REQUIRE(robot.several.evaluate(good.q, good.qd, qdd0, Bhat, outcomes) == 0);
  test::check_agreement(robot.inputs, robot.several, good, test::limit);

  const Index last = robot.tree.n_q() - 1;
  for (const Index at : {Index(0), Index(1), Index(Several::lanes), many - 2, many - 1}) {
    INFO("state " << at);
    for (int what = 0; what < 6; ++what) {
      INFO("kind of damage " << what);
      States<T> bad = good;
      switch (what) {
        case 0: bad.q(last, at) = NaN; break;
        case 1: bad.qd(n - 1, at) = std::numeric_limits<T>::infinity(); break;
        case 2: bad.q.col(at).segment<4>(3) *= 0.9; break;  // a quaternion that is none
        case 3: bad.qd.col(at).array() *= 1e200; break;     // overflow
        case 4: bad.u(3, at) = NaN; break;                  // q̈₀ and B̂ do not depend on it
        case 5: bad.q(0, at) = NaN; break;
        default: break;
      }
      test::check_agreement(robot.inputs, robot.several, bad, test::limit);
      MatrixX<T> qdd0_bad = qdd0, Bhat_bad = Bhat;
      const Index failed = robot.several.evaluate(bad.q, bad.qd, qdd0_bad, Bhat_bad, outcomes);
      CHECK(failed == (what == 4 ? 0 : 1));
      for (Index k = 0; k < many; ++k) {
        // Packs without the bad state: not a bit differs.
        if (k / Several::lanes != at / Several::lanes) {
          CHECK(qdd0_bad.col(k) == qdd0.col(k));
          CHECK(Bhat_bad.col(k) == Bhat.col(k));
        }
      }
    }
  }
  // And nothing of it remains.
  MatrixX<T> again = qdd0, Bhat_again = Bhat;
  CHECK(robot.several.evaluate(good.q, good.qd, again, Bhat_again, outcomes) == 0);
  CHECK(again == qdd0);
  CHECK(Bhat_again == Bhat);
}

TEST_CASE("a robot with a massless tip: every state says so", "[several]")
{
  test::Random draw(1);
  StandardAssembly<T> assembly;
  assembly.add("base", {}, FloatingBase<T>{draw.body()});
  assembly.add("arm", {.parent = "base"}, RevoluteLink<T>{{Vector3<T>::UnitY()}, draw.body()});
  assembly.add("hand", {.parent = "arm"}, RevoluteLink<T>{{Vector3<T>::UnitX()}, Body<T>::massless()});
  const Tree tree(assembly);
  const Inputs<Tree> inputs(tree);
  Several several(assembly, inputs);
  const States<T> states(tree, inputs.columns(), many, draw);
  test::check_agreement(inputs, several, states, test::limit);
  std::vector<Outcome> outcomes(many);
  MatrixX<T> qdd(tree.n_v(), many);
  CHECK(several.accelerations(states.q, states.qd, states.u, qdd, outcomes) == many);
  CHECK(outcomes.back() == Outcome{Status::not_positive_definite, tree.index("hand")});
}

TEST_CASE("several states in the cycle: contacts come and go, no heap, nothing thrown", "[several]")
{
  Robot robot;
  States<T> states(robot.tree, robot.inputs.columns(), many, robot.draw);
  states.q(robot.tree.n_q() - 1, 2) = NaN;
  const Index n = robot.tree.n_v();
  const Index all = robot.inputs.columns();
  MatrixX<T> qdd0(n, many), Bhat(n * all, many), qdd(n, many);
  std::vector<Outcome> outcomes(many);
  for (int round = 0; round < 2; ++round) {
    Index failed = 0, seen = 0, seen_packs = 0;
    test::in_cycle("several states", [&] {
      failed = robot.several.evaluate(states.q, states.qd, qdd0, Bhat, outcomes);
      failed += robot.several.accelerations(states.q, states.qd, states.u, qdd, outcomes);
      robot.several.for_each(states.q, states.qd, [&](Index, const auto& dynamics) { seen += dynamics.ok(); });
      robot.several.for_each_pack(states.q, states.qd, [&](const auto& pack) { seen_packs += pack.count; });
    });
    CHECK(failed == 2);
    CHECK(seen == many - 1);
    CHECK(seen_packs == many);
  }
  for (const int every : {2, 3, 1}) {
    for (Index id = 0; id < robot.inputs.blocks(); ++id) { robot.inputs.set_active(id, id % every == 0); }
    States<T> fewer = states;
    fewer.u = states.u.topRows(robot.inputs.columns()).eval();
    test::check_agreement(robot.inputs, robot.several, fewer, test::limit);
  }
  CHECK(robot.inputs.columns() == all);
}

TEST_CASE("the assembly of a smaller robot is refused before its memory is read", "[several]")
{
  Robot robot;
  const StandardAssembly<T> smaller = models::chain<T>(2);
  REQUIRE(robot.tree.size() > 2);
  CHECK_THROWS_AS(SeveralStates(smaller, robot.inputs), ModelError);
  const Tree other(smaller);
  CHECK_THROWS_AS(robot.inputs.on(other), ModelError);
}

TEST_CASE("accelerations see which inputs are active, and the scene of a pack of which a state is computed by itself",
          "[several]")
{
  Robot robot;
  const States<T> states(robot.tree, robot.inputs.columns(), many, robot.draw);
  const Index n = robot.tree.n_v();
  MatrixX<T> qdd(n, many);
  std::vector<Outcome> outcomes(many);
  const auto apart = [&](Index k, const VectorX<T>& expected) {
    return (qdd.col(k) - expected).norm() / expected.norm();
  };
  Workspace<Tree> ws(robot.tree);
  constexpr T close = test::limit * std::numeric_limits<T>::epsilon();

  // No evaluate() in between, which looks for itself.
  for (const Index off : {Index(0), robot.inputs.blocks() - 1}) {
    robot.inputs.set_active(off, false);
    const MatrixX<T> u = states.u.topRows(robot.inputs.columns());
    CHECK(robot.several.accelerations(states.q, states.qd, u, qdd, outcomes) == 0);
    for (const Index k : {Index(0), many - 1}) {
      const VectorX<T> q = states.q.col(k), qd = states.qd.col(k), u_k = u.col(k);
      CHECK(apart(k, forward_dynamics(q, qd, robot.inputs, u_k, ws).qdd) < close);
    }
    robot.inputs.set_active(off, true);
  }

  MatrixX<T> q = states.q;
  q(robot.tree.n_q() - 1, 0) = NaN;  // so that those beside it are computed by themselves
  const auto check_scene = [&]<Scene scene>(std::integral_constant<Scene, scene>) {
    CHECK(robot.several.template accelerations<scene>(q, states.qd, states.u, qdd, outcomes) == 1);
    MatrixX<T> qdd0(n, many), Bhat(n * robot.inputs.columns(), many);
    CHECK(robot.several.template evaluate<scene>(q, states.qd, qdd0, Bhat, outcomes) == 1);
    const VectorX<T> q_1 = q.col(1), qd_1 = states.qd.col(1), u_1 = states.u.col(1);
    CHECK(apart(1, forward_dynamics<scene>(q_1, qd_1, robot.inputs, u_1, ws).qdd) < close);
    const VectorX<T> expected = forward_dynamics<scene>(q_1, qd_1, ws).qdd0();
    CHECK((qdd0.col(1) - expected).norm() < close * expected.norm());
  };
  check_scene(std::integral_constant<Scene, Scene{.velocity = false}>{});
  check_scene(std::integral_constant<Scene, Scene{.gravity = false}>{});
}

}  // namespace test_several_failures
