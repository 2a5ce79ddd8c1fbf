// PROGRAM: tests_no_heap
// Nothing in the cycle allocates or throws: the other updates of M̄*.
#include "cycle.hpp"

#include <type_traits>

namespace test_cycle_no_heap_updates {

using namespace iim;
using namespace iim::test;

namespace {

template <Update update>
void check(const StandardAssembly<double>& assembly = robot())
{
  const DynamicTree tree(assembly);
  using Tree = std::remove_const_t<decltype(tree)>;
  Inputs<Tree> inputs = robot_inputs(tree);
  Workspace<Tree, update> ws(tree);
  check_forward_dynamics(tree, inputs, ws);
  check_workspace_methods(tree, inputs, ws);
}

}  // namespace

TEST_CASE("nothing allocates or throws with the update as printed") { check<Update::printed>(); }
TEST_CASE("nothing allocates or throws with the square-root update") { check<Update::square_root>(); }
TEST_CASE("nor where a force acts on a far heavier body") { check<Update::square_root>(robot(1e6)); }

}  // namespace test_cycle_no_heap_updates
