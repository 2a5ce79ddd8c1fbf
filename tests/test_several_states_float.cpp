// PROGRAM: tests_several
// Several states at once in float: random robots, every remainder of a pack.
#include "several_states.hpp"

TEST_CASE("several states in float agree with each by itself", "[several]")
{
  iim::test::check_random_robots<float>(61, 120);
}
