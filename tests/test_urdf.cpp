// REQUIRES: urdf
// PROGRAM: tests_methods
// What a URDF file becomes: joints of every type, merged links, bases, frames. Numbers by hand.
#include "catch.hpp"

#include <iim/iim.hpp>
#include <iim/urdf.hpp>

#include <limits>
#include <numbers>
#include <string>
#include <variant>
#include <vector>

namespace test_urdf {

using namespace iim;

namespace {

constexpr double eps = std::numeric_limits<double>::epsilon();

/// Mass 2, centre at (0.1, 0, 0), diag(0.01, 0.02, 0.025).
const std::string inertial =
    "<inertial><origin xyz='0.1 0 0'/><mass value='2'/>"
    "<inertia ixx='0.01' ixy='0' ixz='0' iyy='0.02' iyz='0' izz='0.025'/></inertial>";

std::string link_xml(const std::string& name, const std::string& inside = inertial)
{
  return "<link name='" + name + "'>" + inside + "</link>\n";
}

std::string joint_xml(const std::string& name, const std::string& type, const std::string& parent,
                      const std::string& child, const std::string& inside = "")
{
  return "<joint name='" + name + "' type='" + type + "'><parent link='" + parent + "'/><child link='" + child + "'/>" +
         inside + "</joint>\n";
}

const std::string limit = "<limit lower='-1' upper='2' effort='30' velocity='4'/>";

std::string robot_xml(const std::string& inside) { return "<robot name='r'>\n" + inside + "</robot>\n"; }

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

const Attachment<double>& attachment(const UrdfRobot<double>& r, const std::string& name)
{
  for (const auto& p : r.assembly.parts()) {
    if (p.name == name) { return p.on; }
  }
  throw ModelError("no part " + name);
}

UrdfOptions<double> with(Base base)
{
  UrdfOptions<double> options;
  options.base = base;
  return options;
}

Vector3<double> vec(double x, double y, double z) { return {x, y, z}; }

}  // namespace

TEST_CASE("joints of every type become subsystems named after their links")
{
  const auto r = parse_urdf<double>(robot_xml(
      link_xml("base") + link_xml("a") + link_xml("b") + link_xml("c") + link_xml("d") +
      joint_xml("turn", "revolute", "base", "a",
                "<origin xyz='1 2 3' rpy='0 0 1.5707963267948966'/><axis xyz='0 0.6 0.8'/>" + limit) +
      joint_xml("spin", "continuous", "a", "b") +
      joint_xml("slide", "prismatic", "b", "c", "<axis xyz='0 -1 0'/><dynamics damping='0.5' friction='3'/>" + limit) +
      joint_xml("fly", "floating", "c", "d", "<origin xyz='0 0 5'/>")));
  const auto tree = r.tree();
  REQUIRE(tree.size() == 4);
  CHECK(tree.n_q() == 3 + 7);
  CHECK(tree.n_v() == 3 + 6);
  CHECK(tree.n_motors() == 3);
  CHECK(r.name == "r");
  CHECK(r.warnings.empty());

  CHECK(part<RevoluteLink<double>>(r, "a").joint.axis == vec(0, 0.6, 0.8));
  CHECK(part<RevoluteLink<double>>(r, "b").joint.axis == vec(1, 0, 0));  // URDF's axis where none is given
  CHECK(part<PrismaticLink<double>>(r, "c").joint.axis == vec(0, -1, 0));
  CHECK(part<FloatingBase<double>>(r, "d").body.mass == 2);
  CHECK(attachment(r, "a").parent == "world");
  CHECK(attachment(r, "a").p == vec(1, 2, 3));
  Matrix3<double> quarter;
  quarter << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  CHECK((attachment(r, "a").R - quarter).cwiseAbs().maxCoeff() <= 4 * eps);  // half angles and their sines: an ε each
  CHECK(attachment(r, "d").parent == "c");
  CHECK(attachment(r, "d").p == vec(0, 0, 5));

  REQUIRE(r.joints.size() == 4);
  CHECK(r.joints[0].name == "turn");
  CHECK(r.joint("slide").link == "c");
  CHECK(r.joint("turn").lower == -1);
  CHECK(r.joint("turn").upper == 2);
  CHECK(r.joint("turn").effort == 30);
  CHECK(r.joint("turn").velocity == 4);
  CHECK(r.joint("turn").damping == 0);
  CHECK(r.joint("slide").damping == 0.5);
  CHECK(r.joint("slide").friction == 3);
  CHECK(r.joint("spin").upper == std::numeric_limits<double>::infinity());
  CHECK(r.node(tree, "slide").q == 2);
  CHECK(r.node(tree, "fly").v == 3);
  CHECK_THROWS_AS(r.joint("a"), ModelError);
}

TEST_CASE("coordinates are depth first, brothers in the order of their joints' names")
{
  const auto r = parse_urdf<double>(
      robot_xml(joint_xml("j2", "continuous", "base", "z") + joint_xml("j9", "continuous", "y", "tip") +
                joint_xml("j1", "fixed", "base", "mid") + joint_xml("j3", "continuous", "mid", "y") + link_xml("tip") +
                link_xml("y") + link_xml("z") + link_xml("mid") + link_xml("base")));
  const auto tree = r.tree();
  REQUIRE(tree.size() == 3);
  CHECK(tree.name(0) == "y");
  CHECK(tree.name(1) == "tip");
  CHECK(tree.name(2) == "z");
  CHECK(r.joints[0].name == "j3");
  CHECK(r.joints[1].name == "j9");
  CHECK(r.joints[2].name == "j2");
}

TEST_CASE("links behind fixed joints are merged and stay as frames")
{
  // Two equal bodies of 2 kg, centres at x = 0.1 and, turned by 90° about z, at (1, 0.1, 0).
  const auto r = parse_urdf<double>(
      robot_xml(link_xml("base") + link_xml("arm") + link_xml("hand") + link_xml("tip", "") +
                joint_xml("j", "continuous", "base", "arm") +
                joint_xml("f1", "fixed", "arm", "hand", "<origin xyz='1 0 0' rpy='0 0 1.5707963267948966'/>") +
                joint_xml("f2", "fixed", "hand", "tip", "<origin xyz='0 0.5 0'/>")));
  const Body<double>& body = part<RevoluteLink<double>>(r, "arm").body;
  CHECK(body.mass == 4);
  CHECK((body.com - vec(0.55, 0.05, 0)).norm() <= 4 * eps);
  // about the common centre: ± d = (0.45, 0.05, 0) each, 2 kg; the second body's x and y moments are exchanged
  Matrix3<double> inertia = vec(0.01 + 0.02, 0.02 + 0.01, 0.025 + 0.025).asDiagonal();
  inertia += 4 * (Matrix3<double>::Identity() * (0.45 * 0.45 + 0.05 * 0.05));
  inertia.topLeftCorner<2, 2>() -=
      4 * (Eigen::Matrix2d() << 0.45 * 0.45, 0.45 * 0.05, 0.45 * 0.05, 0.05 * 0.05).finished();
  CHECK((body.inertia - inertia).cwiseAbs().maxCoeff() <= 8 * eps);

  const auto tree = r.tree();
  REQUIRE(tree.size() == 1);
  CHECK(tree.frame("arm").frame == 0);
  CHECK((tree.frame("hand").at.p - vec(1, 0, 0)).norm() == 0);
  CHECK((tree.frame("tip").at.p - vec(0.5, 0, 0)).norm() <= 4 * eps);
  CHECK((tree.frame("tip").at.R.col(0) - vec(0, 1, 0)).norm() <= 4 * eps);
  CHECK(tree.frame("base").frame == -1);  // the world
  Inputs inputs(tree);
  inputs.add_force("tip");
  CHECK(inputs.columns() == 4);
  CHECK_THROWS_AS(inputs.add_force("base"), ModelError);
}

TEST_CASE("a joint on a merged link hangs on the link that carries it")
{
  const auto r = parse_urdf<double>(
      robot_xml(link_xml("base") + link_xml("a") + link_xml("flange", "") + link_xml("b") +
                joint_xml("j1", "continuous", "base", "a") +
                joint_xml("f", "fixed", "a", "flange", "<origin xyz='0 0 1' rpy='3.141592653589793 0 0'/>") +
                joint_xml("j2", "continuous", "flange", "b", "<origin xyz='0 0.5 0.25'/>")));
  CHECK(attachment(r, "b").parent == "a");
  CHECK((attachment(r, "b").p - vec(0, -0.5, 0.75)).norm() <= 4 * eps);
  CHECK((attachment(r, "b").R.diagonal() - vec(1, -1, -1)).norm() <= 4 * eps);
}

TEST_CASE("the inertial's own axes turn its inertia")
{
  const auto r = parse_urdf<double>(
      robot_xml(link_xml("base", "") + joint_xml("j", "continuous", "base", "a") +
                link_xml("a",
                         "<inertial><origin xyz='0 0 1' rpy='1.5707963267948966 0 0'/><mass value='3'/>"
                         "<inertia ixx='1' ixy='0.1' ixz='0.2' iyy='2' iyz='0.3' izz='2.5'/></inertial>")));
  const Body<double>& body = part<RevoluteLink<double>>(r, "a").body;
  // a quarter turn about x takes y to z and z to −y
  Matrix3<double> inertia;
  inertia << 1, -0.2, 0.1, -0.2, 2.5, -0.3, 0.1, -0.3, 2;
  CHECK((body.inertia - inertia).cwiseAbs().maxCoeff() <= 16 * eps);  // R is off by an ε, twice, times 2.5
  CHECK(body.com == vec(0, 0, 1));
}

TEST_CASE("links without inertia are massless")
{
  const auto r = parse_urdf<double>(robot_xml(
      link_xml("base", "") + joint_xml("j1", "continuous", "base", "a") + joint_xml("j2", "continuous", "a", "b") +
      link_xml("a", "") + link_xml("b") + joint_xml("f", "fixed", "b", "c") +
      link_xml("c",
               "<inertial><mass value='0'/><inertia ixx='0' ixy='0' ixz='0' iyy='0' iyz='0' izz='0'/></inertial>")));
  CHECK(part<RevoluteLink<double>>(r, "a").body.is_massless);
  CHECK_FALSE(part<RevoluteLink<double>>(r, "b").body.is_massless);
  CHECK(part<RevoluteLink<double>>(r, "b").body.mass == 2);
  CHECK(r.tree().size() == 2);
}

TEST_CASE("the base is fixed where the user says, or floats")
{
  const std::string text =
      robot_xml(link_xml("base") + link_xml("a") + joint_xml("j", "continuous", "base", "a", "<origin xyz='0 0 1'/>"));
  UrdfOptions<double> on_table;
  on_table.at.R << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  on_table.at.p = vec(0, 0, 0.75);
  const auto fixed = parse_urdf<double>(text, on_table);
  CHECK(fixed.tree().n_v() == 1);
  CHECK(attachment(fixed, "a").p == vec(0, 0, 1.75));
  CHECK(attachment(fixed, "a").R == on_table.at.R);
  CHECK(fixed.tree().frame("base").at.p == vec(0, 0, 0.75));

  const auto floating = parse_urdf<double>(text, with(Base::floating));
  CHECK(part<FloatingBase<double>>(floating, "base").body.mass == 2);
  CHECK(attachment(floating, "a").parent == "base");
  CHECK(floating.tree().n_v() == 7);
  CHECK(floating.node(floating.tree(), "j").q == 7);
  CHECK(parse_urdf<double>(robot_xml(link_xml("base")), with(Base::floating)).tree().n_v() == 6);
}

TEST_CASE("a root called world is the world")
{
  const std::string text =
      robot_xml(link_xml("world", "") + link_xml("base") + link_xml("a") + joint_xml("j", "continuous", "base", "a") +
                joint_xml("ground", "fixed", "world", "base", "<origin xyz='0 0 1'/>"));
  const auto fixed = parse_urdf<double>(text);
  CHECK(attachment(fixed, "a").parent == "world");
  CHECK(attachment(fixed, "a").p == vec(0, 0, 1));
  const auto floating = parse_urdf<double>(text, with(Base::floating));
  CHECK(floating.tree().name(0) == "base");
  CHECK(floating.tree().n_v() == 7);
  const auto flying = parse_urdf<double>(
      robot_xml(link_xml("world", "") + link_xml("base") + joint_xml("fly", "floating", "world", "base")));
  CHECK(flying.tree().n_v() == 6);
}

TEST_CASE("frames can be named on any link")
{
  UrdfOptions<double> options;
  options.frames.push_back({"sole", "foot", {Matrix3<double>::Identity(), vec(0, 0, -0.1)}});
  options.frames.push_back({"lamp", "base", {}});
  const auto tree = parse_urdf<double>(robot_xml(link_xml("base") + link_xml("leg") + link_xml("foot") +
                                                 joint_xml("j", "continuous", "base", "leg") +
                                                 joint_xml("f", "fixed", "leg", "foot", "<origin xyz='0 0 -0.5'/>")),
                                       options)
                        .tree();
  CHECK((tree.frame("sole").at.p - vec(0, 0, -0.6)).norm() <= eps);
  CHECK(tree.frame("sole").subsystem == 0);
  CHECK(tree.frame("lamp").frame == -1);
}

TEST_CASE("mimicking joints are independent where the user says so")
{
  const std::string text =
      robot_xml(link_xml("base") + link_xml("a") + link_xml("b") + joint_xml("j1", "continuous", "base", "a") +
                joint_xml("j2", "continuous", "base", "b", "<mimic joint='j1' multiplier='-1'/>"));
  CHECK_THROWS_AS(parse_urdf<double>(text), ModelError);
  UrdfOptions<double> options;
  options.mimic = Mimic::independent;
  CHECK(parse_urdf<double>(text, options).tree().n_v() == 2);
}

TEST_CASE("a small link with a flawed inertia is forgiven on a sound one, with a warning")
{
  const std::string flawed =
      "<inertial><mass value='1e-3'/><inertia ixx='1e-6' ixy='0' ixz='0' iyy='1e-6' iyz='0' izz='3e-6'/></inertial>";
  const auto r =
      parse_urdf<double>(robot_xml(link_xml("base") + link_xml("a") + link_xml("cover", flawed) +
                                   joint_xml("j", "continuous", "base", "a") + joint_xml("f", "fixed", "a", "cover")));
  REQUIRE(r.warnings.size() == 1);
  CHECK(r.warnings[0].find("cover") != std::string::npos);
  CHECK(part<RevoluteLink<double>>(r, "a").body.mass == 2.001);
}

TEST_CASE("a joint that moves no mass is warned of")
{
  const std::string bare = "<link name='jaw'/>";
  const std::string joints = joint_xml("j", "continuous", "base", "a") + joint_xml("grip", "continuous", "a", "jaw");
  const auto r = parse_urdf<double>(robot_xml(link_xml("base") + link_xml("a") + bare + joints));
  REQUIRE(r.warnings.size() == 1);
  CHECK(r.warnings[0].find("'grip'") != std::string::npos);
  CHECK(r.warnings[0].find("'jaw'") != std::string::npos);
  const std::string tip = link_xml("tip") + joint_xml("t", "fixed", "jaw", "tip");
  CHECK(parse_urdf<double>(robot_xml(link_xml("base") + link_xml("a") + bare + joints + tip)).warnings.empty());
}

TEST_CASE("an inertia that no body can have is kept as it is where no moment is negative, with a warning")
{
  const auto inertial_with = [](const std::string& ixy) {
    return "<inertial><mass value='1.4'/><inertia ixx='0.0025' ixy='" + ixy +
           "' ixz='0' iyy='0.0065' iyz='0' izz='0.0007'/></inertial>";
  };
  const std::string joints = joint_xml("j", "continuous", "base", "a");
  const auto r = parse_urdf<double>(robot_xml(link_xml("base") + link_xml("a", inertial_with("0.0018")) + joints));
  REQUIRE(r.warnings.size() == 1);
  CHECK(r.warnings[0].find("'a': one principal moment") != std::string::npos);
  CHECK(part<RevoluteLink<double>>(r, "a").body.inertia(0, 1) == 0.0018);
  CHECK(r.tree().n_v() == 1);
  CHECK_THROWS_AS(parse_urdf<double>(robot_xml(link_xml("base") + link_xml("a", inertial_with("0.0058")) + joints)),
                  ModelError);
  // not made good by what is merged with it
  const auto merged =
      parse_urdf<double>(robot_xml(link_xml("base") + link_xml("a", inertial_with("0.0018")) +
                                   link_xml("b", inertial_with("0")) + joints + joint_xml("f", "fixed", "a", "b")));
  CHECK(merged.warnings.size() == 2);
  CHECK(part<RevoluteLink<double>>(merged, "a").body.mass == 2.8);
  CHECK(merged.tree().n_v() == 1);
}

TEST_CASE("a frame that a file gives an inertia without a mass is forgiven likewise")
{
  const std::string sole =
      "<inertial><mass value='0'/><inertia ixx='1e-6' ixy='0' ixz='0' iyy='1e-6' iyz='0' izz='1e-6'/></inertial>";
  const std::string links = link_xml("base") + link_xml("a") + link_xml("sole", sole);
  const std::string on_link = joint_xml("j", "continuous", "base", "a") + joint_xml("f", "fixed", "a", "sole");
  const auto r = parse_urdf<double>(robot_xml(links + on_link));
  REQUIRE(r.warnings.size() == 1);
  CHECK(r.warnings[0].find("sole") != std::string::npos);
  CHECK(part<RevoluteLink<double>>(r, "a").body.mass == 2);
  const std::string moved = joint_xml("j", "continuous", "base", "a") + joint_xml("k", "continuous", "a", "sole");
  CHECK_THROWS_AS(parse_urdf<double>(robot_xml(links + moved)), ModelError);
}

TEST_CASE("a point mass may be given moments that are roundings of zero")
{
  const auto moments = [](const std::string& ixx) {
    return "<inertial><mass value='2'/><inertia ixx='" + ixx +
           "' ixy='0' ixz='0' iyy='3e-20' iyz='0' izz='0'/></inertial>";
  };
  const auto robot = [&](const std::string& ixx) {
    return robot_xml(link_xml("base") + link_xml("a", moments(ixx)) + joint_xml("j", "continuous", "base", "a"));
  };
  CHECK(parse_urdf<double>(robot("-5e-20")).warnings.empty());
  CHECK_THROWS_AS(parse_urdf<double>(robot("-5e-12")), ModelError);
}

TEST_CASE("robots of other scalars")
{
  const std::string text = robot_xml(link_xml("base") + link_xml("a") +
                                     joint_xml("j", "continuous", "base", "a", "<origin xyz='0 0 0.1'/>"));
  CHECK(parse_urdf<float>(text).tree().placement(0).p.z() == 0.1f);
  CHECK(parse_urdf<long double>(text).tree().placement(0).p.z() == static_cast<long double>(0.1));
}

TEST_CASE("white space about numbers is none of theirs")
{
  const auto r = parse_urdf<double>(
      robot_xml(link_xml("base") +
                link_xml("a",
                         "<inertial><origin xyz='0.1\t0\n 0\r\n'/><mass value=' 2 '/><inertia ixx='0.01 ' "
                         "ixy='0' ixz=' 0' iyy='0.02' iyz='0' izz='0.025'/></inertial>") +
                joint_xml("j", "continuous", "base", "a", "<origin xyz='1 2\t3'/><axis xyz='0 0 1 '/>")));
  const Body<double>& body = part<RevoluteLink<double>>(r, "a").body;
  CHECK(body.mass == 2);
  CHECK(body.com == vec(0.1, 0, 0));
  CHECK(body.inertia.diagonal() == vec(0.01, 0.02, 0.025));
  CHECK(attachment(r, "a").p == vec(1, 2, 3));
  CHECK(part<RevoluteLink<double>>(r, "a").joint.axis == vec(0, 0, 1));
  CHECK(r.warnings.empty());
}

TEST_CASE("axes that were written to a few digits are unit vectors")
{
  const auto r =
      parse_urdf<double>(robot_xml(link_xml("base") + link_xml("a") +
                                   joint_xml("j", "continuous", "base", "a", "<axis xyz='0.577 0.577 -0.577'/>")));
  CHECK((part<RevoluteLink<double>>(r, "a").joint.axis - vec(1, 1, -1) / std::numbers::sqrt3).norm() <= 4 * eps);
}

TEST_CASE("rotations of fixed joints in a row are multiplied in double for float, too")
{
  std::string inside = link_xml("base") + link_xml("a0") + joint_xml("j", "continuous", "base", "a0");
  for (int k = 0; k < 60; ++k) {
    const std::string here = "a" + std::to_string(k), next = "a" + std::to_string(k + 1);
    inside += link_xml(next, "") +
              joint_xml("f" + std::to_string(k), "fixed", here, next, "<origin xyz='0.1 0 0' rpy='0.3 -1.1 2.3'/>");
  }
  inside += link_xml("tip") + joint_xml("k", "continuous", "a60", "tip");
  const auto in_float = parse_urdf<float>(robot_xml(inside));
  CHECK(in_float.tree().n_v() == 2);
  const auto same = parse_urdf<double>(robot_xml(inside));
  CHECK(in_float.assembly.parts()[1].on.R == attachment(same, "tip").R.cast<float>());
}

TEST_CASE("a motor without inertia takes nothing out of a link without mass")
{
  UrdfOptions<double> options;
  options.rotors_in_links = true;
  options.motors["k"].gear_ratio = 50;
  const auto r = parse_urdf<double>(robot_xml(link_xml("base") + link_xml("cross", "") + link_xml("a") +
                                              joint_xml("j", "continuous", "base", "cross") +
                                              joint_xml("k", "continuous", "cross", "a", "<axis xyz='0 0 1'/>")),
                                    options);
  CHECK(r.tree().n_v() == 2);
}

TEST_CASE("an axis that is written a little too long is a unit vector, too")
{
  const auto r =
      parse_urdf<double>(robot_xml(link_xml("base") + link_xml("a") +
                                   joint_xml("j", "continuous", "base", "a", "<axis xyz='0.5774 0.5774 -0.5774'/>")));
  CHECK((part<RevoluteLink<double>>(r, "a").joint.axis - vec(1, 1, -1) / std::numbers::sqrt3).norm() <= 4 * eps);
}

TEST_CASE("a joint that moves a mass farther out, or a rotor, is not warned of")
{
  const auto warnings = [](const std::string& on_b, const UrdfOptions<double>& options) {
    return parse_urdf<double>(robot_xml(link_xml("base") + link_xml("a", "") + link_xml("b", on_b) +
                                        joint_xml("j", "continuous", "base", "a") +
                                        joint_xml("k", "continuous", "a", "b", "<axis xyz='0 1 0'/>")),
                              options)
        .warnings;
  };
  CHECK(warnings(inertial, {}).empty());
  CHECK(warnings("", {}).size() == 2);
  UrdfOptions<double> geared;
  geared.motors["k"].axial_inertia = 1e-4;
  const auto of_first = warnings("", geared);
  REQUIRE(of_first.size() == 1);
  CHECK(of_first[0].find("'j'") != std::string::npos);
  geared.motors["j"].axial_inertia = 1e-4;
  CHECK(warnings("", geared).empty());

  UrdfOptions<double> heavy;  // a motor's mass is on the link before its joint
  UrdfMotor<double>& motor = heavy.motors["k"];
  motor.gear_ratio = 10;
  motor.axial_inertia = motor.transverse_inertia = 1e-3;
  motor.mass = 1;
  CHECK(warnings("", heavy).empty());
}

TEST_CASE("a continuous joint has no end stops, whatever its limits say")
{
  const auto r = parse_urdf<double>(
      robot_xml(link_xml("base") + link_xml("a") + joint_xml("j", "continuous", "base", "a", limit)));
  CHECK(r.joint("j").lower == -std::numeric_limits<double>::infinity());
  CHECK(r.joint("j").upper == std::numeric_limits<double>::infinity());
  CHECK(r.joint("j").velocity == 4);
  CHECK(r.joint("j").effort == 30);
}

TEST_CASE("a root called world that is more than what holds the base is refused with a floating base")
{
  const std::string on_world = joint_xml("w", "fixed", "world", "a") + joint_xml("j", "continuous", "a", "b");
  const std::string links = link_xml("a") + link_xml("b") + link_xml("c");
  const auto refused = [&](const std::string& inside) {
    CHECK_THROWS_WITH(parse_urdf<double>(robot_xml(inside), with(Base::floating)),
                      Catch::Matchers::ContainsSubstring("link 'world': with Base::floating"));
  };
  CHECK(parse_urdf<double>(robot_xml(link_xml("world", "") + links + on_world + joint_xml("f", "fixed", "b", "c")),
                           with(Base::floating))
            .tree()
            .n_v() == 7);
  refused(link_xml("world") + links + on_world + joint_xml("f", "fixed", "b", "c"));
  refused(link_xml("world", "") + links + on_world + joint_xml("f", "fixed", "world", "c"));
}

}  // namespace test_urdf
