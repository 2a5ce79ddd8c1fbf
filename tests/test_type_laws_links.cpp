// PROGRAM: tests_types
// The law suite on links with one joint: revolute, prismatic, fixed.
#include "catch.hpp"
#include "type_laws.hpp"

using namespace iim;
using namespace iim::test;

TEST_CASE("Revolute, prismatic and fixed links obey the laws")
{
  Random random(91);
  obeys_the_laws("revolute", RevoluteLink<double>{{random.unit()}, random.body()});
  obeys_the_laws("prismatic", PrismaticLink<double>{{random.unit()}, random.body()});
  obeys_the_laws("fixed", FixedLink<double>{{}, random.body()});
}
