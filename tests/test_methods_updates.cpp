// PROGRAM: tests_mechanisms
// The methods agree with the other updates of M̄* too, and the global inverse, which owes them nothing, does not change.
#include "mechanism.hpp"

#include <iostream>

namespace test_methods_updates {

using namespace iim;
using namespace iim::test;

TEST_CASE("the methods agree on a mechanism of three frames, printed and square root")
{
  std::cout << states << " robots from seed " << first_seed << '\n';
  for (std::uint64_t seed = first_seed; seed < first_seed + states; ++seed) {
    CAPTURE(seed);
    Random random(seed);
    const DynamicTree tree(mechanism_robot(random));
    Random same = random;
    const MatrixX<double> printed = compare<Update::printed>(tree, random);
    CHECK(compare<Update::square_root>(tree, same) == printed);
  }
}

}  // namespace test_methods_updates
