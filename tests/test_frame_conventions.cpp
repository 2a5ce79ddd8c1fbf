// PROGRAM: tests_several
// The frames that the accuracy report compares with: the same q̈₀ and B̂ as the library's in each of them.
#include "../bench/accuracy/frame_conventions.hpp"

#include <catch.hpp>

#include <limits>

namespace test_frame_conventions {

using namespace bench;

namespace {

/// Revolute, prismatic and geared, oblique everywhere, on a floating base.
iim::StandardAssembly<double> robot()
{
  using Vec3 = iim::Vector3<double>;
  const auto link = iim::models::link<double>();
  iim::StandardAssembly<double> parts;
  iim::FloatingBase<double> base;
  base.body = link.body;
  base.body.com = Vec3(0.1, -0.2, 0.3);
  parts.add("base", {}, base);
  iim::Attachment<double> on;
  on.parent = "base";
  on.p = Vec3(1, 2, 3);
  on.R = Eigen::AngleAxisd(0.3, Vec3(1, 2, 3).normalized()).toRotationMatrix();
  auto turning = link;
  turning.joint.axis = Vec3(1, -1, 2).normalized();
  parts.add("turning", on, turning);
  iim::PrismaticLink<double> sliding;
  sliding.joint.axis = Vec3(2, -1, 2).normalized();
  sliding.body = link.body;
  on.parent = "turning";
  parts.add("sliding", on, sliding);
  iim::MotorArm<double> arm;
  arm.body = link.body;
  arm.joint.axis = Vec3(0, 0.6, 0.8);
  arm.motor.gear_ratio = 20;
  arm.motor.axial_inertia = 0.01;
  arm.motor.axis = Vec3(0.6, 0, 0.8);
  on.parent = "sliding";
  parts.add("arm", on, arm);
  arm.motor.armature = true;
  on.parent = "turning";
  parts.add("other arm", on, arm);
  return parts;
}

template <Frames frames, iim::Update update>
void agrees(const char* name)
{
  INFO(name << ", states from seed 5");
  const Tree<double> tree(robot());
  iim::Inputs<Tree<double>> inputs(tree);
  for (const char* point : {"base", "arm", "other arm"}) {
    inputs.add_force(point, iim::Vector3<double>(0.1, 0.2, -0.3));
  }
  iim::Workspace<Tree<double>> workspace(tree);
  iim::ImplicitInversion<Tree<double>> method(tree, inputs);
  FrameConvention<double, frames, update> other(tree, inputs);
  // A dozen roundings in each of five joints; q̈₀ is the difference of accelerations that are several times larger.
  // Inertias about a common origin hold m r² beside m l², (r/l)² ≈ 10 here.
  const double tolerance = (frames == Frames::common_origin ? 4000 : 400) * std::numeric_limits<double>::epsilon();
  for (const State<double>& x : random_states(tree, 0, 10, 5)) {
    const auto a = method(iim::forward_dynamics(x.q, x.qd, workspace));
    const auto b = other(x.q, x.qd);
    REQUIRE(a.ok());
    REQUIRE(b.ok());
    CHECK((b.Bhat - a.Bhat).norm() <= tolerance * a.Bhat.norm());
    CHECK((b.qdd0 - a.qdd0).norm() <= tolerance * a.qdd0.norm());
  }
}

}  // namespace

TEST_CASE("articulated bodies in other frames")
{
  agrees<Frames::body_fixed, iim::Update::printed>("body-fixed, printed");
  agrees<Frames::body_fixed, iim::Update::projected>("body-fixed, projected");
  agrees<Frames::own_origin, iim::Update::projected>("own origin, projected");
  agrees<Frames::common_origin, iim::Update::printed>("common origin, printed");
  agrees<Frames::common_origin, iim::Update::projected>("common origin, projected");
  agrees<Frames::body_fixed, iim::Update::square_root>("body-fixed, square root");
  agrees<Frames::own_origin, iim::Update::square_root>("own origin, square root");
  agrees<Frames::common_origin, iim::Update::square_root>("common origin, square root");
}

}  // namespace test_frame_conventions
