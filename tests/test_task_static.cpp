// PROGRAM: tests_several
// Task rows on a tree that stands in the type, and in scenes without velocity or gravity.
#include "catch.hpp"
#include "random_tree.hpp"

#include <iim/task.hpp>

#include <limits>

namespace test_task_static {

using namespace iim;
using namespace iim::test;
using Base = FloatingBase<double>;
using Arm = MotorArm<double>;
using Slide = PrismaticLink<double>;
using Dynamic = DynamicTree<Base, Arm, Slide>;
using Static = StaticTree<On<-1, Base>, On<0, Arm>, On<1, Slide>, On<0, Arm>>;

namespace {

Assembly<Base, Arm, Slide> robot(Random& random)
{
  Assembly<Base, Arm, Slide> assembly;
  const auto on = [&](const std::string& parent) {
    return Attachment<double>{parent, random.rotation(), random.vector(0.5)};
  };
  assembly.add("torso", on("world"), Base{random.body()});
  assembly.add("left", on("torso"), Arm{{random.axis()}, random.body(), random.motor()});
  assembly.add("right", on("torso"), Arm{{random.axis()}, random.body(), random.motor()});
  assembly.add("slide", on("left"), Slide{{random.axis()}, random.body()});
  assembly.add_frame("hand", on("slide"));
  assembly.set_gravity(random.vector(10));
  return assembly;
}

template <class Tree, Scene scene>
void add_all(Tasks<Tree, scene>& tasks, const Vec3& point)
{
  tasks.add_frame("hand", point);
  tasks.add_momentum();
  tasks.add_point("right", point, Axes::body);
  tasks.add_com();
}

struct Numbers {
  Eigen::MatrixXd J, JB;
  Eigen::VectorXd Jdot_qd, Vdot0;
};

/// Rows of all tasks at a state, with the pass and the tasks in one scene.
template <Scene scene, class Tree>
Numbers rows_in(const Tree& tree, const Eigen::VectorXd& q, const Eigen::VectorXd& qd, const Vec3& point,
                Workspace<Tree>& ws)
{
  Inputs<Tree> inputs(tree);
  inputs.add_force("hand");
  Tasks<Tree, scene> tasks(tree, inputs);
  add_all(tasks, point);
  ImplicitInversion<Tree> method(tree, inputs);
  const auto fd = forward_dynamics<scene>(q, qd, ws);
  const TaskRows<double> rows = tasks(fd, method(fd));
  REQUIRE(rows.ok());
  return {rows.J, rows.JB, rows.Jdot_qd, rows.Vdot0};
}

void require_same(const Numbers& a, const Numbers& b)
{
  // The same operations; compilers may contract and reorder them in the two instantiations. 18 rows, gears to 100.
  const double eps = std::numeric_limits<double>::epsilon();
  REQUIRE((a.J - b.J).norm() <= 20 * eps * a.J.norm());
  REQUIRE((a.JB - b.JB).norm() <= 1e4 * eps * a.JB.norm());
  REQUIRE((a.Jdot_qd - b.Jdot_qd).norm() <= 100 * eps * a.Jdot_qd.norm());
  REQUIRE((a.Vdot0 - b.Vdot0).norm() <= 1e4 * eps * a.Vdot0.norm());
}

}  // namespace

TEST_CASE("task rows of a static tree are those of the dynamic one", "[task]")
{
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    CAPTURE(seed);
    Random random(seed);
    const auto assembly = robot(random);
    const Dynamic dynamic_tree(assembly);
    const Static static_tree(assembly);
    const RandomState state = random_state(dynamic_tree, 0, random);
    const Vec3 point = random.vector(0.5);
    Workspace dynamic_ws(dynamic_tree);
    Workspace static_ws(static_tree);
    require_same(rows_in<Scene{}>(dynamic_tree, state.q, state.qd, point, dynamic_ws),
                 rows_in<Scene{}>(static_tree, state.q, state.qd, point, static_ws));
  }
}

TEST_CASE("task rows of a scene without velocity or gravity", "[task]")
{
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    CAPTURE(seed);
    Random random(seed);
    auto assembly = robot(random);
    const Vec3 point = random.vector(0.5);
    const Dynamic tree(assembly);
    assembly.set_gravity(Vec3::Zero());
    const Dynamic floating(assembly);
    const RandomState state = random_state(tree, 0, random);
    const Eigen::VectorXd still = Eigen::VectorXd::Zero(tree.n_v());

    Workspace ws(tree), other(tree), weightless(floating);
    // A pass with velocities first: the scene without must not see what it left.
    rows_in<Scene{}>(tree, state.q, state.qd, point, ws);
    const Numbers at_rest = rows_in<Scene{.velocity = false}>(tree, state.q, state.qd, point, ws);
    require_same(at_rest, rows_in<Scene{}>(tree, state.q, still, point, other));
    REQUIRE(at_rest.Jdot_qd == Eigen::VectorXd::Zero(18));

    require_same(rows_in<Scene{.gravity = false}>(tree, state.q, state.qd, point, ws),
                 rows_in<Scene{}>(floating, state.q, state.qd, point, weightless));
  }
}

}  // namespace test_task_static
