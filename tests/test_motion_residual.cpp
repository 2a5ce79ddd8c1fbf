// PROGRAM: tests_extreme
// What the equations of motion leave of q̈ is nothing, by sums over bodies that the pass does not make: every kind of
// part, scene and load. A term with a wrong sign, frame or place would make robots under loads come back wrong, or not
// at all.
#include "catch.hpp"
#include "mechanism.hpp"
#include "random_tree.hpp"

#include <iim/iim.hpp>
#include <iim/subsystem/elastic_motor_arm.hpp>
#include <iim/subsystem/joint_more.hpp>
#include <iim/subsystem/sprung.hpp>

#include <cmath>
#include <cstdint>
#include <string>
#include <type_traits>

using namespace iim;

namespace {

/// The second look at what a pass has left in its workspace, whether or not a pivot was small.
template <Scene scene, class WorkspaceType>
void check_second_look(WorkspaceType& ws)
{
  const Eigen::VectorXd qdd = ws.qdd();
  typename WorkspaceType::Data& data = ws;
  data.second_look().note_small_pivot(0);
  CHECK(data.second_look().wrong_pivot(scene.implicit, data) == -1);
  CHECK(data.second_look().refine(scene.velocity, scene.gravity, scene.implicit, data));
  CHECK((ws.qdd() - qdd).norm() <= 1e-10 * qdd.norm());
}

template <Update update, class Tree>
void check_scenes(const Tree& tree, const Inputs<Tree>& inputs, const test::RandomState& state)
{
  Workspace<Tree, update> ws(tree);
  const auto look = [&]<Scene scene>(std::integral_constant<Scene, scene>) {
    REQUIRE(forward_dynamics<scene>(state.q, state.qd, inputs, state.u, ws).ok());
    check_second_look<scene>(ws);
  };
  look(std::integral_constant<Scene, Scene{}>{});
  look(std::integral_constant<Scene, Scene{.velocity = false}>{});
  look(std::integral_constant<Scene, Scene{.gravity = false}>{});
}

}  // namespace

TEST_CASE("Random robots: nothing is left of q̈ under inputs")
{
  for (std::uint64_t seed = 1; seed <= 100; ++seed) {
    CAPTURE(seed);
    test::RandomOptions options;
    options.floating_inside = 0.2;
    const test::RandomRobot robot = test::random_robot(seed, options);
    const DynamicTree tree(robot.assembly);
    if (tree.n_v() == 0) { continue; }
    const auto inputs = test::make_inputs(tree, robot.inputs);
    test::Random random(seed);
    const test::RandomState state = test::random_state(tree, inputs.columns(), random, 3);
    check_scenes<Update::projected>(tree, inputs, state);
    check_scenes<Update::printed>(tree, inputs, state);
  }
}

TEST_CASE("Parts of several frames, with rotors and bodies on all of them")
{
  test::Random random(7);
  for (int k = 0; k < 20; ++k) {
    const DynamicTree tree(test::mechanism_robot(random));
    Inputs inputs(tree);
    inputs.add_wrench("held", {0.1, 0.2, 0.3});
    inputs.add_force("second");
    check_scenes<Update::projected>(tree, inputs, test::random_state(tree, inputs.columns(), random, 3));
  }
}

TEST_CASE("Springs, in steps of any length, and joints of several velocities")
{
  using Spring = Sprung<RevoluteLink<double>>;
  using Parts =
      Assembly<FloatingBase<double>, Spring, ElasticMotorArm<double>, SphericalLink<double>, UniversalLink<double>>;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    CAPTURE(seed);
    test::Random random(seed);
    Parts parts;
    std::string parent = "world";
    const auto add = [&](const std::string& name, const auto& part) {
      parts.add(name, {parent, random.rotation(), random.vector(0.4)}, part);
      if (random.chance(0.7)) { parent = name; }
    };
    if (random.chance(0.5)) { add("base", FloatingBase<double>{random.body()}); }
    for (const std::string k : {"1", "2"}) {
      Spring spring;
      spring.joint.axis = random.axis();
      spring.body = random.body();
      spring.stiffness(0) = std::pow(10.0, random.uniform(0, 6));
      spring.damping(0) = random.uniform(0, 10);
      add("spring" + k, spring);
      ElasticMotorArm<double> drive;
      drive.joint.axis = random.axis();
      drive.body = random.body();
      drive.motor = random.motor();
      drive.stiffness = std::pow(10.0, random.uniform(0, 6));
      add("drive" + k, drive);
      add("ball" + k, SphericalLink<double>{{}, random.body()});
      add("cross" + k, UniversalLink<double>{{}, random.body()});
    }
    const DynamicTree tree(parts);
    using Tree = std::remove_const_t<decltype(tree)>;
    test::RandomState state = test::random_state(tree, 0, random);
    tree.outward([&]<class N, class S>(const N& node, const S&) {
      if constexpr (std::is_same_v<S, SphericalLink<double>>) {
        state.q.template segment<4>(node.q) = random.quaternion();
      }
    });
    Workspace<Tree> ws(tree);
    for (const double h : {0.0, 1e-3, 1e-1}) {
      CAPTURE(h);
      REQUIRE(implicit_step(state.q, state.qd, h, ws).ok());
      check_second_look<Scene{.implicit = true}>(ws);
    }
  }
}
