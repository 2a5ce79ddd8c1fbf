// PROGRAM: tests_loops
// Slider-crank and actuated lever: the cut tree with Lagrange multipliers, and what they refuse.
#include "catch.hpp"
#include "type_robots.hpp"

#include <iim/subsystem/slider_crank.hpp>

#include <cmath>
#include <numbers>

namespace test_type_slider_crank {

using namespace iim;
using namespace iim::test;

namespace {

Plane<double> random_plane(Random& random)
{
  Plane<double> plane;
  plane.normal = random.unit();
  plane.x = plane.normal.cross(random.unit()).normalized();
  return plane;
}

ActuatedLever<double> random_lever(Random& random)
{
  ActuatedLever<double> lever;
  lever.mechanism = {random_plane(random), {random.uniform(0.2, 0.3), 0.1}, {0.05, random.uniform(0.05, 0.1)}, 1};
  for (Body<double>& body : lever.body) { body = random.body(); }
  lever.body[3] = Body<double>::massless();
  return lever;
}

SliderCrank<double> random_slider(Random& random)
{
  SliderCrank<double> slider;
  slider.mechanism = {random_plane(random), 0.3, random.uniform(0.5, 0.7), random.uniform(-0.1, 0.1),
                      random.chance(0.5) ? 1.0 : -1.0};
  for (Body<double>& body : slider.body) { body = random.body(); }
  return slider;
}

using Parts = Assembly<RevoluteLink<double>, PrismaticLink<double>, SliderCrank<double>, ActuatedLever<double>>;

/// base – mechanism, load on its frame 0; and the tree that is left when the loop is cut.
struct Surroundings {
  RevoluteLink<double> base, load;
  Attachment<double> on, load_on;
  Vec3 x, y, n;

