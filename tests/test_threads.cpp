// PROGRAM: tests_several
// One tree and its inputs may be shared by threads that have each a workspace, a method and tasks: what they compute is
// bit for bit what one thread computes.
#include "catch.hpp"
#include "random_tree.hpp"

#include <iim/models.hpp>
#include <iim/task.hpp>

#include <cstddef>
#include <thread>
#include <vector>

namespace test_threads {

using namespace iim;

namespace {

using Tree = StandardTree<double>;

struct Results {
  std::vector<Eigen::MatrixXd> qdd0, Bhat, JB;
};

/// Of the states k with k ≡ first modulo step.
void evaluate(const Tree& tree, const Inputs<Tree>& inputs, const std::vector<test::RandomState>& states,
              std::size_t first, std::size_t step, Results& results)
{
  Workspace<Tree> ws(tree);
  ImplicitInversion<Tree> method(tree, inputs);
  Tasks<Tree> tasks(tree, inputs);
  tasks.add_com();
  tasks.add_point(models::biped_contacts[0]);
  for (std::size_t k = first; k < states.size(); k += step) {
    const auto dynamics = method(states[k].q, states[k].qd, ws);
    const auto rows = tasks(dynamics);
    if (!dynamics.ok() || !rows.ok()) { continue; }  // empty then
    results.qdd0[k] = dynamics.qdd0;
    results.Bhat[k] = dynamics.Bhat;
    results.JB[k] = rows.JB;
  }
}

}  // namespace

TEST_CASE("threads that share a tree and its inputs", "[several]")
{
  const Tree tree(models::biped<double>());
  Inputs<Tree> inputs(tree);
  for (const char* point : models::biped_contacts) { inputs.add_force(point); }
  test::Random draw(5);
  std::vector<test::RandomState> states;
  for (int k = 0; k < 200; ++k) { states.push_back(test::random_state(tree, 0, draw)); }
  const auto none = [&] {
    const std::vector<Eigen::MatrixXd> empty(states.size());
    return Results{empty, empty, empty};
  };
  Results alone = none(), together = none();
  evaluate(tree, inputs, states, 0, 1, alone);
  {
    constexpr std::size_t count = 4;
    std::vector<std::thread> threads;
    for (std::size_t t = 0; t < count; ++t) {
      threads.emplace_back([&, t] { evaluate(tree, inputs, states, t, count, together); });
    }
    for (std::thread& thread : threads) { thread.join(); }
  }
  for (std::size_t k = 0; k < states.size(); ++k) {
    REQUIRE(alone.Bhat[k].size() > 0);
    CHECK(together.qdd0[k] == alone.qdd0[k]);
    CHECK(together.Bhat[k] == alone.Bhat[k]);
    CHECK(together.JB[k] == alone.JB[k]);
  }
}

}  // namespace test_threads
