// Whatever is wrong with a model is an exception that names the item and the value.
#include "catch.hpp"
#include "random_tree.hpp"

#include <iim/subsystem/joint_more.hpp>

#include <limits>
#include <string>
#include <utility>

using namespace iim;
using Catch::Matchers::ContainsSubstring;
using test::Mat3;
using test::Vec3;

namespace {

using Robot = StandardAssembly<double>;
using Tree = decltype(DynamicTree(std::declval<Robot>()));
constexpr double NaN = std::numeric_limits<double>::quiet_NaN();
constexpr double Inf = std::numeric_limits<double>::infinity();

RevoluteLink<double> link()
{
  test::Random random(1);
  return {{Vec3::UnitY()}, random.body()};
}

MotorArm<double> arm()
{
  test::Random random(2);
  return {{Vec3::UnitY()}, random.body(), random.motor()};
}

Attachment<double> on(const std::string& parent)
{
  Attachment<double> attachment;
  attachment.parent = parent;
  return attachment;
}

/// The message that building a tree from `robot` ends with.
std::string message(const Robot& robot)
{
  try {
    const Tree tree(robot);
  } catch (const ModelError& error) {
    return error.what();
  }
  return "no error";
}

/// The same for one part "arm" on the world.
template <class S>
std::string message(const S& part)
{
  return message(Robot().add("arm", on("world"), part));
}

/// The message that f ends with.
template <class F>
std::string message_of(F&& f)
{
  try {
    f();
  } catch (const ModelError& error) {
    return error.what();
  }
  return "no error";
}

/// The message says all of these words.
template <class... Words>
void check_names(const std::string& text, const Words&... words)
{
  for (const std::string& word : {std::string(words)...}) { CHECK_THAT(text, ContainsSubstring(word)); }
}

}  // namespace

TEST_CASE("a sound model is no error", "[bad input]")
{
  CHECK(message(link()) == "no error");
  CHECK(message(arm()) == "no error");
  RevoluteLink<double> point = link();
  point.body.inertia.setZero();  // a point mass can be
  CHECK(message(point) == "no error");
  RevoluteLink<double> rod = link();
  rod.body.inertia = Vec3(1, 1, 0).asDiagonal();
  CHECK(message(rod) == "no error");
}

TEST_CASE("topology", "[bad input]")
{
  check_names(message(Robot()), "no parts");
  check_names(message(Robot().add("arm", on("shoulder"), link())), "'arm'", "'shoulder'", "does not exist");
  check_names(message(Robot().add("a", on("c"), link()).add("b", on("a"), link()).add("c", on("b"), link())), "'a'",
              "loop");
  check_names(message(Robot().add("x", on("world"), link()).add("a", on("a"), link())), "'a'", "loop");
  Attachment<double> third = on("a");
  third.outlet = 3;
  check_names(message(Robot().add("a", on("world"), link()).add("b", third, link())), "'b'", "outlet 3", "'a'",
              "has 1");
  third.outlet = -1;
  check_names(message(Robot().add("a", on("world"), link()).add("b", third, link())), "'b'", "outlet -1");
  check_names(message_of([] { Robot().add("a", on("world"), link()).add("a", on("world"), arm()); }), "'a'", "twice");
  check_names(message_of([] { Robot().add("a", on("world"), link()).add_frame("a", on("a")); }), "'a'", "twice");
  check_names(message_of([] { Robot().add("world", on("world"), link()); }), "'world'");
  check_names(message_of([] { Robot().add("", on("world"), link()); }), "''");
  check_names(message(Robot().add("a", on("world"), link()).add_frame("tip", on("b"))), "'tip'", "'b'",
              "does not exist");
  CHECK(message(Robot().add("a", on("world"), link()).add_frame("tip", on("a")).add("b", on("tip"), link())) ==
        "no error");
  check_names(message(Robot().add("b", on("tip"), link()).add_frame("tip", on("top")).add_frame("top", on("tip"))),
              "'b'", "loop of frames");
  check_names(message(Robot().add("a", on("tip"), link()).add_frame("tip", on("a"))), "'a'", "loop");
  third.outlet = 1;
  third.parent = "tip";
  check_names(message(Robot().add("a", on("world"), link()).add_frame("tip", on("a")).add("b", third, link())), "'b'",
              "'tip'", "has 1");
}

