// REQUIRES: mujoco
// PROGRAM: tests_loops
// Joints and MuJoCo: its hinge, slide, ball and free joints, one after the other on one body where ours are one.
#include "catch.hpp"
#include "type_mujoco.hpp"
#include "worst.hpp"

#include <iim/subsystem/joint_more.hpp>

namespace test_type_mujoco_joints {

using namespace iim;
using namespace iim::test;

namespace {

constexpr int states = 100;
constexpr std::uint64_t seed = 87;

using Parts =
    Assembly<RevoluteLink<double>, PrismaticLink<double>, FloatingBase<double>, FixedLink<double>, HelicalLink<double>,
             CylindricalLink<double>, UniversalLink<double>, PlanarLink<double>, SphericalLink<double>>;

/// base (free) – link, the joint under test – load (hinge). Largest difference of all rows over random states, for
/// moments and forces on the joint and a wrench on the load.
template <class Link>
double difference(Random& random, const Link& link, const std::vector<MujocoJoint>& joints, double lead = 0)
{
  const Body<double> base = random.body();
  const RevoluteLink<double> load{{random.unit()}, random.body()};
  const Attachment<double> on = random_attachment(random, "base"), load_on = random_attachment(random, "link");
  Parts parts;
  parts.set_gravity(random.vector(10));
  parts.add("base", {}, FloatingBase<double>{base}).add("link", on, link).add("load", load_on, load);
  const DynamicTree tree(parts);
  Inputs inputs(tree);
  inputs.add_wrench("load");

  std::vector<Tie> ties;
  if (lead != 0) { ties.push_back({"link", 1, "link", 0, lead}); }
  MujocoRobot robot({{"base", "", {}, {{"free"}}, base},
                     {"link", "base", {on.R, on.p}, joints, link.body},
                     {"load", "link", {load_on.R, load_on.p}, {{"hinge", load.joint.axis}}, load.body}},
                    {}, ties, parts.gravity());
  double worst = 0;
  for (int k = 0; k < states; ++k) {
    RandomState state = random_state(tree, 0, random, 2);
    const auto& node = tree.node(1);
    if (joints[0].kind == "ball") { state.q.template segment<4>(node.q) = random.quaternion(); }
    const Answer answer = test::solve(tree, inputs, state.q, state.qd);
    REQUIRE(answer.status == Status::ok);

    // MuJoCo's quaternions have the scalar first, a free joint's linear velocity is that of the origin in world axes.
    Eigen::VectorXd x = Eigen::VectorXd::Zero(robot.n_q()), xd = Eigen::VectorXd::Zero(robot.n_v());
    const auto scalar_first = [](const Eigen::Vector4d& q) { return Eigen::Vector4d(q(3), q(0), q(1), q(2)); };
    const Mat3 E = Eigen::Quaterniond(state.q(6), state.q(3), state.q(4), state.q(5)).toRotationMatrix();
    x.head<3>() = state.q.head<3>();
    x.segment<4>(3) = scalar_first(state.q.segment<4>(3));
    xd.head<3>() = E * state.qd.head<3>();
    xd.segment<3>(3) = state.qd.segment<3>(3);
    const Index at_q = robot.q_of("link"), at = robot.v_of("link");
    if (joints[0].kind == "ball") {
      x.segment<4>(at_q) = scalar_first(state.q.segment<4>(node.q));
    } else {
      x.segment<Link::n_q>(at_q) = state.q.segment<Link::n_q>(node.q);
    }
    xd.segment<Link::n_i>(at) = state.qd.segment<Link::n_i>(node.v);
    if (lead != 0) {
      x(at_q + 1) = lead * x(at_q);
      xd(at + 1) = lead * xd(at);
    }
    x(robot.q_of("load")) = state.q(tree.node(2).q);
    xd(robot.v_of("load")) = state.qd(tree.node(2).v);

    Eigen::MatrixXd B = Eigen::MatrixXd::Zero(robot.n_v(), inputs.columns());
    B.block<Link::n_i, Link::n_i>(at, 0).setIdentity();
    B(robot.v_of("load"), Link::n_i) = 1;
    robot.solve(x, xd, B);  // brings the bodies to where they are
    B.rightCols<6>() = robot.wrench("load");
    const Answer reference = robot.solve(x, xd, B);
    Eigen::MatrixXd rows(tree.n_v(), 1 + inputs.columns()), expected = rows;
    rows << answer.qdd0, answer.Bhat;
    const Eigen::MatrixXd all = robot.rows_of(reference, {"base", "link", "load"});
    expected << all.topRows(6 + Link::n_i), all.bottomRows(1);  // a helical joint has a second row there
    // Derivative of the velocity in body axes: Eᵀ v̇ − ω × Eᵀ v.
    expected.topRows<3>() = (E.transpose() * expected.topRows<3>()).eval();
    expected.col(0).head<3>() -= Vec3(state.qd.segment<3>(3)).cross(Vec3(state.qd.head<3>()));
    keep_worst(worst, relative_error(rows, expected));
  }
  return worst;
}

// Digits are lost by the condition number of M, up to 1e3 for bodies of 0.1–10 kg a metre apart.
constexpr double tolerance = 1e4 * eps;

}  // namespace

TEST_CASE("Revolute, prismatic, cylindrical, universal and planar joints are MuJoCo's hinges and slides")
{
  INFO("seed " << seed);
  Random random(seed);
  const Vec3 axis = random.unit(), x = axis.cross(random.unit()).normalized(), oblique = (axis + x).normalized();
  const Body<double> body = random.body();
  CHECK(difference(random, RevoluteLink<double>{{axis}, body}, {{"hinge", axis}}) < tolerance);
  CHECK(difference(random, PrismaticLink<double>{{axis}, body}, {{"slide", axis}}) < tolerance);
  CHECK(difference(random, CylindricalLink<double>{{axis}, body}, {{"hinge", axis}, {"slide", axis}}) < tolerance);
  CHECK(difference(random, UniversalLink<double>{{axis, x}, body}, {{"hinge", axis}, {"hinge", x}}) < tolerance);
  CHECK(difference(random, UniversalLink<double>{{axis, oblique}, body}, {{"hinge", axis}, {"hinge", oblique}}) <
        tolerance);
  CHECK(difference(random, PlanarLink<double>{{axis, x}, body},
                   {{"slide", x}, {"slide", axis.cross(x)}, {"hinge", axis}}) < tolerance);
}

TEST_CASE(
    "A helical joint is MuJoCo's hinge and slide with a joint constraint; spherical and free are its ball and free")
{
  INFO("seed " << seed + 1);
  Random random(seed + 1);
  const Vec3 axis = random.unit();
  const Body<double> body = random.body();
  CHECK(difference(random, HelicalLink<double>{{axis, 0.15}, body}, {{"hinge", axis}, {"slide", axis}}, 0.15) <
        tolerance);
  SphericalLink<double> ball;
  ball.body = body;
  CHECK(difference(random, ball, {{"ball"}}) < tolerance);
}

}  // namespace test_type_mujoco_joints
