// REQUIRES: mujoco
// PROGRAM: tests_loops
// Plane loops and MuJoCo: four-bar and slider-crank as cut trees, closed by its equality constraints.
#include "catch.hpp"
#include "type_mujoco.hpp"
#include "worst.hpp"

#include <iim/subsystem/four_bar.hpp>
#include <iim/subsystem/slider_crank.hpp>

namespace test_type_mujoco_loops {

using namespace iim;
using namespace iim::test;

namespace {

constexpr int states = 100;
constexpr std::uint64_t seed = 81;

// Both sides lose digits by the condition number of M, up to 1e3 for bodies of 0.1–10 kg a metre apart, and MuJoCo's by
// that of the loops' compliance J M⁻¹ Jᵀ, up to ten for bars of these lengths.
constexpr double tolerance = 1e4 * eps;

Plane<double> random_plane(Random& random)
{
  Plane<double> plane;
  plane.normal = random.unit();
  plane.x = plane.normal.cross(random.unit()).normalized();
  return plane;
}

/// base – mechanism under the name "crank", with a load on its frame 0. The tree of bodies that MuJoCo gets has the
/// same base, crank and load, and `rest`, whose bodies follow from the loop.
struct Surroundings {
  RevoluteLink<double> base, load;
  Attachment<double> on, load_on;
  Vec3 gravity;

  explicit Surroundings(Random& random)
      : base{{random.unit()}, random.body()}, load{{random.unit()}, random.body()},
        on(random_attachment(random, "base")), load_on(random_attachment(random, "crank")), gravity(random.vector(10))
  {
  }

