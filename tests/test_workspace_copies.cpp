// PROGRAM: tests_parallel
// Workspaces that were copied, moved or assigned to while another was used, or is gone.
#include "catch.hpp"
#include "wrist_arm.hpp"

#include <memory>
#include <optional>
#include <utility>
#include <vector>

namespace test_workspace_copies {

using namespace iim;
using namespace iim::test;

namespace {

using Tree = WristArmTree;

}  // namespace

TEST_CASE("a copy of a workspace finds the bodies beyond a weak pivot in itself")
{
  Random random(1);
  const WristArmParts assembly = wrist_arm(random);
  const Tree tree(assembly);
  Workspace<Tree> ws(tree);
  auto first = std::make_unique<Workspace<Tree>>(tree);
  Workspace<Tree> copy(*first);
  const Workspace<Tree> moved_from = std::move(*first);
  first.reset();
  Workspace<Tree> moved(moved_from);
  for (int k = 0; k < 20; ++k) {
    const RandomState state = stretched(tree, random), other = stretched(tree, random);
    const VectorX<double> qdd = forward_dynamics(state.q, state.qd, ws).qdd0();
    (void)forward_dynamics(other.q, other.qd, ws);
    CHECK(forward_dynamics(state.q, state.qd, copy).qdd0() == qdd);
    CHECK(forward_dynamics(state.q, state.qd, moved).qdd0() == qdd);
  }
}

TEST_CASE("a workspace that is restored where it was finds the bodies beyond in what it then has")
{
  Random random(1);
  const Tree tree(wrist_arm(random));
  Workspace<Tree> ws(tree);
  const RandomState state = stretched(tree, random), other = stretched(tree, random);
  const VectorX<double> qdd = forward_dynamics(state.q, state.qd, ws).qdd0();
  std::optional<Workspace<Tree>> used(std::in_place, tree);
  REQUIRE(forward_dynamics(other.q, other.qd, *used).ok());
  const Workspace<Tree> backup(*used);
  Workspace<Tree> assigned(tree);
  REQUIRE(forward_dynamics(other.q, other.qd, assigned).ok());
  const Workspace<Tree> second(assigned);
  used.reset();
  assigned = Workspace<Tree>(tree);
  const std::vector<double> taken(10000, 1e30);  // what was the first's
  used.emplace(backup);
  assigned = second;
  CHECK(forward_dynamics(state.q, state.qd, *used).qdd0() == qdd);
  CHECK(forward_dynamics(state.q, state.qd, assigned).qdd0() == qdd);
}

}  // namespace test_workspace_copies
