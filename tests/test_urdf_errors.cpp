// REQUIRES: urdf
// PROGRAM: tests_methods
// What is wrong with a URDF file is said with its line, the item and the value, and only there: nothing on stderr.
#include "catch.hpp"

#include <iim/urdf.hpp>

#include <console_bridge/console.h>

#include <string>
#include <vector>

namespace test_urdf_errors {

using namespace iim;

namespace {

struct Wrong {
  const char* what;
  std::string text;
  std::vector<std::string> says;
  UrdfOptions<double> options{};
};

const std::string body =
    "<inertial><mass value='2'/><inertia ixx='0.01' ixy='0' ixz='0' iyy='0.02' iyz='0' izz='0.025'/></inertial>";

/// Line 1 <robot>, 2 link base, 3 link a with `inertial`, 4 joint j; `more` from line 5.
std::string robot_xml(const std::string& joint_type, const std::string& inside = "", const std::string& more = "",
                      const std::string& inertial = body)
{
  return "<robot name='r'>\n<link name='base'/>\n<link name='a'>" + inertial + "</link>\n<joint name='j' type='" +
         joint_type + "'><parent link='base'/><child link='a'/>" + inside + "</joint>\n" + more + "</robot>\n";
}

std::string inertial_xml(const std::string& mass, const std::string& moments)
{
  return "<inertial><mass value='" + mass + "'/><inertia " + moments + "/></inertial>";
}

std::string transmission_xml(const std::string& inside)
{
  return "\n<transmission name='t'>" + inside + "</transmission>\n";
}

UrdfOptions<double> with_motor(const std::string& joint, const UrdfMotor<double>& motor)
{
  UrdfOptions<double> options;
  options.motors[joint] = motor;
  return options;
}

UrdfOptions<double> with(Base base)
{
  UrdfOptions<double> options;
  options.base = base;
  return options;
}

std::string message_of(const Wrong& wrong)
{
  try {
    static_cast<void>(parse_urdf<double>(wrong.text, wrong.options, "r.urdf").tree());
  } catch (const ModelError& error) {
    return error.what();
  }
  return "no error";
}

void check(const std::vector<Wrong>& cases)
{
  for (const Wrong& wrong : cases) {
    const std::string message = message_of(wrong);
    for (const std::string& says : wrong.says) {
      INFO(wrong.what << ": «" << message << "» lacks «" << says << "»");
      CHECK(message.find(says) != std::string::npos);
    }
  }
}

const std::string moments = "ixx='0.01' ixy='0' ixz='0' iyy='0.02' iyz='0' izz='0.025'";
const std::string link_b = "<link name='b'/>\n";

}  // namespace

TEST_CASE("the text to compare with is right")
{
  CHECK(message_of({"", robot_xml("continuous"), {}}) == "no error");
  CHECK(message_of({"", robot_xml("continuous", "", transmission_xml("<joint name='j'/>")), {}}) == "no error");
}

TEST_CASE("files that are no URDF")
{
  check({{"empty", "", {"r.urdf", "not"}},
         {"prose", "a robot", {"r.urdf", "not"}},
         {"cut off", "<robot name='r'>\n<link name='a'>\n", {"r.urdf:", "not an XML file"}},
         {"other root", "<sdf version='1.6'/>", {"r.urdf: not a URDF file", "<sdf>", "<robot>"}},
         {"unexpanded", robot_xml("continuous", "", "<xacro:leg side='left'/>"), {"r.urdf:5", "xacro:leg"}},
         {"no name", "<robot><link name='a'/></robot>", {"r.urdf:1: robot ''", "name"}},
         {"no links", "<robot name='r'/>", {"r.urdf", "link"}},
         {"two roots", "<robot name='r'>\n<link name='a'/>\n<link name='b'/></robot>", {"r.urdf:", "link 'a'", "[b]"}},
         {"no limits", robot_xml("revolute"), {"r.urdf:", "joint 'j'"}},
         {"malformed", robot_xml("continuous", "<origin xyz='0 0'/>"), {"r.urdf:", "joint 'j'", "origin"}},
         {"two axes",
          robot_xml("continuous", "<axis xyz='1 0 0'/>\n<axis xyz='0 0 1'/>"),
          {"r.urdf:", "joint 'j': <axis> is given twice, again in line"}},
         {"two inertials",
          "<robot name='r'>\n<link name='a'>\n<inertial/>\n<inertial/>\n</link></robot>",
          {"r.urdf:2: link 'a': <inertial> is given twice, again in line 4"}},
         {"quaternion",
          robot_xml("continuous", "<origin quat_xyzw='0 0 0.6 0.8'/>"),
          {"r.urdf:", "joint 'j': <origin quat_xyzw>", "rpy"}},
         {"quaternion of an inertial",
          "<robot name='r'>\n<link name='a'><inertial><origin quat_xyzw='0 0 0.6 0.8'/><mass value='1'/>"
          "<inertia ixx='1' ixy='0' ixz='0' iyy='1' iyz='0' izz='1'/></inertial></link></robot>",
          {"r.urdf:2: link 'a': <origin quat_xyzw>"}},
         {"version", "<robot name='r' version='9.0'><link name='a'/></robot>", {"r.urdf", "version"}}});
}

TEST_CASE("joints that a tree cannot have")
{
  const std::string second = "<joint name='k' type='continuous'><parent link='b'/><child link='a'/></joint>\n";
  const std::string loop =
      "<link name='c'/>\n<joint name='k' type='fixed'><parent link='b'/><child link='c'/></joint>\n"
      "<joint name='l' type='fixed'><parent link='c'/><child link='b'/></joint>\n";
  check(
      {{"unknown type", robot_xml("ball"), {"r.urdf:4", "joint 'j'", "unknown type 'ball'"}},
       {"no type",
        "<robot name='r'>\n<link name='a'/>\n<joint name='j'/></robot>",
        {"r.urdf:3", "joint 'j'", "type ''"}},
       {"planar", robot_xml("planar"), {"r.urdf:4", "joint 'j'", "planar"}},
       {"mimic", robot_xml("continuous", "<mimic joint='other'/>"), {"r.urdf:4", "joint 'j'", "mimics joint 'other'"}},
       {"two parents",
        robot_xml("continuous", "", link_b + second),
        {"r.urdf:6", "joint 'k'", "link 'a'", "joint 'j'"}},
       {"loop aside", robot_xml("continuous", "", link_b + loop), {"loop", "r.urdf:"}},
       {"loop of one",
        "<robot name='r'>\n<link name='a'/>\n<joint name='j' type='fixed'><parent link='a'/><child "
        "link='a'/></joint></robot>",
        {"r.urdf:3", "loop", "'a'"}},
       {"two roots", robot_xml("continuous", "", link_b), {"r.urdf", "[b]", "[base]"}},
       {"absent child",
        "<robot name='r'>\n<link name='a'/>\n<joint name='j' type='fixed'><parent link='a'/><child "
        "link='ghost'/></joint></robot>",
        {"r.urdf:3", "joint 'j'", "ghost"}},
       {"absent parent",
        "<robot name='r'>\n<link name='a'/>\n<joint name='j' type='fixed'><parent link='ghost'/><child "
        "link='a'/></joint></robot>",
        {"r.urdf:3", "joint 'j'", "ghost"}},
       {"no child",
        "<robot name='r'>\n<link name='a'/>\n<joint name='j' type='fixed'><parent link='a'/></joint></robot>",
        {"r.urdf:3", "joint 'j'", "<child link> is missing"}},
       {"no parent",
        "<robot name='r'>\n<link name='a'/>\n<joint name='j' type='fixed'><child link='a'/></joint></robot>",
        {"r.urdf:3", "joint 'j'", "<parent link> is missing"}},
       {"link twice", robot_xml("continuous", "", "<link name='a'/>"), {"r.urdf:5", "link 'a'", "line 3"}},
       {"joint twice",
        robot_xml("continuous", "",
                  link_b + "<joint name='j' type='fixed'><parent link='a'/><child link='b'/></joint>"),
        {"r.urdf:6", "joint 'j'", "line 4"}},
       {"axis", robot_xml("continuous", "<axis xyz='0 0 2'/>"), {"r.urdf:4", "joint 'j'", "axis", "(0, 0, 2)"}},
       {"no axis", robot_xml("continuous", "<axis xyz='0 0 0'/>"), {"r.urdf:4", "joint 'j'", "axis", "(0, 0, 0)"}},
       {"axis of two", robot_xml("continuous", "<axis xyz='0 1'/>"), {"r.urdf", "0 1"}},
       {"origin", robot_xml("continuous", "<origin xyz='0 zero 0'/>"), {"r.urdf", "zero"}},
       {"origin not finite", robot_xml("continuous", "<origin xyz='0 inf 0'/>"), {"r.urdf", "inf"}},
       {"no limits", robot_xml("revolute"), {"r.urdf", "[j]", "limit"}},
       {"nothing moves", robot_xml("fixed"), {"r.urdf", "'r'", "no joint", "Base::floating"}}});
}

TEST_CASE("bodies that cannot exist")
{
  const auto with_inertial = [](const std::string& mass, const std::string& inertia) {
    return robot_xml("continuous", "", "", inertial_xml(mass, inertia));
  };
  check({{"negative mass", with_inertial("-1.5", moments), {"r.urdf:3", "link 'a'", "mass", "-1.5"}},
         {"zero mass", with_inertial("0", moments), {"r.urdf:3", "link 'a'", "mass", "got 0"}},
         {"mass not finite", with_inertial("inf", moments), {"r.urdf:3", "link 'a'", "mass", "'inf'"}},
         {"mass no number", with_inertial("heavy", moments), {"r.urdf:3", "link 'a'", "mass", "'heavy'"}},
         {"mass with unit", with_inertial("1kg", moments), {"r.urdf:3", "link 'a'", "mass", "'1kg'"}},
         {"negative moment",
          with_inertial("1", "ixx='-0.01' ixy='0' ixz='0' iyy='0.02' iyz='0' izz='0.02'"),
          {"r.urdf:3", "link 'a'", "inertia", "-0.01"}},
         {"half an inertia", with_inertial("1", "ixx='0.01'"), {"r.urdf:3", "link 'a'", "inertia ixy"}},
         {"no inertia",
          robot_xml("continuous", "", "", "<inertial><mass value='1'/></inertial>"),
          {"r.urdf:3", "link 'a'", "<inertial> without <inertia>"}},
         {"no mass",
          robot_xml("continuous", "", "", "<inertial><inertia " + moments + "/></inertial>"),
          {"r.urdf:3", "link 'a'", "<inertial> without <mass>"}},
         {"centre of two",
          robot_xml("continuous", "", "",
                    "<inertial><origin xyz='0 1'/><mass value='1'/><inertia " + moments + "/></inertial>"),
          {"r.urdf:3", "link 'a'", "origin xyz", "'0 1'"}},
         {"merged flaw is no better",
          robot_xml("continuous", "",
                    "<link name='lid'>" + inertial_xml("1e-3", "ixx='1' ixy='0' ixz='0' iyy='1' iyz='0' izz='-9'") +
                        "</link>\n<joint name='f' type='fixed'><parent link='a'/><child link='lid'/></joint>\n"),
          {"r.urdf:5", "link 'lid'", "inertia", "-9"}}});
}

TEST_CASE("bases and names that do not go")
{
  const std::string world_child =
      "<robot name='r'>\n<link name='base'/>\n<link name='world'>" + body +
      "</link>\n<joint name='j' type='continuous'><parent link='base'/><child link='world'/></joint>\n</robot>";
  const std::string world_root =
      "<robot name='r'>\n<link name='world'/>\n<link name='a'>" + body +
      "</link>\n<joint name='j' type='continuous'><parent link='world'/><child link='a'/></joint>\n</robot>";
  UrdfOptions<double> lost;
  lost.frames.push_back({"sole", "foot", {}});
  UrdfOptions<double> taken;
  taken.frames.push_back({"a", "a", {}});
  check({{"world inside", world_child, {"r.urdf:3", "'world'"}},
         {"world as free root", world_root, {"r.urdf:2", "'world'", "Base::floating"}, with(Base::floating)},
         {"frame on nothing", robot_xml("continuous"), {"frame 'sole'", "r.urdf", "'foot'"}, lost},
         {"frame twice", robot_xml("continuous"), {"'a'", "twice"}, taken}});
}

TEST_CASE("motors that do not go")
{
  const auto with_transmission = [](const std::string& inside) {
    return robot_xml("continuous", "", transmission_xml(inside));
  };
  const std::string actuator = "<joint name='j'/><actuator name='m'>";
  const std::string ratio_0 = actuator + "<mechanicalReduction>0</mechanicalReduction></actuator>";
  const std::string ratio_text = actuator + "<mechanicalReduction>1:50</mechanicalReduction></actuator>";
  const std::string ratios = actuator +
                             "<mechanicalReduction>50</mechanicalReduction></actuator><mechanicalReduction>"
                             "60</mechanicalReduction>";
  const std::string inertia = actuator + "<rotorInertia>-1e-5</rotorInertia></actuator>";
  const std::string axis = actuator + "<rotorAxis xyz='1 1 0'/></actuator>";
  UrdfMotor<double> heavy;
  heavy.mass = -0.5;
  UrdfMotor<double> skew_axis;
  skew_axis.axis = Vector3<double>(0, 3, 0);
  skew_axis.axial_inertia = 1e-5;
  UrdfMotor<double> large;
  large.axial_inertia = 1;
  UrdfOptions<double> contained = with_motor("k", large);
  contained.rotors_in_links = true;
  UrdfMotor<double> massive = large;
  massive.mass = 0.1;
  UrdfOptions<double> twice = with_motor("k", massive);
  twice.rotors_in_links = true;
  UrdfOptions<double> fixed_motor = with_motor("j", {});
  fixed_motor.base = Base::floating;
  const std::string chain =
      robot_xml("continuous", "",
                "<link name='b'>" + body +
                    "</link>\n<joint name='k' type='continuous'><parent link='a'/><child link='b'/></joint>\n");
  check(
      {{"zero ratio", with_transmission(ratio_0), {"r.urdf:6", "transmission 't'", "mechanicalReduction", "got 0"}},
       {"ratio no number", with_transmission(ratio_text), {"r.urdf:6", "transmission 't'", "1:50"}},
       {"attribute and text",
        with_transmission(actuator + "<mechanicalReduction value='5'>6</mechanicalReduction></actuator>"),
        {"r.urdf:6", "transmission 't'", "'5'", "'6'"}},
       {"two ratios", with_transmission(ratios), {"r.urdf:6", "transmission 't'", "'50'", "'60'"}},
       {"negative inertia", with_transmission(inertia), {"r.urdf:6", "transmission 't'", "rotorInertia", "-1e-5"}},
       {"rotor axis", with_transmission(axis), {"r.urdf:6", "transmission 't'", "rotorAxis", "(1, 1, 0)"}},
       {"rotor of no joint",
        with_transmission("<rotorInertia>1e-5</rotorInertia>"),
        {"r.urdf:6", "transmission 't'", "names 0"}},
       {"rotor of two joints",
        with_transmission(
            "<joint name='j'/><joint name='k'/><actuator name='m'><rotorInertia>1e-5</rotorInertia></actuator>"),
        {"r.urdf:6", "transmission 't'", "names 2", "a rotor needs one"}},
       {"rotor of an absent joint",
        with_transmission("<joint name='ghost'/><rotorInertia>1e-5</rotorInertia>"),
        {"r.urdf:6", "transmission 't'", "'ghost'"}},
       {"two on a joint",
        with_transmission("<joint name='j'/></transmission><transmission name='t2'><joint name='j'/>"),
        {"r.urdf:6", "transmission 't2'", "joint 'j'"}},
       {"motor of a fixed joint", robot_xml("fixed"), {"r.urdf:4", "joint 'j'", "fixed"}, fixed_motor},
       {"motor of a floating joint", robot_xml("floating"), {"r.urdf:4", "joint 'j'", "floating"}, with_motor("j", {})},
       {"motor of no joint", robot_xml("continuous"), {"r.urdf", "'ghost'"}, with_motor("ghost", {})},
       {"negative rotor mass", robot_xml("continuous"), {"r.urdf:4", "joint 'j'", "-0.5"}, with_motor("j", heavy)},
       {"motor's axis", robot_xml("continuous"), {"r.urdf:4", "joint 'j'", "(0, 3, 0)"}, with_motor("j", skew_axis)},
       {"rotor larger than its link", chain, {"r.urdf:6", "joint 'k'", "link 'a' without the rotor"}, contained},
       {"rotor counted twice", chain, {"r.urdf:6", "joint 'k'", "0.1 kg"}, twice}});
}

TEST_CASE("files that are absent, and files that are there")
{
  CHECK_THROWS_WITH(load_urdf<double>("no/such/robot.urdf"), Catch::Matchers::ContainsSubstring("no/such/robot.urdf"));
  CHECK_THROWS_AS(load_urdf<double>("."), ModelError);
}

namespace {

struct Silent : console_bridge::OutputHandler {
  int heard = 0;
  void log(const std::string&, console_bridge::LogLevel, const char*, int) override { ++heard; }
};

}  // namespace

TEST_CASE("urdfdom's words stay in the exception, and its outlet is given back")
{
  Silent mine;
  console_bridge::useOutputHandler(&mine);
  console_bridge::setLogLevel(console_bridge::CONSOLE_BRIDGE_LOG_DEBUG);
  const std::string message = message_of({"", robot_xml("revolute"), {}});
  CHECK(message.find("[j]") != std::string::npos);
  CHECK(mine.heard == 0);
  CHECK(console_bridge::getOutputHandler() == &mine);
  CHECK(console_bridge::getLogLevel() == console_bridge::CONSOLE_BRIDGE_LOG_DEBUG);
  CONSOLE_BRIDGE_logError("heard");
  CHECK(mine.heard == 1);
  console_bridge::restorePreviousOutputHandler();
}

}  // namespace test_urdf_errors
