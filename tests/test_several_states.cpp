// PROGRAM: tests_several
// Several states at once in double: random robots, every remainder of a pack.
#include "several_states.hpp"

namespace test_several_states {

TEST_CASE("several states in double agree with each by itself", "[several]")
{
  iim::test::check_random_robots<double>(1, 60);
}

}  // namespace test_several_states
