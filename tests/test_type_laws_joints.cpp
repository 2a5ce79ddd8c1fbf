// PROGRAM: tests_types
// The law suite on links with joints of one and two coordinates.
#include "catch.hpp"
#include "type_laws.hpp"

#include <iim/subsystem/joint_more.hpp>

using namespace iim;
using namespace iim::test;

TEST_CASE("Links on helical, cylindrical and universal joints obey the laws")
{
  Random random(94);
  const Vec3 axis = random.unit(), other = random.unit();
  obeys_the_laws("helical", HelicalLink<double>{{axis, 0.2}, random.body()});
  obeys_the_laws("cylindrical", CylindricalLink<double>{{axis}, random.body()});
  obeys_the_laws("universal", UniversalLink<double>{{axis, other}, random.body()});
}
