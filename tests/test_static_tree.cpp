// PROGRAM: tests_methods
// A tree in the C++ type computes what the same tree read at run time computes.
#include "catch.hpp"
#include "random_tree.hpp"

#include <limits>
#include <string>
#include <utility>

namespace test_static_tree {

using namespace iim;
using Catch::Matchers::ContainsSubstring;
using test::Vec3;

namespace {

constexpr double eps = std::numeric_limits<double>::epsilon();
using Revolute1 = RevoluteLink<double>;
using Prismatic1 = PrismaticLink<double>;
using Arm = MotorArm<double>;
using Base = FloatingBase<double>;
using Rigid = FixedLink<double>;

/// Both trees from one assembly: statuses, q̈₀, B̂ and q̈(u) at random states.
template <class Static>
void compare(const StandardAssembly<double>& assembly, const std::vector<test::NamedInput>& named)
{
  const DynamicTree dynamic_tree(assembly);
  const Static static_tree(assembly);
  const auto& tree = dynamic_tree;
  REQUIRE(static_tree.n_q() == tree.n_q());
  REQUIRE(static_tree.n_v() == tree.n_v());
  REQUIRE(static_tree.n_motors() == tree.n_motors());

  const Inputs dynamic_inputs = test::make_inputs(tree, named);
  const Inputs static_inputs = test::make_inputs(static_tree, named);
  Workspace dynamic_ws(tree);
  Workspace static_ws(static_tree);
  ImplicitInversion dynamic_method(tree, dynamic_inputs);
  ImplicitInversion static_method(static_tree, static_inputs);
  test::Random draw(1);
  for (int k = 0; k < 20; ++k) {
    const test::RandomState state = test::random_state(tree, dynamic_inputs.columns(), draw);
    const auto a = static_method(forward_dynamics(state.q, state.qd, static_ws));
    const auto b = dynamic_method(forward_dynamics(state.q, state.qd, dynamic_ws));
    REQUIRE(a.ok());
    REQUIRE(b.ok());
    // One text: the compiler may contract or order products differently, no more.
    CHECK((a.qdd0 - b.qdd0).norm() <= 64 * eps * b.qdd0.norm());
    CHECK((a.Bhat - b.Bhat).norm() <= 64 * eps * b.Bhat.norm());
    const Eigen::VectorXd qdd = forward_dynamics(state.q, state.qd, static_inputs, state.u, static_ws).qdd;
    const Eigen::VectorXd expected = forward_dynamics(state.q, state.qd, dynamic_inputs, state.u, dynamic_ws).qdd;
    CHECK((qdd - expected).norm() <= 64 * eps * (b.qdd0.norm() + (b.Bhat * state.u).norm()));
  }
  const Eigen::VectorXd nothing = Eigen::VectorXd::Constant(tree.n_q(), std::numeric_limits<double>::quiet_NaN());
  const auto broken = forward_dynamics(nothing, Eigen::VectorXd::Zero(tree.n_v()), static_ws);
  CHECK(broken.status() == Status::invalid_state);
  CHECK(broken.subsystem() == 0);
}

/// The links of an arm with every kind of joint.
StandardAssembly<double> mixed_arm()
{
  test::Random draw(3);
  StandardAssembly<double> assembly;
  assembly.add("a", {.R = draw.rotation(), .p = draw.vector(1)}, Arm{{Vec3::UnitZ()}, draw.body(), draw.motor()});
  assembly.add("b", {.parent = "a", .R = draw.rotation(), .p = draw.vector(1)}, Revolute1{{draw.unit()}, draw.body()});
  assembly.add("c", {.parent = "b", .p = draw.vector(1)}, Prismatic1{{draw.unit()}, draw.body()});
  assembly.add("d", {.parent = "c", .R = draw.rotation()}, Rigid{{}, draw.body()});
  assembly.add("e", {.parent = "d", .p = draw.vector(1)}, Arm{{draw.unit()}, draw.body(), draw.motor(0)});
  return assembly;
}

using MixedArm = StaticTree<On<-1, Arm>, On<0, Revolute1>, On<1, Prismatic1>, On<2, Rigid>, On<3, Arm>>;
using MergedArm = StaticTree<On<-1, Arm>, On<0, Revolute1>, On<1, Prismatic1>, On<2, Arm>>;

}  // namespace

TEST_CASE("an arm with every kind of joint", "[static]")
{
  const std::vector<test::NamedInput> inputs{{InputKind::motor, "e"},
                                             {InputKind::force, "d", Vec3(0.1, 0.2, 0.3)},
                                             {InputKind::motor, "a"},
                                             {InputKind::wrench, "e", Vec3(0, 0, 0.4), Axes::body},
                                             {InputKind::motor, "b", Vec3::Zero(), Axes::world, false}};
  compare<MixedArm>(mixed_arm(), inputs);
  compare<MergedArm>(mixed_arm(), inputs);
}

TEST_CASE("several roots, and several children on one frame", "[static]")
{
  test::Random draw(4);
  StandardAssembly<double> assembly;
  // Added in an order that is not depth first.
  assembly.add("arm", {.parent = "base", .p = draw.vector(1)}, Arm{{draw.unit()}, draw.body(), draw.motor()});
  assembly.add("base", {}, Base{draw.body()});
  assembly.add("leg", {.parent = "base", .R = draw.rotation()}, Revolute1{{draw.unit()}, draw.body()});
  assembly.add("crane", {.p = draw.vector(2)}, Prismatic1{{Vec3::UnitZ()}, draw.body()});
  assembly.add("hand", {.parent = "arm", .p = draw.vector(1)}, Revolute1{{draw.unit()}, draw.body()});
  assembly.add("hook", {.parent = "crane", .p = draw.vector(1)}, Revolute1{{draw.unit()}, draw.body()});
  using Tree =
      StaticTree<On<-1, Base>, On<0, Arm>, On<1, Revolute1>, On<0, Revolute1>, On<-1, Prismatic1>, On<4, Revolute1>>;
  compare<Tree>(assembly,
                {{InputKind::wrench, "hook"}, {InputKind::motor, "arm"}, {InputKind::force, "leg", Vec3(0, 0, 1)}});
}

TEST_CASE("a tree of the wrong shape is an exception that names the subsystem", "[static]")
{
  const auto message = [](auto&& make) -> std::string {
    try {
      make();
    } catch (const ModelError& error) {
      return error.what();
    }
    return "no error";
  };
  CHECK(message([] { MixedArm{mixed_arm()}; }) == "no error");
  CHECK(message([] { MergedArm{mixed_arm()}; }) == "no error");
  using Shorter = StaticTree<On<-1, Arm>, On<0, Revolute1>>;
  const std::string size = message([] { Shorter{mixed_arm()}; });
  CHECK_THAT(size, ContainsSubstring("4 subsystems (with all FixedLinks 5)"));
  CHECK_THAT(size, ContainsSubstring("2"));
  using Forked = StaticTree<On<-1, Arm>, On<0, Revolute1>, On<1, Prismatic1>, On<2, Rigid>, On<2, Arm>>;
  CHECK_THAT(message([] { Forked{mixed_arm()}; }), ContainsSubstring("'e'"));
  using Swapped = StaticTree<On<-1, Arm>, On<0, Revolute1>, On<1, Revolute1>, On<2, Rigid>, On<3, Arm>>;
  CHECK_THAT(message([] { Swapped{mixed_arm()}; }), ContainsSubstring("'c'"));
}

}  // namespace test_static_tree