TEST_CASE("couplings", "[bad input]")
{
  const auto coupled = [](const Mat3& R, const Vec3& p) {
    Attachment<double> attachment = on("world");
    attachment.R = R;
    attachment.p = p;
    return message(Robot().add("arm", attachment, link()));
  };
  const Mat3 one = Mat3::Identity();
  CHECK(coupled(one, Vec3(1, 2, 3)) == "no error");
  check_names(coupled(-one, Vec3::Zero()), "'arm'", "rotation", "-1");  // a reflection
  check_names(coupled(2 * one, Vec3::Zero()), "'arm'", "rotation", "2");
  Mat3 sheared = one;
  sheared(0, 1) = 0.125;
  check_names(coupled(sheared, Vec3::Zero()), "'arm'", "rotation", "0.125");
  check_names(coupled(one, Vec3(0, NaN, 0)), "'arm'", "finite", "nan");
  check_names(coupled(one, Vec3(0, 0, Inf)), "'arm'", "finite", "inf");
  check_names(coupled(Mat3::Constant(NaN), Vec3::Zero()), "'arm'", "finite", "nan");
  Attachment<double> frame = on("arm");
  frame.R = 3 * one;
  check_names(message(Robot().add("arm", on("world"), link()).add_frame("tip", frame)), "'tip'", "rotation", "3");
  check_names(message_of([] { Robot().set_gravity(Vec3(0, 0, NaN)); }), "gravity", "nan");
}

TEST_CASE("bodies", "[bad input]")
{
  const auto with = [](auto edit) {
    RevoluteLink<double> part = link();
    edit(part.body);
    return message(part);
  };
  check_names(with([](auto& body) { body.mass = 0; }), "'arm'", "mass", "0");
  check_names(with([](auto& body) { body.mass = -2.5; }), "'arm'", "mass", "-2.5");
  check_names(with([](auto& body) { body.mass = NaN; }), "'arm'", "mass", "nan");
  check_names(with([](auto& body) { body.mass = Inf; }), "'arm'", "mass", "inf");
  check_names(with([](auto& body) { body.com(1) = NaN; }), "'arm'", "centre of mass", "nan");
  check_names(with([](auto& body) { body.inertia(2, 2) = Inf; }), "'arm'", "inertia", "inf");
  check_names(with([](auto& body) { body.inertia = Vec3(0.25, 1, 2).asDiagonal(); }), "'arm'", "exceeds the sum",
              "0.25");
  check_names(with([](auto& body) { body.inertia = Vec3(1, 1, -0.5).asDiagonal(); }), "'arm'", "negative", "-0.5");
  check_names(with([](auto& body) { body.inertia(0, 1) += 0.75; }), "'arm'", "symmetric");
  FloatingBase<double> base{link().body};
  base.body.mass = -1;
  check_names(message(base), "'arm'", "mass", "-1");
  FixedLink<double> fixed{{}, link().body};
  fixed.body.mass = 0;
  check_names(message(fixed), "'arm'", "mass", "0");
}

