// PROGRAM: tests_types
// Joints against compositions of revolute and prismatic joints with parts without mass between them.
#include "catch.hpp"
#include "type_robots.hpp"
#include "worst.hpp"

#include <iim/subsystem/joint_more.hpp>

#include <algorithm>
#include <limits>

using namespace iim;
using namespace iim::test;

namespace {

constexpr int states = 200;
constexpr std::uint64_t seed = 20250101;

// Two trees that are the same robot, each solved with a handful of recursions on 3–8 velocities: some 100 roundings,
// enlarged by the condition number of M (up to 1e3 for bodies of 0.1–10 kg a metre apart).
constexpr double tolerance = 1e5 * eps;

// The joint under test sits on a moving base and carries a load.
using Parts = Assembly<RevoluteLink<double>, PrismaticLink<double>, FloatingBase<double>, HelicalLink<double>,
                       CylindricalLink<double>, UniversalLink<double>, PlanarLink<double>, SphericalLink<double>>;

struct Scenario {
  Body<double> base, body, load;
  Attachment<double> on, load_on;
  Vec3 load_axis;
};

Scenario scenario(Random& random)
{
  return {
      random.body(), random.body(), random.body(), random_attachment(random, "base"), random_attachment(random, "link"),
      random.axis()};
}

template <class F>
auto robot(const Scenario& s, F&& add_link)
{
  Parts parts;
  parts.add("base", {}, FloatingBase<double>{s.base});
  add_link(parts);
  parts.add("load", s.load_on, RevoluteLink<double>{{s.load_axis}, s.load});
  return DynamicTree(parts);
}

template <class T>
Inputs<T> contacts_and_motors(const T& tree)
{
  Inputs<T> inputs(tree);
  inputs.add_wrench("load", {0.1, 0.2, 0.3});
  inputs.add_force("link", {0.3, -0.2, 0.1}, Axes::body);
  return inputs;
}

/// A state with a base that turns.
template <class T>
RandomState state_of(const T& tree, Random& random)
{
  return random_state(tree, 0, random, 2);
}

RevoluteLink<double> hinge(const Vec3& axis, const Body<double>& body = Body<double>::massless())
{
  return {{axis}, body};
}
PrismaticLink<double> slide(const Vec3& axis, const Body<double>& body = Body<double>::massless())
{
  return {{axis}, body};
}

/// Adds a chain of parts "…", the last of which is "link".
struct Chain {
  Parts& parts;
  Attachment<double> on;
  int count = 0;

  template <class S>
  Chain& then(const S& part, bool last = false)
  {
    const std::string name = last ? "link" : "between" + std::to_string(count++);
    parts.add(name, on, part);
    on = {name};
    return *this;
  }
};

template <class Joint, class Compose>
void same_as_composition(Random& random, const Scenario& s, const Joint& joint, Compose&& compose)
{
  const auto one = robot(s, [&](Parts& p) { p.add("link", s.on, RigidLink<Joint>{joint, s.body}); });
  const auto composed = robot(s, [&](Parts& p) { compose(Chain{p, s.on}); });
  REQUIRE(one.n_v() == composed.n_v());
  const RandomState state = state_of(one, random);
  const Answer a = solve(one, contacts_and_motors(one), state.q, state.qd);
  const Answer b = solve(composed, contacts_and_motors(composed), state.q, state.qd);
  REQUIRE(a.status == Status::ok);
  REQUIRE(b.status == Status::ok);
  CHECK(relative_error(a.qdd0, b.qdd0) < tolerance);
  CHECK(relative_error(a.Bhat, b.Bhat) < tolerance);
}

}  // namespace

TEST_CASE("Cylindrical, universal and planar joints are compositions in the same coordinates")
{
  INFO("seed " << seed);
  Random random(seed);
  for (int k = 0; k < states; ++k) {
    const Scenario s = scenario(random);
    const Vec3 axis = random.axis();
    const Vec3 other = axis.cross(random.unit()).normalized();
    same_as_composition(random, s, Cylindrical<double>{axis},
                        [&](Chain c) { c.then(hinge(axis)).then(slide(axis, s.body), true); });
    same_as_composition(random, s, Universal<double>{axis, other},
                        [&](Chain c) { c.then(hinge(axis)).then(hinge(other, s.body), true); });
    const Vec3 oblique = (axis + other).normalized();
    same_as_composition(random, s, Universal<double>{axis, oblique},
                        [&](Chain c) { c.then(hinge(axis)).then(hinge(oblique, s.body), true); });
    same_as_composition(random, s, Planar<double>{axis, other}, [&](Chain c) {
      c.then(slide(other)).then(slide(axis.cross(other))).then(hinge(axis, s.body), true);
    });
  }
}

