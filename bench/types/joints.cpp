// PART OF: iim_types
// Rigid links on all joints.
#include "measure.hpp"

#include <iim/subsystem/joint_more.hpp>

namespace bench {

std::vector<TypeCost> costs_of_joints(bool quick)
{
  using namespace iim;
  const Vector3<double> axis = Eigen::Vector3d(1, 2, 2) / 3, other = Eigen::Vector3d(2, 1, -2) / 3;
  SphericalLink<double> ball;
  ball.body = box();
  return {
      cost_of("revolute, about a coordinate axis", RevoluteLink<double>{{Eigen::Vector3d::UnitZ()}, box()}, quick),
      cost_of("revolute, any axis", RevoluteLink<double>{{axis}, box()}, quick),
      cost_of("prismatic", PrismaticLink<double>{{axis}, box()}, quick),
      cost_of("helical", HelicalLink<double>{{axis, 0.1}, box()}, quick),
      cost_of("cylindrical", CylindricalLink<double>{{axis}, box()}, quick),
      cost_of("universal", UniversalLink<double>{{axis, other}, box()}, quick),
      cost_of("planar", PlanarLink<double>{{axis, other}, box()}, quick),
      cost_of("spherical", ball, quick),
      cost_of("free", FloatingBase<double>{box()}, quick),
  };
}

}  // namespace bench