  Surroundings(Random& random, const Plane<double>& plane)
      : base{{random.unit()}, random.body()}, load{{random.unit()}, random.body()},
        on(random_attachment(random, "base")), load_on(random_attachment(random, "crank")), x(plane.x), y(plane.y()),
        n(plane.normal)
  {
  }
  Attachment<double> on_base(double along_x, double along_y) const
  {
    return {"base", on.R, on.R * (along_x * x + along_y * y) + on.p, 0};
  }
  Eigen::Matrix<double, 3, Eigen::Dynamic> directions(double base_angle) const
  {
    const Mat3 to_world = Eigen::AngleAxisd(base_angle, base.joint.axis) * on.R;
    Eigen::Matrix<double, 3, Eigen::Dynamic> d(3, 2);
    d << to_world * x, to_world * y;
    return d;
  }
};

template <class Tree>
Inputs<Tree> inputs_of(const Tree& tree, const std::string& drive)
{
  Inputs<Tree> inputs(tree, Start::empty);
  for (const std::string& name : {std::string("base"), drive, std::string("load")}) { inputs.add_motor(name); }
  inputs.add_wrench("load");
  return inputs;
}

// The multipliers go through (J M⁻¹ Jᵀ)⁻¹ and M⁻¹⁻¹: condition numbers of up to 1e3 each.
constexpr double tolerance = 1e6 * eps;

}  // namespace

TEST_CASE("An actuated lever is a cut tree with Lagrange multipliers")
{
  Random random(52);
  for (int k = 0; k < 100; ++k) {
    const ActuatedLever<double> lever = random_lever(random);
    const auto& m = lever.mechanism;
    const Surroundings s(random, m.plane);
    Parts closed, open;
    closed.add("base", {}, s.base).add("crank", s.on, lever).add("load", s.load_on, s.load);
    open.add("base", {}, s.base);
    open.add("crank", s.on, RevoluteLink<double>{{s.n}, lever.body[0]}).add("load", s.load_on, s.load);
    open.add("cylinder", s.on_base(m.pivot(0), m.pivot(1)), RevoluteLink<double>{{s.n}, lever.body[1]});
    open.add("piston", {"cylinder"}, PrismaticLink<double>{{s.x}, lever.body[2]});
    const DynamicTree a(closed), b(open);
    // By triangles: length and direction of the actuator, and their rates.
    const double q = random.uniform(-1, 1), qd = random.uniform(-2, 2);
    const Eigen::Vector2d C = Eigen::Rotation2Dd(q) * m.pin, way = C - m.pivot,
                          Cdot = qd * Eigen::Vector2d(-C.y(), C.x());
    const double length = way.norm();
    Eigen::VectorXd state(5), rate(5);
    state << random.uniform(-1, 1), q, random.uniform(-1, 1), std::atan2(way.y(), way.x()), length;
    rate << random.uniform(-1, 1), qd, random.uniform(-1, 1),
        (way.x() * Cdot.y() - way.y() * Cdot.x()) / length / length, way.dot(Cdot) / length;
    const Multipliers reference = cut_loops(
        b, inputs_of(b, "piston"),
        {{"piston", Vec3::Zero(), "crank", m.pin(0) * s.x + m.pin(1) * s.y, s.directions(state(0))}}, state, rate);
    REQUIRE(reference.gap < 100 * eps);
    REQUIRE(reference.speed < 1000 * eps);
    const Answer answer = solve(a, inputs_of(a, "crank"), state.head(3), rate.head(3));
    REQUIRE(answer.status == Status::ok);
    const std::vector<std::string> names{"base", "crank", "load"};
    CHECK(relative_error(rows_of(a, answer, names), rows_of(b, reference.answer, names)) < tolerance);
  }
}

TEST_CASE("Close to a dead centre float refuses rather than lose all digits")
{
  SliderCrankLinkage<float> m;  // with a rod as long as the crank the slider is at 2 cos q
  m.crank = m.rod = 1;
  m.prepare("slider");
  std::array<RelativeMotion<float, 1>, 3> frames;
  int refused = 0, computed = 0;
  for (int k = 1; k <= 400; ++k) {
    const Eigen::Matrix<float, 1, 1> q(static_cast<float>(std::numbers::pi / 2 - 2.5e-4 * k)), qd(1);
    const bool ok = m.place(independent<float, 1>(q, qd), frames);
    ++(ok ? computed : refused);
    if (!ok) { continue; }
    CHECK(std::abs(frames[2].v.col(0).norm() / (2 * std::sin(q(0))) - 1) < 1e-3F);
  }
  CHECK(refused > 40);
  CHECK(computed > 300);
}

TEST_CASE("A slider-crank is a cut tree with Lagrange multipliers, and refuses what it cannot reach")
{
  Random random(53);
  for (int k = 0; k < 100; ++k) {
    const SliderCrank<double> slider = random_slider(random);
    const auto& m = slider.mechanism;
    const Surroundings s(random, m.plane);
    Parts closed, open;
    closed.add("base", {}, s.base).add("crank", s.on, slider).add("load", s.load_on, s.load);
    open.add("base", {}, s.base);
    open.add("crank", s.on, RevoluteLink<double>{{s.n}, slider.body[0]}).add("load", s.load_on, s.load);
    open.add("rod", {"crank", Mat3::Identity(), m.crank * s.x, 0}, RevoluteLink<double>{{s.n}, slider.body[1]});
    open.add("slider", s.on_base(0, m.offset), PrismaticLink<double>{{s.x}, slider.body[2]});
    const DynamicTree a(closed), b(open);
    const double q = random.uniform(-3, 3), qd = random.uniform(-2, 2);
    const double sine = (m.offset - m.crank * std::sin(q)) / m.rod;
    const double angle = m.side > 0 ? std::asin(sine) : std::acos(-1.0) - std::asin(sine);
    const double turning = -m.crank * std::cos(q) * qd / (m.rod * std::cos(angle));
    // base, crank, rod or load (whichever was added first), slider
    Eigen::VectorXd state(5), rate(5);
    state << random.uniform(-1, 1), q, random.uniform(-1, 1), angle - q,
        m.crank * std::cos(q) + m.rod * std::cos(angle);
    rate << random.uniform(-1, 1), qd, random.uniform(-1, 1), turning - qd,
        -m.crank * std::sin(q) * qd - m.rod * std::sin(angle) * turning;
    const Multipliers reference = cut_loops(
        b, inputs_of(b, "crank"), {{"slider", Vec3::Zero(), "rod", m.rod * s.x, s.directions(state(0))}}, state, rate);
    REQUIRE(reference.gap < 100 * eps);
    REQUIRE(reference.speed < 1000 * eps);
    const Answer answer = solve(a, inputs_of(a, "crank"), state.head(3), rate.head(3));
    REQUIRE(answer.status == Status::ok);
    const std::vector<std::string> names{"base", "crank", "load"};
    CHECK(relative_error(rows_of(a, answer, names), rows_of(b, reference.answer, names)) < tolerance);
  }

  SliderCrankLinkage<double> short_rod{{}, 0.3, 0.2, 0, 1};
  std::array<RelativeMotion<double, 1>, 3> frames;
  const auto at = [](double angle) {
    return std::array<Dependent<double, 1>, 1>{{{angle, Eigen::Matrix<double, 1, 1>(1), 1, 0}}};
  };
  CHECK(short_rod.place(at(0.5), frames));
  CHECK(!short_rod.place(at(1.2), frames));
  short_rod.rod = -1;
  CHECK_THROWS_WITH(short_rod.prepare("knee"), Catch::Matchers::ContainsSubstring("knee: rod must be positive"));
}

}  // namespace test_type_slider_crank