TEST_CASE("A helical joint is a cylindrical composition with displacement and angle tied together")
{
  INFO("seed " << seed + 1);
  Random random(seed + 1);
  for (int k = 0; k < states; ++k) {
    const Scenario s = scenario(random);
    const Vec3 axis = random.axis();
    const double lead = random.uniform(-0.3, 0.3);
    const auto one = robot(s, [&](Parts& p) { p.add("link", s.on, HelicalLink<double>{{axis, lead}, s.body}); });
    const auto free = robot(s, [&](Parts& p) { Chain{p, s.on}.then(hinge(axis)).then(slide(axis, s.body), true); });
    const RandomState state = state_of(one, random);

    // q̇_free = J q̇: M = Jᵀ M_free J, h = Jᵀ h_free, contact columns Jᵀ B_free.
    Eigen::MatrixXd J = Eigen::MatrixXd::Zero(9, 8);
    J.topLeftCorner(7, 7).setIdentity();
    J(7, 6) = lead;
    J(8, 7) = 1;
    Eigen::VectorXd q(10);
    q << state.q.head(8), lead * state.q(7), state.q(8);
    // All generalised forces as inputs: the base's six as a wrench in its own axes.
    Inputs<std::remove_cvref_t<decltype(free)>> unit(free, Start::empty);
    unit.add_wrench("base", Vec3::Zero(), Axes::body);
    for (const char* name : {"between0", "link", "load"}) { unit.add_motor(name); }
    const Answer f = solve(free, unit, q, J * state.qd);
    REQUIRE(f.status == Status::ok);
    const Eigen::MatrixXd M_free = f.Bhat.inverse();
    const Eigen::MatrixXd M = J.transpose() * M_free * J;

    Inputs<std::remove_cvref_t<decltype(one)>> own(one, Start::empty);
    own.add_wrench("base", Vec3::Zero(), Axes::body);
    for (const char* name : {"link", "load"}) { own.add_motor(name); }
    const Answer a = solve(one, own, state.q, state.qd);
    REQUIRE(a.status == Status::ok);
    CHECK(relative_error(a.Bhat, M.inverse()) < tolerance);
    CHECK(relative_error(a.qdd0, M.llt().solve(J.transpose() * (M_free * f.qdd0))) < tolerance);
  }
}

TEST_CASE("A ball is three hinges in other coordinates")
{
  INFO("seed " << seed + 2);
  Random random(seed + 2);
  const Vec3 ex = Vec3::UnitX(), ey = Vec3::UnitY(), ez = Vec3::UnitZ();
  for (int k = 0; k < states; ++k) {
    const Scenario s = scenario(random);
    SphericalLink<double> ball;
    ball.body = s.body;
    const auto one = robot(s, [&](Parts& p) { p.add("link", s.on, ball); });
    const auto three =
        robot(s, [&](Parts& p) { Chain{p, s.on}.then(hinge(ez)).then(hinge(ey)).then(hinge(ex, s.body), true); });
    const RandomState angles = state_of(three, random);
    const double b = angles.q(8), c = angles.q(9);
    const double a1 = angles.qd(6), b1 = angles.qd(7), c1 = angles.qd(8);
    const Mat3 RxT = Eigen::AngleAxisd(-c, ex).toRotationMatrix();
    const Mat3 RyT = Eigen::AngleAxisd(-b, ey).toRotationMatrix();

    // ω = ex ċ + Rxᵀ (ey ḃ + Ryᵀ ez ȧ) in body axes, and its rate for ä = b̈ = c̈ = 0.
    Mat3 E;
    E << RxT * RyT * ez, RxT * ey, ex;
    const Vec3 g1 = RyT * ez * a1;
    const Vec3 turning = -c1 * ex.cross(RxT * (ey * b1 + g1)) + RxT * (-b1 * ey.cross(g1));
    const Eigen::Quaterniond rotation =
        Eigen::AngleAxisd(angles.q(7), ez) * Eigen::AngleAxisd(b, ey) * Eigen::AngleAxisd(c, ex);

    Eigen::VectorXd q(12), qd = angles.qd;
    q << angles.q.head(7), rotation.coeffs(), angles.q(10);
    qd.segment<3>(6) = E * angles.qd.segment<3>(6);
    REQUIRE(std::abs(std::cos(b)) > 0.05);

    const auto only_contacts = [](const auto& tree) {
      auto inputs = contacts_and_motors(tree);
      for (Index id = 0; id < inputs.blocks(); ++id) {
        inputs.set_active(id, inputs.block(id).kind != InputKind::motor);
      }
      return inputs;
    };
    const Answer x = solve(one, only_contacts(one), q, qd);
    Answer y = solve(three, only_contacts(three), angles.q, angles.qd);
    REQUIRE(x.status == Status::ok);
    REQUIRE(y.status == Status::ok);
    y.Bhat.middleRows<3>(6) = Eigen::MatrixXd(E * y.Bhat.middleRows<3>(6));
    y.qdd0.segment<3>(6) = Vec3(E * y.qdd0.segment<3>(6) + turning);
    // Near cos b = 0 the hinges' inertia is nearly singular: one more factor of 1/cos² b on them.
    const double allowed = tolerance / std::pow(std::cos(b), 2);
    CHECK(relative_error(x.qdd0, y.qdd0) < allowed);
    CHECK(relative_error(x.Bhat, y.Bhat) < allowed);

    // Moments on the ball are inputs in body axes: those of a couple on the link, with its reaction on the inlet.
    Inputs<std::remove_cvref_t<decltype(one)>> motors(one), wrenches(one, Start::empty);
    wrenches.add_wrench("link", Vec3::Zero(), Axes::body);
    wrenches.add_wrench("base", s.on.p, Axes::body);
    const Eigen::MatrixXd couple = solve(one, motors, q, qd).Bhat.middleCols<3>(0);
    const Eigen::MatrixXd W = solve(one, wrenches, q, qd).Bhat;
    const Mat3 to_base = s.on.R * rotation.toRotationMatrix();
    CHECK(relative_error(couple, W.middleCols<3>(3) - W.middleCols<3>(9) * to_base) < tolerance);
  }
}

