// PROGRAM: tests_types
// The law suite on links with joints of three coordinates.
#include "catch.hpp"
#include "type_laws.hpp"

#include <iim/subsystem/joint_more.hpp>

using namespace iim;
using namespace iim::test;

TEST_CASE("Links on planar and spherical joints obey the laws")
{
  Random random(95);
  const Vec3 axis = random.unit();
  obeys_the_laws("planar", PlanarLink<double>{{axis, axis.cross(random.unit()).normalized()}, random.body()});
  SphericalLink<double> ball;
  ball.body = random.body();
  obeys_the_laws("spherical", ball);
}
