// REQUIRES: urdf
// PROGRAM: tests_methods
// Motors of a URDF robot: from <transmission> in its dialects, from a side argument, and what a contained rotor is
// worth.
#include "catch.hpp"

#include <iim/iim.hpp>
#include <iim/urdf.hpp>

#include <limits>
#include <string>
#include <variant>

namespace test_urdf_motors {

using namespace iim;

namespace {

constexpr double eps = std::numeric_limits<double>::epsilon();

const std::string body =
    "<inertial><mass value='2'/><inertia ixx='0.01' ixy='0' ixz='0' iyy='0.02' iyz='0' izz='0.025'/></inertial>";

/// base – a – b; joint j1 about z, joint j2 of the given type about y, its axes turned by 90° about x against a's.
std::string arm(const std::string& more, const std::string& type = "continuous")
{
  return "<robot name='r'><link name='base'/><link name='a'>" + body + "</link><link name='b'>" + body +
         "</link><joint name='j1' type='continuous'><parent link='base'/><child link='a'/><axis xyz='0 0 1'/></joint>"
         "<joint name='j2' type='" +
         type +
         "'><origin xyz='0.5 0 0' rpy='1.5707963267948966 0 0'/><parent link='a'/>"
         "<child link='b'/><axis xyz='0 1 0'/><limit lower='0' upper='1' effort='1' velocity='1'/></joint>" +
         more + "</robot>";
}

template <class T>
const T& part(const UrdfRobot<double>& r, const std::string& name)
{
  for (const auto& p : r.assembly.parts()) {
    if (p.name == name) {
      REQUIRE(std::holds_alternative<T>(p.part));
      return std::get<T>(p.part);
    }
  }
  throw ModelError("no part " + name);
}

/// The motor of link b.
Motor<double> motor_of(const std::string& transmission)
{
  const auto r = parse_urdf<double>(arm(transmission));
  CHECK(r.tree().n_motors() == 2);
  return part<MotorArm<double>>(r, "b").motor;
}

}  // namespace

TEST_CASE("a transmission gives gear ratio, rotor inertia and rotor axis")
{
  const Motor<double> motor = motor_of(
      "<transmission name='t'><type>transmission_interface/SimpleTransmission</type><joint name='j2'/><actuator "
      "name='m'>"
      "<mechanicalReduction> 80 </mechanicalReduction><rotorInertia>1.5e-5</rotorInertia><rotorAxis xyz='0 0.6 -0.8'/>"
      "</actuator></transmission>");
  CHECK(motor.gear_ratio == 80);
  CHECK(motor.axial_inertia == 1.5e-5);
  CHECK((motor.axis - Vector3<double>(0, 0.6, -0.8)).norm() <= eps);
  CHECK(motor.mass == 0);
  CHECK_FALSE(motor.armature);
}

TEST_CASE("the rotor is coaxial with its joint where nothing else is said")
{
  const Motor<double> motor = motor_of(
      "<transmission name='t'><joint name='j2'/><actuator name='m'>"
      "<mechanicalReduction>-50</mechanicalReduction></actuator></transmission>");
  CHECK(motor.gear_ratio == -50);
  CHECK(motor.axial_inertia == 0);
  CHECK(motor.axis == Vector3<double>::UnitY());
}

TEST_CASE("the reduction may stand in any of its dialects")
{
  const auto ratio = [](const std::string& inside) {
    return motor_of("<transmission name='t'>" + inside + "</transmission>").gear_ratio;
  };
  CHECK(ratio("<joint name='j2'/><actuator name='m'/><mechanicalReduction>3</mechanicalReduction>") == 3);
  CHECK(ratio("<joint name='j2'><mechanical_reduction>4</mechanical_reduction></joint><actuator name='m'/>") == 4);
  CHECK(ratio("<joint name='j2'/><actuator name='m'><drake:gear_ratio value='5'/></actuator>") == 5);
  CHECK(ratio("<joint name='j2'/><actuator name='m'><mechanicalReduction>6</mechanicalReduction></actuator>"
              "<mechanicalReduction>6</mechanicalReduction>") == 6);
  const auto drake = motor_of(
      "<transmission name='t'><joint name='j2'/><actuator name='m'>"
      "<drake:gear_ratio value='5'/><drake:rotor_inertia value='2e-5'/></actuator></transmission>");
  CHECK(drake.axial_inertia == 2e-5);
  CHECK(motor_of("<ros2_control name='c' type='system'><transmission name='t'><joint name='j2'/><actuator name='m'>"
                 "<mechanical_reduction>7</mechanical_reduction></actuator></transmission></ros2_control>")
            .gear_ratio == 7);
}

TEST_CASE("a motor without gear and rotor is a torque on the joint")
{
  const std::string direct =
      "<transmission name='t'><joint name='j2'/><actuator name='m'>"
      "<mechanicalReduction>1</mechanicalReduction></actuator></transmission>";
  CHECK_NOTHROW(part<RevoluteLink<double>>(parse_urdf<double>(arm(direct)), "b"));
}

TEST_CASE("transmissions that no single moving joint has are left out with a warning")
{
  const auto warnings_of = [](const UrdfRobot<double>& r, Index motors) {
    CHECK(r.tree().n_motors() == motors);
    return r.warnings;
  };
  const auto differential = warnings_of(
      parse_urdf<double>(arm("<transmission name='wrist'><joint name='j1'/><joint name='j2'/></transmission>")), 2);
  REQUIRE(differential.size() == 1);
  CHECK(differential[0].find("'wrist': names 2 joints") != std::string::npos);

  const auto none = warnings_of(parse_urdf<double>(arm("<transmission name='gripper'/>")), 2);
  REQUIRE(none.size() == 1);
  CHECK(none[0].find("'gripper': names 0 joints") != std::string::npos);

  const auto absent =
      warnings_of(parse_urdf<double>(arm("<transmission name='cut'><joint name='ghost'/></transmission>")), 2);
  REQUIRE(absent.size() == 1);
  CHECK(absent[0].find("'cut': there is no joint 'ghost'") != std::string::npos);

  const std::string rotor =
      "<transmission name='t'><joint name='j2'/><actuator "
      "name='m'><rotorInertia>1e-5</rotorInertia></actuator></transmission>";
  const auto fixed = warnings_of(parse_urdf<double>(arm(rotor, "fixed")), 1);
  REQUIRE(fixed.size() == 1);
  CHECK(fixed[0].find("joint 'j2'") != std::string::npos);
  CHECK(parse_urdf<double>(arm(rotor)).warnings.empty());
}

TEST_CASE("the user's motors take the place of the file's")
{
  const std::string geared =
      "<transmission name='t'><joint name='j2'/><actuator name='m'>"
      "<mechanicalReduction>80</mechanicalReduction></actuator></transmission>";
  UrdfOptions<double> options;
  UrdfMotor<double>& given = options.motors["j2"];
  given.gear_ratio = 100;
  given.axial_inertia = 1e-5;
  given.axis = Vector3<double>::UnitX();
  given.mass = 0.2;
  given.com = {0, 0, 0.1};
  given.transverse_inertia = 2e-5;
  given.armature = true;
  const Motor<double> motor = part<MotorArm<double>>(parse_urdf<double>(arm(geared), options), "b").motor;
  CHECK(motor.gear_ratio == 100);
  CHECK(motor.axial_inertia == 1e-5);
  CHECK(motor.axis == Vector3<double>::UnitX());
  CHECK(motor.mass == 0.2);
  CHECK(motor.com == given.com);
  CHECK(motor.transverse_inertia == 2e-5);
  CHECK(motor.armature);

  const auto slider = parse_urdf<double>(arm("", "prismatic"), options);
  CHECK(part<LinearMotorArm<double>>(slider, "b").motor.gear_ratio == 100);

  UrdfOptions<double> none;
  none.transmissions = false;
  CHECK_NOTHROW(part<RevoluteLink<double>>(parse_urdf<double>(arm(geared), none), "b"));
}

TEST_CASE("a rotor that the links contain is taken out of the link that carries it")
{
  UrdfOptions<double> options;
  options.motors["j1"].axial_inertia = 3e-4;  // on the world: nothing to take out
  options.motors["j2"].axial_inertia = 1e-4;  // about y of j2, which is z of a
  options.rotors_in_links = true;
  const auto r = parse_urdf<double>(arm(""), options);
  const Matrix3<double> left = part<MotorArm<double>>(r, "a").body.inertia;
  const Vector3<double> expected(0.01, 0.02, 0.025 - 1e-4);
  CHECK((left - Matrix3<double>(expected.asDiagonal())).cwiseAbs().maxCoeff() <= eps * 0.025);
  CHECK(part<MotorArm<double>>(r, "b").body.inertia.diagonal() == Vector3<double>(0.01, 0.02, 0.025));

  options.motors["j2"].armature = true;  // brings no axial inertia along
  const auto armature = parse_urdf<double>(arm(""), options);
  CHECK(part<MotorArm<double>>(armature, "a").body.inertia.diagonal() == Vector3<double>(0.01, 0.02, 0.025));
}

TEST_CASE("all options hold for a robot in float, which is read in double")
{
  UrdfOptions<float> options;
  options.at = {Matrix3<float>::Identity(), {1, 2, 3}};
  options.frames.push_back({"tool", "b", {Matrix3<float>::Identity(), {0, 0, 0.5F}}});
  options.rotors_in_links = true;
  UrdfMotor<float>& given = options.motors["j2"];
  given.gear_ratio = 100;
  given.axial_inertia = 1e-4F;
  given.axis = Vector3<float>::UnitX();
  options.motors["j1"] = {.gear_ratio = 5,
                          .axial_inertia = 1e-3F,
                          .mass = 0.2F,
                          .com = {0, 0, 0.25F},
                          .transverse_inertia = 2e-3F,
                          .armature = true};
  const auto r = parse_urdf<float>(arm(""), options);
  REQUIRE(r.assembly.parts().size() == 2);
  const auto& a = std::get<MotorArm<float>>(r.assembly.parts()[0].part);
  const auto& b = std::get<MotorArm<float>>(r.assembly.parts()[1].part);
  CHECK(r.assembly.parts()[0].on.p == options.at.p);
  CHECK(r.assembly.named_frames().back().on.p.z() == 0.5F);
  CHECK(a.motor.gear_ratio == 5);
  CHECK(a.motor.mass == 0.2F);
  CHECK(a.motor.com.z() == 0.25F);
  CHECK(a.motor.transverse_inertia == 2e-3F);
  CHECK(a.motor.armature);
  CHECK(b.motor.gear_ratio == 100);
  CHECK(b.motor.axis == Vector3<float>::UnitX());
  CHECK(a.body.inertia(0, 0) == static_cast<float>(0.01 - static_cast<double>(1e-4F)));  // x of j2 is x of a
}

}  // namespace test_urdf_motors