TEST_CASE("axes and motors", "[bad input]")
{
  const auto axis = [](const Vec3& a) {
    RevoluteLink<double> turning = link();
    turning.joint.axis = a;
    PrismaticLink<double> sliding{{a}, link().body};
    CHECK(message(sliding) == message(turning));
    return message(turning);
  };
  check_names(axis(Vec3(0, 0, 2)), "'arm'", "axis", "unit", "(0, 0, 2)");
  check_names(axis(Vec3::Zero()), "'arm'", "axis", "(0, 0, 0)");
  check_names(axis(Vec3(1, NaN, 0)), "'arm'", "axis", "nan");
  CHECK(axis(Vec3(0, 0, 1 + 1e-9)) == "no error");

  const auto motor = [](auto edit) {
    MotorArm<double> part = arm();
    edit(part.motor);
    return message(part);
  };
  check_names(motor([](auto& m) { m.axis = Vec3(3, 0, 0); }), "'arm'", "rotor", "axis", "(3, 0, 0)");
  check_names(motor([](auto& m) { m.gear_ratio = NaN; }), "'arm'", "gear ratio", "nan");
  check_names(motor([](auto& m) { m.gear_ratio = -Inf; }), "'arm'", "gear ratio", "-inf");
  check_names(motor([](auto& m) { m.axial_inertia = -0.5; }), "'arm'", "rotor", "-0.5");
  check_names(motor([](auto& m) { m.mass = -0.25; }), "'arm'", "rotor", "-0.25");
  check_names(motor([](auto& m) { m.transverse_inertia = NaN; }), "'arm'", "rotor", "nan");
  check_names(motor([](auto& m) {
                m.mass = 1;
                m.com = Vec3(NaN, 0, 0);
              }),
              "'arm'", "rotor", "nan");
  // A disc has J = 2 J_t; more than that is no body.
  check_names(motor([](auto& m) {
                m.mass = 1;
                m.axial_inertia = 1;
                m.transverse_inertia = 0.25;
              }),
              "'arm'", "rotor", "0.25");
}

TEST_CASE("inputs", "[bad input]")
{
  const Tree tree(Robot()
                      .add("base", on("world"), FloatingBase<double>{link().body})
                      .add("arm", on("base"), arm())
                      .add_frame("tip", on("arm"))
                      .add_frame("floor", on("world")));
  Inputs inputs(tree, Start::empty);
  check_names(message_of([&] { inputs.add_motor("leg"); }), "'leg'");
  check_names(message_of([&] { inputs.add_motor("tip"); }), "'tip'");
  check_names(message_of([&] { inputs.add_motor("base"); }), "'base'", "no motor");
  check_names(message_of([&] { inputs.add_force("foot"); }), "'foot'");
  check_names(message_of([&] { inputs.add_wrench("foot"); }), "'foot'");
  check_names(message_of([&] { inputs.add_force("floor"); }), "'floor'", "world");
  check_names(message_of([&] { inputs.add_force("tip", Vec3(0, NaN, 0)); }), "'tip'", "nan");
  CHECK(inputs.blocks() == 0);  // what failed left nothing behind
  inputs.add_motor("arm");
  check_names(message_of([&] { inputs.add_motor("arm"); }), "'arm'", "already");
  CHECK(inputs.columns() == 1);
  check_names(message_of([&] { tree.index("leg"); }), "'leg'");
  check_names(message_of([&] { tree.frame("leg"); }), "'leg'");
}

namespace {

/// A planar link with a motor that stays behind.
struct PlanarOnMotor : RigidLink<Planar<double>> {
  Body<double> motor = body_of(1);
  static Body<double> body_of(double mass)
  {
    Body<double> body;
    body.mass = mass;
    body.inertia = Mat3::Identity();
    return body;
  }
  std::array<CarriedBody<double>, 2> bodies() const { return {{{0, body}, {-1, motor}}}; }
};

/// A type whose author forgot to look at the body.
struct Careless : RevoluteLink<double> {
  void prepare(const std::string& name) { joint.prepare(name); }
};

/// A link whose body, or rotor, is on a frame that it does not have.
struct Misplaced : RevoluteLink<double> {
  int body_frame = 0, rotor_frame = 0;
  double rotor_inertia = 0.1, rotor_ratio = 1;
  Vector3<double> rotor_axis = Vector3<double>::UnitZ();

  void prepare(const std::string& name) { joint.prepare(name); }
  std::array<CarriedBody<double>, 1> bodies() const { return {{{body_frame, body}}}; }
  std::array<Rotor<double, 1>, 1> rotors() const
  {
    return {{{rotor_frame, rotor_axis, rotor_inertia, Eigen::Matrix<double, 1, 1>(rotor_ratio), true}}};
  }
};

/// A link whose velocity is a motor's, half as fast.
struct Stretched : RevoluteLink<double> {
  Vector6<double> own_twist() const { return joint.own_twist() / 2; }
};

/// A free body that pushes along its own z.
struct Thruster : FloatingBase<double> {
  static constexpr int n_u = 1;
  Eigen::Matrix<double, 6, 1> Bbar(const Eigen::Matrix<double, 7, 1>&) const { return Vector6<double>::Unit(2); }
};

}  // namespace