TEST_CASE("a link that has slid far is computed as where it began")
{
  Random random(seed + 3);
  const Vec3 axis = random.axis(), other = axis.cross(random.unit()).normalized();
  const Body<double> body = random.body(), arm = random.body();
  const auto difference = [&](const auto& link, const Eigen::VectorXd& displacement) {
    Parts parts;
    parts.set_gravity(Vec3::Zero());
    parts.add("base", {}, link);
    parts.add("arm", {"base", random.rotation(), random.vector(0.3)}, RevoluteLink<double>{{random.axis()}, arm});
    const DynamicTree tree(parts);
    const Inputs inputs(tree);
    Workspace ws(tree);
    ImplicitInversion method(tree, inputs);
    Eigen::VectorXd q = Eigen::VectorXd::Constant(tree.n_q(), 0.5);
    const Eigen::VectorXd qd = Eigen::VectorXd::Constant(tree.n_v(), 0.7);
    const Eigen::MatrixXd Bhat = method(q, qd, ws).Bhat;
    const Eigen::VectorXd qdd0 = method(q, qd, ws).qdd0;
    q.head(displacement.size()) += displacement;
    const auto far = method(q, qd, ws);
    REQUIRE(far.ok());
    double worst = (far.Bhat - Bhat).norm() / Bhat.norm();
    test::keep_worst(worst, (far.qdd0 - qdd0).norm() / qdd0.norm());
    return worst;
  };
  const double distance = 0x1p20;  // m
  CHECK(difference(PlanarLink<double>{{axis, other}, body}, Eigen::Vector2d(distance, -distance)) < 64 * eps);
  CHECK(difference(CylindricalLink<double>{{axis}, body}, Eigen::Vector2d(0, distance)) < 64 * eps);
}

TEST_CASE("Joints refuse what they cannot be")
{
  const auto refuses = [](auto link, const std::string& words) {
    link.body.mass = 1;
    Assembly<decltype(link)> assembly;
    assembly.add("wrist", {}, link);
    CHECK_THROWS_WITH(DynamicTree(assembly),
                      Catch::Matchers::ContainsSubstring("wrist") && Catch::Matchers::ContainsSubstring(words));
  };
  refuses(HelicalLink<double>{{Vec3(1, 1, 0), 0.1}, {}}, "unit vector");
  refuses(HelicalLink<double>{{Vec3::UnitX(), std::numeric_limits<double>::infinity()}, {}}, "lead");
  refuses(UniversalLink<double>{{Vec3::UnitX(), -Vec3::UnitX()}, {}}, "differ");
  refuses(PlanarLink<double>{{Vec3::UnitX(), Vec3(0.6, 0.8, 0)}, {}}, "perpendicular");

  SphericalLink<double> ball;
  ball.body.mass = 1;
  ball.body.inertia.setIdentity();
  Assembly<SphericalLink<double>> assembly;
  const DynamicTree tree(assembly.add("ball", {}, ball));
  Workspace ws(tree);
  CHECK(forward_dynamics(Eigen::Vector4d(0, 0, 0, 1), Vec3::Zero(), ws).ok());
  const auto receipt = forward_dynamics(Eigen::Vector4d(0, 0, 0, 2), Vec3::Zero(), ws);
  CHECK(receipt.status() == Status::invalid_state);
  CHECK(receipt.subsystem() == 0);
  CHECK(forward_dynamics(neutral(tree), Vec3::Zero(), ws).ok());

  const Vec3 omega(0.2, -0.4, 0.6);
  const Eigen::Vector4d expected(0.1, -0.2, 0.3, 0);
  Eigen::VectorXd rate;
  coordinate_rate(tree, neutral(tree), omega, rate);
  CHECK(rate == expected);
  Eigen::MatrixXd rates = Eigen::MatrixXd::Zero(4, 2);
  coordinate_rate(tree, neutral(tree), omega, rates.col(1));
  CHECK(rates.col(0).isZero(0));
  CHECK(rates.col(1) == expected);

  Eigen::VectorXd stretched(4);
  stretched << 0, 0, 3, 4;
  normalize(tree, stretched);
  CHECK((stretched - Eigen::Vector4d(0, 0, 0.6, 0.8)).norm() < 1e-15);
}
