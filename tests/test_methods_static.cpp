// PROGRAM: tests_methods
// The methods agree on a tree that stands in the type.
#include "mechanism.hpp"

#include <iostream>

namespace test_methods_static {

using namespace iim;
using namespace iim::test;

namespace {

/// mechanism_robot() as a type.
using StaticRobot =
    StaticTree<On<-1, FloatingBase<double>>, On<0, Mechanism>, On<1, MotorArm<double>, 1>, On<1, MotorArm<double>, 2>,
               On<1, FixedLink<double>>, On<4, Mechanism>, On<5, MotorArm<double>, 1>>;

}  // namespace

TEST_CASE("the methods agree on a static tree with a mechanism of three frames")
{
  std::cout << states << " robots from seed " << first_seed << '\n';
  for (std::uint64_t seed = first_seed; seed < first_seed + states; ++seed) {
    CAPTURE(seed);
    Random random(seed);
    const StaticRobot tree(mechanism_robot(random));
    compare<Update::projected>(tree, random);
  }
}

}  // namespace test_methods_static
