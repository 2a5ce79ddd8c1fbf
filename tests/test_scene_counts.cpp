// PROGRAM: tests_counts
// What every scene costs, in products: the numbers are held, so that nothing that a scene leaves out creeps back in.
#include "catch.hpp"
#include "counted.hpp"
#include "random_tree.hpp"

#include <iim/models.hpp>
#include <iim/task.hpp>

#include <cstdio>
#include <string>
#include <vector>

namespace test_scene_counts {

using namespace iim;
using test::Counted;

namespace {

using Parts = StandardAssembly<Counted>;
using Tree = decltype(DynamicTree(std::declval<Parts>()));

/// A robot, its inputs, a state.
struct Robot {
  Tree tree;
  Inputs<Tree> inputs{tree, Start::empty};
  Workspace<Tree> ws{tree};
  VectorX<Counted> q, qd;

  explicit Robot(const Parts& assembly) : tree(assembly)
  {
    test::Random draw(1);
    const test::RandomState state = test::random_state(tree, 0, draw);
    q = state.q.cast<Counted>();
    qd = state.qd.cast<Counted>();
  }
  Robot(const Robot&) = delete;
  Robot& operator=(const Robot&) = delete;

  Robot& motors(const std::string& beginning = "")
  {
    for (const Node& node : tree.nodes()) {
      if (tree.name(node.index).starts_with(beginning) && tree.name(node.index) != "torso") {
        inputs.add_motor(tree.name(node.index));
      }
    }
    return *this;
  }
  Robot& contacts(std::size_t count)
  {
    for (std::size_t k = 0; k < count; ++k) { inputs.add_force(models::biped_contacts[k]); }
    return *this;
  }

  template <Scene scene = Scene{}>
  long pass()
  {
    return test::count_products([&] { REQUIRE(forward_dynamics<scene>(q, qd, ws).ok()); });
  }
  long Bhat()
  {
    ImplicitInversion method(tree, inputs);
    const auto fd = forward_dynamics(q, qd, ws);
    return test::count_products([&] { REQUIRE(method(fd).ok()); });
  }
};

/// The count is what it was, to 2 %: fewer is worth a new number here, more is a regression.
void hold(const char* scene, long products, long expected)
{
  std::printf("%-52s %8ld products\n", scene, products);
  INFO(scene);
  CHECK(static_cast<double>(products) <= 1.02 * static_cast<double>(expected));
  CHECK(static_cast<double>(products) >= 0.98 * static_cast<double>(expected));
}

}  // namespace

TEST_CASE("what every scene of the biped costs")
{
  const Parts biped = models::biped<Counted>();
  Robot robot(biped);
  hold("q̈₀", robot.pass(), 7086);
  hold("q̈₀ at rest", robot.pass<Scene{.velocity = false}>(), 5545);
  hold("q̈₀ without gravity", robot.pass<Scene{.gravity = false}>(), 7086);
  hold("B̂, one motor", Robot(biped).motors("left_toe").Bhat(), 443);
  hold("B̂, 14 motors", Robot(biped).motors().Bhat(), 3856);
  hold("B̂, 14 motors and one foot: 26 inputs", Robot(biped).motors().contacts(4).Bhat(), 6003);
  hold("B̂, 14 motors and both feet: 38 inputs", Robot(biped).motors().contacts(8).Bhat(), 8150);
  hold("B̂, the 7 motors of one leg", Robot(biped).motors("left").Bhat(), 2905);
  hold("B̂, one foot", Robot(biped).contacts(4).Bhat(), 3902);
}

TEST_CASE("what every scene of the arm and the chain costs")
{
  const Parts chain = models::chain<Counted>(7);
  hold("chain of 7: q̈₀", Robot(chain).pass(), 2364);
  hold("chain of 7: B̂, all motors", Robot(chain).motors().Bhat(), 485);
  const Parts longer = models::chain<Counted>(50);
  hold("chain of 50: q̈₀", Robot(longer).pass(), 18126);
  hold("chain of 50: B̂, all motors", Robot(longer).motors().Bhat(), 44077);
  hold("chain of 50: B̂, the last motor", Robot(longer).motors("link49").Bhat(), 1526);
  const Parts tree = models::binary_tree<Counted>(63);
  hold("tree of 63: q̈₀", Robot(tree).pass(), 22041);
  hold("tree of 63: B̂, all motors", Robot(tree).motors().Bhat(), 10842);
}

TEST_CASE("what task rows cost beside B̂")
{
  const Parts biped = models::biped<Counted>();
  Robot robot(biped);
  robot.motors().contacts(8);
  ImplicitInversion method(robot.tree, robot.inputs);
  const auto fd = forward_dynamics(robot.q, robot.qd, robot.ws);
  const auto dynamics = method(fd);
  const auto rows = [&](auto&& add) {
    Tasks tasks(robot.tree, robot.inputs);
    add(tasks);
    return test::count_products([&] { static_cast<void>(tasks(fd, dynamics)); });
  };
  hold("one point: J_t, J̇_t q̇, J_t B̂, V̇_t0", rows([](auto& t) { t.add_point(models::biped_contacts[0]); }), 1536);
  hold("centre of mass", rows([](auto& t) { t.add_com(); }), 6284);
  CHECK(rows([](auto& t) { t.set_active(t.add_com(), false); }) == 0);
}

}  // namespace test_scene_counts
