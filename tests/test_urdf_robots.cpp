// REQUIRES: urdf
// PROGRAM: tests_methods
// The two robots that come with the library: the biped's file is the biped of iim/models.hpp, the arm has its motors.
#include "catch.hpp"
#include "random_tree.hpp"

#include <iim/iim.hpp>
#include <iim/models.hpp>
#include <iim/urdf.hpp>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <variant>

#ifndef IIM_EXAMPLES_DIR
#define IIM_EXAMPLES_DIR "examples"
#endif

namespace test_urdf_robots {

using namespace iim;

namespace {

constexpr double eps = std::numeric_limits<double>::epsilon();
const std::string robots = IIM_EXAMPLES_DIR "/robots/";

struct Dynamics {
  VectorX<double> qdd0;
  MatrixX<double> Bhat;
};

/// With forces at the given contacts, at a state from a seed.
template <class Contacts>
Dynamics dynamics(const StandardAssembly<double>& assembly, const Contacts& contacts, std::uint64_t seed)
{
  const DynamicTree tree(assembly);
  Inputs inputs(tree);
  for (const char* contact : contacts) { inputs.add_force(contact); }
  test::Random random(seed);
  VectorX<double> q(tree.n_q());
  VectorX<double> qd(tree.n_v());
  for (double& x : q) { x = random.uniform(-1, 1); }
  for (double& x : qd) { x = random.uniform(-2, 2); }
  q.segment<4>(3) = random.quaternion();
  Workspace ws(tree);
  ImplicitInversion method(tree, inputs);
  const auto result = method(forward_dynamics(q, qd, ws));
  REQUIRE(result.ok());
  return {result.qdd0, result.Bhat};
}

}  // namespace

TEST_CASE("the biped's file and the biped of the study are one robot, part by part")
{
  const auto file = load_urdf<double>(robots + "biped.urdf", Base::floating);
  const auto model = models::biped<double>();
  CHECK(file.warnings.empty());
  const auto parts = file.assembly.sorted();
  const auto expected = model.sorted();
  REQUIRE(parts.size() == expected.size());
  for (std::size_t k = 0; k < parts.size(); ++k) {
    INFO(expected[k].name);
    CHECK(parts[k].name == expected[k].name);
    CHECK(parts[k].parent == expected[k].parent);
    CHECK(parts[k].on.R == expected[k].on.R);
    CHECK(parts[k].on.p == expected[k].on.p);
    REQUIRE(parts[k].part.index() == expected[k].part.index());
    const auto same_body = [](const Body<double>& a, const Body<double>& b) {
      CHECK(a.mass == b.mass);
      CHECK(a.com == b.com);
      CHECK(a.inertia == b.inertia);
    };
    if (const auto* arm = std::get_if<MotorArm<double>>(&parts[k].part)) {
      const auto& other = std::get<MotorArm<double>>(expected[k].part);
      same_body(arm->body, other.body);
      CHECK(arm->joint.axis == other.joint.axis);
      CHECK(arm->motor.gear_ratio == other.motor.gear_ratio);
      CHECK(arm->motor.axial_inertia == other.motor.axial_inertia);
      CHECK(arm->motor.axis == other.motor.axis);
    } else {
      same_body(std::get<FloatingBase<double>>(parts[k].part).body,
                std::get<FloatingBase<double>>(expected[k].part).body);
    }
  }
}

// The files' decimals and the model's are the same doubles, so 1e-14, 45 ε, is more than is needed.
TEST_CASE("the biped's file has 20 degrees of freedom, 38 inputs, and the dynamics of the study's biped")
{
  const auto file = load_urdf<double>(robots + "biped.urdf", Base::floating);
  for (const std::uint64_t seed : {11u, 12u, 13u}) {
    INFO("seed " << seed);
    const Dynamics found = dynamics(file.assembly, models::biped_contacts, seed);
    const Dynamics expected = dynamics(models::biped<double>(), models::biped_contacts, seed);
    CHECK(found.Bhat.rows() == 20);
    CHECK(found.Bhat.cols() == 38);
    CHECK((found.Bhat - expected.Bhat).norm() <= 45 * eps * expected.Bhat.norm());
    CHECK((found.qdd0 - expected.qdd0).norm() <= 45 * eps * expected.qdd0.norm());
  }
}

TEST_CASE("the arm's file has seven joints with gears and rotors, and a gripper on the last link")
{
  const auto file = load_urdf<double>(robots + "arm7.urdf");
  const auto tree = file.tree();
  CHECK(file.warnings.empty());
  CHECK(tree.n_v() == 7);
  CHECK(tree.n_motors() == 7);
  for (const UrdfJoint& joint : file.joints) {
    INFO(joint.name);
    tree.visit(tree.index(joint.link), [&]<class S>(const Node&, const S& s) {
      if constexpr (requires { s.motor; }) {
        CHECK(s.motor.gear_ratio >= 50);
        CHECK(s.motor.axial_inertia > 0);
        CHECK(s.motor.axis == (joint.name == "joint6" ? Vector3<double>::UnitY() : Vector3<double>::UnitZ()));
      } else {
        FAIL("no motor");
      }
    });
    CHECK(joint.lower < 0);
    CHECK(joint.upper > 0);
  }
  CHECK(std::abs(tree.frame_mass(tree.node(6).frame).mass - (0.35 + 0.6)) <= 4 * eps);
  CHECK(tree.frame("tool").subsystem == 6);
  CHECK(tree.frame("tool").at.p.isApprox(Vector3<double>(0, 0, 0.15), 4 * eps));
}

}  // namespace test_urdf_robots