  /// Largest difference of the rows of base, crank and load. `guess`: coordinates of the bodies in `rest`.
  template <class Mechanism>
  double difference(Random& random, const Mechanism& mechanism, double q_crank, std::vector<MujocoPart> parts,
                    const std::vector<Connection>& loops, const std::vector<std::pair<std::string, double>>& guess,
                    const std::string& driven)
  {
    Assembly<RevoluteLink<double>, FourBar<double>, SliderCrank<double>, ActuatedLever<double>> assembly;
    assembly.add("base", {}, base).add("crank", on, mechanism).add("load", load_on, load);
    assembly.set_gravity(gravity);
    const DynamicTree tree(assembly);
    Inputs inputs(tree);
    inputs.add_wrench("load");
    const Eigen::Vector3d q(random.uniform(-3, 3), q_crank, random.uniform(-3, 3));
    const Eigen::Vector3d qd(random.uniform(-2, 2), random.uniform(-2, 2), random.uniform(-2, 2));
    const Answer answer = test::solve(tree, inputs, q, qd);
    REQUIRE(answer.status == Status::ok);

    parts.push_back({"base", "", {}, {{"hinge", base.joint.axis}}, base.body});
    parts.push_back({"load", "crank", {load_on.R, load_on.p}, {{"hinge", load.joint.axis}}, load.body});
    MujocoRobot robot(parts, loops, {}, gravity);
    Eigen::VectorXd x = Eigen::VectorXd::Zero(robot.n_q()), xd = Eigen::VectorXd::Zero(robot.n_v());
    const std::vector<std::string> names{"base", "crank", "load"};
    for (Index k = 0; k < 3; ++k) {
      const std::string& name = names[static_cast<std::size_t>(k)];
      x(robot.q_of(name)) = q(k);
      xd(robot.v_of(name)) = qd(k);
    }
    std::vector<Index> dependent;
    for (const auto& [name, value] : guess) {
      x(robot.q_of(name)) = value;
      dependent.push_back(robot.v_of(name));
    }
    REQUIRE(robot.close(x, xd, dependent));
    Eigen::MatrixXd B = Eigen::MatrixXd::Zero(robot.n_v(), 9);
    B(robot.v_of("base"), 0) = B(robot.v_of(driven), 1) = B(robot.v_of("load"), 2) = 1;
    B.rightCols(6) = robot.wrench("load");
    return relative_error(rows_of(tree, answer, names), robot.rows_of(robot.solve(x, xd, B), names));
  }
};

/// To a tenth: which of the two ways to close is meant, and no more.
double rough(double x) { return std::round(10 * x) / 10; }

Placement<double> placed(const Surroundings& s, const Vec3& point) { return {s.on.R, s.on.R * point + s.on.p}; }

}  // namespace

TEST_CASE("A four-bar is what MuJoCo has for crank, coupler and rocker with a connect constraint")
{
  INFO("seed " << seed);
  Random random(seed);
  double worst = 0;
  for (int k = 0; k < states; ++k) {
    FourBar<double> bars;
    auto& m = bars.mechanism;
    m = {random_plane(random),           {0.8, 0.6}, 0.4, random.uniform(0.8, 0.95), random.uniform(0.75, 0.9),
         random.chance(0.5) ? 1.0 : -1.0};
    for (Body<double>& body : bars.body) { body = random.body(); }
    Surroundings around(random);
    const Vec3 x = m.plane.x, n = m.plane.normal, y = n.cross(x);
    const double q = random.uniform(-3, 3);
    // Triangle D B C, by the law of cosines.
    const Eigen::Vector2d B = m.crank * Eigen::Vector2d(std::cos(q), std::sin(q)), d = B - m.ground;
    const double L = d.norm();
    const double rocker =
        std::atan2(d.y(), d.x()) +
        m.side * std::acos((m.rocker * m.rocker + L * L - m.coupler * m.coupler) / (2 * m.rocker * L));
    const Eigen::Vector2d C = m.ground + m.rocker * Eigen::Vector2d(std::cos(rocker), std::sin(rocker));
    const double coupler = std::atan2(C.y() - B.y(), C.x() - B.x());
    keep_worst(
        worst,
        around.difference(
            random, bars, q,
            {{"crank", "base", placed(around, Vec3::Zero()), {{"hinge", n}}, bars.body[0]},
             {"coupler", "crank", {Mat3::Identity(), m.crank * x}, {{"hinge", n}}, bars.body[1]},
             {"rocker", "base", placed(around, m.ground(0) * x + m.ground(1) * y), {{"hinge", n}}, bars.body[2]}},
            {{"coupler", m.coupler * x, "rocker", m.rocker * x}},
            {{"coupler", rough(coupler - q)}, {"rocker", rough(rocker)}}, "crank"));
  }
  INFO("largest difference " << worst);
  CHECK(worst < tolerance);
}

TEST_CASE("A slider-crank is what MuJoCo has for crank, rod and slider with a connect constraint")
{
  INFO("seed " << seed + 1);
  Random random(seed + 1);
  double worst = 0;
  for (int k = 0; k < states; ++k) {
    SliderCrank<double> slider;
    auto& m = slider.mechanism;
    m = {random_plane(random), 0.3, random.uniform(0.5, 0.7), random.uniform(-0.1, 0.1),
         random.chance(0.5) ? 1.0 : -1.0};
    for (Body<double>& body : slider.body) { body = random.body(); }
    Surroundings around(random);
    const Vec3 x = m.plane.x, n = m.plane.normal, y = n.cross(x);
    const double q = random.uniform(-3, 3);
    const double sine = (m.offset - m.crank * std::sin(q)) / m.rod;
    const double rod = m.side > 0 ? std::asin(sine) : std::acos(-1.0) - std::asin(sine);
    const double reach = m.crank * std::cos(q) + m.rod * std::cos(rod);
    keep_worst(worst,
               around.difference(random, slider, q,
                                 {{"crank", "base", placed(around, Vec3::Zero()), {{"hinge", n}}, slider.body[0]},
                                  {"rod", "crank", {Mat3::Identity(), m.crank * x}, {{"hinge", n}}, slider.body[1]},
                                  {"slider", "base", placed(around, m.offset * y), {{"slide", x}}, slider.body[2]}},
                                 {{"rod", m.rod * x, "slider", Vec3::Zero()}},
                                 {{"rod", rough(rod - q)}, {"slider", rough(reach)}}, "crank"));
  }
  INFO("largest difference " << worst);
  CHECK(worst < tolerance);
}

TEST_CASE("An actuated lever is what MuJoCo has for lever, cylinder and piston with a connect constraint")
{
  INFO("seed " << seed + 2);
  Random random(seed + 2);
  double worst = 0;
  for (int k = 0; k < states; ++k) {
    ActuatedLever<double> lever;
    auto& m = lever.mechanism;
    m = {random_plane(random), {random.uniform(0.2, 0.3), 0.1}, {0.05, random.uniform(0.05, 0.1)}, 1};
    for (Body<double>& body : lever.body) { body = random.body(); }
    lever.body[3] = Body<double>::massless();
    Surroundings around(random);
    const Vec3 x = m.plane.x, n = m.plane.normal, y = n.cross(x);
    const double q = random.uniform(-1, 1);
    const Eigen::Vector2d way = Eigen::Rotation2Dd(q) * m.pin - m.pivot;
    keep_worst(
        worst,
        around.difference(
            random, lever, q,
            {{"crank", "base", placed(around, Vec3::Zero()), {{"hinge", n}}, lever.body[0]},
             {"cylinder", "base", placed(around, m.pivot(0) * x + m.pivot(1) * y), {{"hinge", n}}, lever.body[1]},
             {"piston", "cylinder", {}, {{"slide", x}}, lever.body[2]}},
            {{"piston", Vec3::Zero(), "crank", m.pin(0) * x + m.pin(1) * y}},
            {{"cylinder", rough(std::atan2(way.y(), way.x()))}, {"piston", rough(way.norm())}}, "piston"));
  }
  INFO("largest difference " << worst);
  CHECK(worst < tolerance);
}

}  // namespace test_type_mujoco_loops
