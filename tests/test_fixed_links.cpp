// PROGRAM: tests_methods
// A FixedLink on what takes its body is a frame of that: the same robot as with the bodies put together by hand.
#include "catch.hpp"
#include "random_tree.hpp"

#include <iim/subsystem/elastic_motor_arm.hpp>

#include <cstdint>
#include <string>

namespace test_fixed_links {

using namespace iim;

namespace {

using Elastic = iim::ElasticMotorArm<double>;
/// What does not take the bodies of FixedLinks.
struct Bare : RevoluteLink<double> {
  Body<double>& fixed_body() = delete;
};
using Parts = Assembly<RevoluteLink<double>, FloatingBase<double>, FixedLink<double>, Elastic, Bare>;

struct Robots {
  Parts given;  ///< base – plate – bracket, on which an arm and the frame "eye" are; an elastic hand on it, with a tool
  Parts merged;
};

Robots robots(std::uint64_t seed)
{
  test::Random random(seed);
  const FloatingBase<double> base{random.body()};
  const FixedLink<double> plate{{}, random.body()}, bracket{{}, random.body()}, tool{{}, random.body()};
  const RevoluteLink<double> arm{{random.unit()}, random.body()};
  Elastic hand;
  hand.joint.axis = random.unit();
  hand.body = random.body();
  hand.motor = {.gear_ratio = 50.0, .axial_inertia = 1e-4};
  hand.stiffness = 100;
  const Placement<double> to_plate{random.rotation(), random.vector(1)},
      to_bracket{random.rotation(), random.vector(1)}, to_arm{random.rotation(), random.vector(1)},
      to_eye{random.rotation(), random.vector(1)}, to_hand{random.rotation(), random.vector(1)},
      to_tool{random.rotation(), random.vector(1)};
  const auto on = [](const std::string& parent, const Placement<double>& at) {
    return Attachment<double>{parent, at.R, at.p};
  };
  Robots result;
  result.given.add("tool", on("hand", to_tool), tool)
      .add("hand", on("arm", to_hand), hand)
      .add("arm", on("bracket", to_arm), arm)
      .add("base", {}, base)
      .add("bracket", on("plate", to_bracket), bracket)
      .add("plate", on("base", to_plate), plate)
      .add_frame("eye", on("bracket", to_eye));

  FloatingBase<double> whole = base;
  const Placement<double> bracket_on_base = to_plate * to_bracket;
  Body<double> on_plate = plate.body;
  on_plate.add(bracket.body.placed(to_bracket));
  whole.body.add(on_plate.placed(to_plate));
  Elastic hand_and_tool = hand;
  hand_and_tool.body.add(tool.body.placed(to_tool));
  result.merged.add("base", {}, whole)
      .add("arm", on("base", bracket_on_base * to_arm), arm)
      .add("hand", on("arm", to_hand), hand_and_tool)
      .add_frame("plate", on("base", to_plate))
      .add_frame("bracket", on("base", bracket_on_base))
      .add_frame("eye", on("base", bracket_on_base * to_eye))
      .add_frame("tool", on("hand", to_tool));
  return result;
}

}  // namespace

TEST_CASE("FixedLinks on a base and an elastic arm: bit for bit what bodies and frames put together by hand are")
{
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const Robots both = robots(seed);
    const DynamicTree tree(both.given), expected(both.merged);
    REQUIRE(tree.size() == 3);
    CHECK(tree.is_shaped_as(expected));
    CHECK(tree.node(1).parent == 0);
    CHECK(tree.node("hand").index == 2);
    CHECK(tree.node("hand").v == 7);
    const auto result = [](const auto& robot, const test::RandomState& state) {
      Inputs inputs(robot);
      for (const char* name : {"plate", "eye", "tool", "bracket"}) { inputs.add_wrench(name, {0.1, 0.2, 0.3}); }
      Workspace ws(robot);
      ImplicitInversion method(robot, inputs);
      const auto dynamics = method(state.q, state.qd, ws);
      REQUIRE(dynamics.ok());
      Eigen::MatrixXd all(robot.n_v(), 1 + inputs.columns());
      all << dynamics.qdd0, dynamics.Bhat;
      return all;
    };
    test::Random random(seed);
    const test::RandomState state = test::random_state(expected, 0, random);
    CHECK(result(tree, state) == result(expected, state));
  }
}

TEST_CASE("FixedLinks as frames: where they are, and what asks for them as subsystems is told so")
{
  const DynamicTree tree(robots(1).given);
  CHECK(tree.frame("bracket").subsystem == tree.index("base"));
  CHECK(tree.frame("tool").subsystem == tree.index("hand"));
  CHECK_THROWS_WITH(tree.index("tool"), "'tool' is no subsystem, but a frame on 'hand' (tree.frame)");
  CHECK_THROWS_WITH(tree.node("tool"), "'tool' is no subsystem, but a frame on 'hand' (tree.frame)");
  CHECK_THROWS_WITH(tree.index("eye"), "'eye' is no subsystem, but a frame on 'base' (tree.frame)");
  CHECK_THROWS_WITH(tree.index("foot"), "there is no subsystem 'foot'");
  Inputs inputs(tree);
  CHECK_THROWS_AS(inputs.add_motor("tool"), ModelError);
  CHECK(inputs.columns() == 2);
}

TEST_CASE("FixedLinks that are subsystems: on the world, and on what does not take their bodies")
{
  test::Random random(1);
  Parts parts;
  Bare drive;
  drive.body = random.body();
  parts.add("post", {}, FixedLink<double>{{}, random.body()})
      .add("shelf", {.parent = "post", .p = {0, 0, 1}}, FixedLink<double>{{}, random.body()})
      .add("drive", {.parent = "shelf", .p = {0, 1, 0}}, drive)
      .add("tool", {.parent = "drive", .p = {1, 0, 0}}, FixedLink<double>{{}, random.body()})
      .add("tip", {.parent = "tool", .p = {2, 0, 0}}, FixedLink<double>{{}, random.body()});
  const DynamicTree tree(parts);
  REQUIRE(tree.size() == 3);
  CHECK(tree.index("post") == 0);
  CHECK(tree.index("drive") == 1);
  CHECK(tree.node(1).parent == 0);
  CHECK(tree.placement(1).p == Vector3<double>(0, 1, 1));
  CHECK(tree.index("tool") == 2);
  CHECK(tree.frame("tip").subsystem == 2);
  CHECK(tree.frame("tip").at.p == Vector3<double>(2, 0, 0));
}

}  // namespace test_fixed_links
