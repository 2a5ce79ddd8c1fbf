// PROGRAM: tests_extreme
// Numbers too small for a full mantissa take a processor a hundred times as long: none come from what a robot's file
// rounds.
#include "catch.hpp"
#include "random_tree.hpp"

#include <iim/iim.hpp>

#include <cfenv>
#include <string>

namespace test_subnormal {

using namespace iim;

TEST_CASE("quarter turns between links leave nothing subnormal in float")
{
  // cos π/2 is 6e-17 in double: where two of them meet an inertia of a gram or two, float has no full mantissa for it.
  const double quarter = EIGEN_PI / 2;
  test::Random random(1);
  Assembly<RevoluteLink<double>> assembly;
  std::string parent = "world";
  for (int k = 0; k < 12; ++k) {
    RevoluteLink<double> link{{test::Vec3::UnitZ()}, {}};
    link.body.mass = 0.1;
    link.body.com = {0, 0, 0.05};
    link.body.inertia = (test::Vec3(1.1, 1.2, 0.3) * 1e-4).asDiagonal();
    const test::Mat3 R = Eigen::AngleAxisd(k % 2 ? quarter : -quarter, test::Vec3::Unit(k % 3)).toRotationMatrix();
    assembly.add("link" + std::to_string(k), {parent, R, {0, 0, 0.1}}, link);
    parent = "link" + std::to_string(k);
  }
  const DynamicTree tree(assembly.cast<float>());
  CHECK((tree.placement(1).R.array() == 0).count() == 6);
  Workspace ws(tree);
  int underflows = 0;
  for (int k = 0; k < 20; ++k) {
    const test::RandomState state = test::random_state(DynamicTree(assembly), 0, random);
    const Eigen::VectorXf q = state.q.cast<float>(), qd = state.qd.cast<float>();
    std::feclearexcept(FE_ALL_EXCEPT);
    const auto fd = forward_dynamics(q, qd, ws);
    underflows += std::fetestexcept(FE_UNDERFLOW) != 0;
    REQUIRE(fd.ok());
  }
  CHECK(underflows <= 2);  // where roundings meet by chance; of quarter turns as they are all 20
}

}  // namespace test_subnormal
