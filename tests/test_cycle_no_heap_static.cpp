// PROGRAM: tests_no_heap
// Nothing in the cycle allocates or throws: a tree that stands in the type.
#include "cycle.hpp"

namespace test_cycle_no_heap_static {

using namespace iim;
using namespace iim::test;

namespace {

/// robot() as a type: torso, two legs of seven, rail, slide, hand, finger.
template <int Parent>
using Arm = On<Parent, MotorArm<double>>;
using StaticRobot = StaticTree<On<-1, FloatingBase<double>>, Arm<0>, Arm<1>, Arm<2>, Arm<3>, Arm<4>, Arm<5>, Arm<6>,
                               Arm<0>, Arm<8>, Arm<9>, Arm<10>, Arm<11>, Arm<12>, Arm<13>, On<0, PrismaticLink<double>>,
                               On<15, LinearMotorArm<double>>, On<16, FixedLink<double>>, On<17, RevoluteLink<double>>>;

}  // namespace

TEST_CASE("nothing allocates or throws in the cycle of a static tree")
{
  const StaticRobot tree(robot());
  Inputs<StaticRobot> inputs = robot_inputs(tree);
  Workspace<StaticRobot> ws(tree);
  check_forward_dynamics(tree, inputs, ws);
  check_workspace_methods(tree, inputs, ws);
}

}  // namespace test_cycle_no_heap_static