TEST_CASE("bodies and rotors on frames that a subsystem does not have")
{
  const auto tree_of = [](int body, int rotor) {
    Misplaced link;
    link.body.mass = 1;
    link.body_frame = body;
    link.rotor_frame = rotor;
    Assembly<Misplaced> assembly;
    return DynamicTree(assembly.add("arm", {}, link));
  };
  CHECK_NOTHROW(tree_of(0, 0));
  CHECK_NOTHROW(tree_of(-1, -1));
  CHECK_THROWS_WITH(tree_of(1, 0), ContainsSubstring("'arm'") && ContainsSubstring("body on frame 1 of 1"));
  CHECK_THROWS_WITH(tree_of(-2, 0), ContainsSubstring("'arm'") && ContainsSubstring("body on frame -2"));
  CHECK_THROWS_WITH(tree_of(0, 1), ContainsSubstring("'arm'") && ContainsSubstring("rotor on frame 1"));
  CHECK_THROWS_WITH(tree_of(0, -2), ContainsSubstring("'arm'") && ContainsSubstring("rotor on frame -2"));
}

TEST_CASE("a body that cannot exist is found also where a type of one's own does not look")
{
  Careless link;
  link.body.mass = 1;
  link.body.inertia = Eigen::Vector3d(1, 1, 5).asDiagonal();
  CHECK_THROWS_WITH(DynamicTree(Assembly<Careless>().add("blade", {}, link)), ContainsSubstring("'blade'"));
}

TEST_CASE("masses and rotors that cannot exist are found also where a type of one's own does not look")
{
  const auto check = [](auto change, const char* what) {
    Misplaced link;
    link.body.mass = 1;
    change(link);
    CHECK_THROWS_WITH(DynamicTree(Assembly<Misplaced>().add("arm", {}, link)),
                      ContainsSubstring("'arm'") && ContainsSubstring(what));
  };
  check([](auto& link) { link.body.mass = -1; }, "mass");
  check([](auto& link) { link.body.mass = NaN; }, "mass");
  check([](auto& link) { link.rotor_inertia = -0.1; }, "rotor's inertia");
  check([](auto& link) { link.rotor_inertia = NaN; }, "rotor's inertia");
  check([](auto& link) { link.rotor_ratio = NaN; }, "rotor's ratios");
  check([](auto& link) { link.rotor_axis *= 2; }, "rotor's axis");
}

TEST_CASE("a type whose coupling point follows the frame has no body on the inlet")
{
  PlanarOnMotor link;
  link.body = PlanarOnMotor::body_of(2);
  CHECK_THROWS_WITH(DynamicTree(Assembly<PlanarOnMotor>().add("puck", {}, link)),
                    ContainsSubstring("'puck'") && ContainsSubstring("inlet"));
}

TEST_CASE("a massless body has neither mass nor moments")
{
  Careless link;
  link.body = Body<double>::massless();
  CHECK_NOTHROW(validate(link.body, "frame"));
  link.body.inertia(1, 1) = 0.1;
  CHECK_THROWS_WITH(validate(link.body, "frame"), ContainsSubstring("frame") && ContainsSubstring("moments"));
}

TEST_CASE("a type's own twist is a unit vector, and motors of a free one push from the world")
{
  Stretched arm;
  arm.body = PlanarOnMotor::body_of(2);
  CHECK_THROWS_WITH(DynamicTree(Assembly<Stretched>().add("arm", {}, arm)),
                    ContainsSubstring("'arm'") && ContainsSubstring("own_twist"));
  Thruster drone;
  drone.body = PlanarOnMotor::body_of(2);
  Assembly<Thruster> two;
  two.add("drone", {}, drone);
  CHECK_NOTHROW(DynamicTree(two));
  CHECK_THROWS_WITH(DynamicTree(two.add("another", {"drone"}, drone)),
                    ContainsSubstring("'another'") && ContainsSubstring("'drone'"));
}
