// PROGRAM: tests_loops
// Four-bar and parallelogram: Newton against the closed form; the cut tree with Lagrange multipliers.
#include "catch.hpp"
#include "type_robots.hpp"

#include <iim/subsystem/four_bar.hpp>

namespace test_type_four_bar {

using namespace iim;
using namespace iim::test;

namespace {

/// A crank that turns all the way round.
FourBar<double> random_linkage(Random& random)
{
  FourBar<double> bars;
  auto& m = bars.mechanism;
  m.plane.normal = random.unit();
  m.plane.x = m.plane.normal.cross(random.unit()).normalized();
  m.ground = Eigen::Vector2d(0.8, 0.6);
  m.crank = 0.4;
  m.coupler = random.uniform(0.8, 0.95);
  m.rocker = random.uniform(0.75, 0.9);
  m.side = random.chance(0.5) ? 1 : -1;
  for (Body<double>& body : bars.body) { body = random.body(); }
  return bars;
}

/// Loop equations of a four-bar, (angle of coupler, of rocker).
auto equations_of(const FourBarLinkage<double>& m)
{
  return [m]<class D>(const std::array<D, 2>& y, const std::array<D, 1>& q) {
    return std::array<D, 2>{
        D(m.crank) * cos(q[0]) + D(m.coupler) * cos(y[0]) - D(m.rocker) * cos(y[1]) - D(m.ground(0)),
        D(m.crank) * sin(q[0]) + D(m.coupler) * sin(y[0]) - D(m.rocker) * sin(y[1]) - D(m.ground(1))};
  };
}

/// Coupler and rocker angle by triangles: distance and angle of B from D, law of cosines.
Eigen::Vector2d angles_by_triangles(const FourBarLinkage<double>& m, double q)
{
  const Eigen::Vector2d B(m.crank * std::cos(q), m.crank * std::sin(q));
  const Eigen::Vector2d d = B - m.ground;
  const double L = d.norm();
  const double at_pivot = std::acos((m.rocker * m.rocker + L * L - m.coupler * m.coupler) / (2 * m.rocker * L));
  const double phi = std::atan2(d.y(), d.x()) + m.side * at_pivot;
  const Eigen::Vector2d C = m.ground + m.rocker * Eigen::Vector2d(std::cos(phi), std::sin(phi));
  return {std::atan2(C.y() - B.y(), C.x() - B.x()), phi};
}

}  // namespace

TEST_CASE("Newton finds what the closed form has, with both derivatives; unreachable and singular are statuses")
{
  Random random(42);
  using D = Dependent<double, 1>;
  for (int k = 0; k < 200; ++k) {
    const FourBarLinkage<double> m = random_linkage(random).mechanism;
    const std::array<D, 1> q{D(random.uniform(-3, 3), Eigen::Matrix<double, 1, 1>(1), random.uniform(-2, 2), 0)};
    const Eigen::Vector2d y = angles_by_triangles(m, q[0].value);
    const auto loop = close_loop<2>(equations_of(m), q, Eigen::Vector2d(y + Vec3(random.vector(0.2)).head<2>()));
    REQUIRE(loop.status == LoopStatus::ok);
    CHECK(loop.iterations <= 8);
    std::array<RelativeMotion<double, 1>, 3> frames;
    REQUIRE(m.place(q, frames));
    for (std::size_t j = 0; j < 2; ++j) {
      // The transmission angle is at least 20°: few roundings are lost in the closure.
      CHECK(std::abs(std::remainder(loop.y[j].value - y(static_cast<Index>(j)), 2 * std::acos(-1.0))) < 100 * eps);
      CHECK(std::abs(frames[j + 1].omega.dot(m.plane.normal) - loop.y[j].rate) < 1000 * eps);
      CHECK(std::abs(frames[j + 1].w.col(0).dot(m.plane.normal) - loop.y[j].gradient(0)) < 1000 * eps);
      CHECK(std::abs(frames[j + 1].alpha.dot(m.plane.normal) - loop.y[j].bias) < 1e4 * eps);
    }
  }

  FourBarLinkage<double> m = random_linkage(random).mechanism;
  m.ground = Eigen::Vector2d(1, 0);
  m.coupler = 0.5;
  m.rocker = 0.5;
  std::array<RelativeMotion<double, 1>, 3> frames;
  const auto at = [](double angle) { return std::array<D, 1>{D(angle, Eigen::Matrix<double, 1, 1>(1), 1, 0)}; };
  CHECK(m.place(at(0.3), frames));
  CHECK(!m.place(at(3), frames));  // B is 1.4 m from D
  CHECK(close_loop<2>(equations_of(m), at(3), Eigen::Vector2d(0, 3)).status != LoopStatus::ok);
  // Coupler and rocker in one line: B 1 m from D, cos q = 0.2 for a crank of 0.4.
  const double dead = std::acos(0.2);
  const double line = std::atan2(-0.4 * std::sin(dead), 1 - 0.4 * std::cos(dead));
  CHECK(!m.place(at(dead), frames));
  CHECK(close_loop<2>(equations_of(m), at(dead), Eigen::Vector2d(line, line + std::acos(-1.0))).status ==
        LoopStatus::singular);
  // In the cycle: a status, and the next good state computes.
  FourBar<double> bars = random_linkage(random);
  bars.mechanism = m;
  Assembly<FourBar<double>> parts;
  const DynamicTree tree(parts.add("knee", {}, bars));
  Workspace ws(tree);
  const auto status = [&](double angle) {
    return forward_dynamics(Eigen::VectorXd::Constant(1, angle), Eigen::VectorXd::Zero(1), ws).status();
  };
  CHECK(status(0.3) == Status::ok);
  CHECK(status(3) == Status::invalid_state);
  CHECK(status(0.3) == Status::ok);
}

TEST_CASE("A four-bar is a cut tree with Lagrange multipliers; a parallelogram is a four-bar")
{
  Random random(43);
  using Parts = Assembly<RevoluteLink<double>, FourBar<double>, Parallelogram<double>>;
  for (int k = 0; k < 100; ++k) {
    FourBar<double> bars = random_linkage(random);
    auto& m = bars.mechanism;
    const bool parallel = k % 2 == 1;
    double q = random.uniform(-3, 3);
    if (parallel) {
      m.coupler = m.ground.norm();
      m.rocker = m.crank;
      const double aside = q - std::atan2(m.ground.y(), m.ground.x());
      if (std::abs(std::sin(aside)) < 0.2) { continue; }  // the cut tree cannot tell a parallelogram from its bow-tie
      m.side = std::sin(aside) > 0 ? -1 : 1;
    }
    const RevoluteLink<double> base{{random.unit()}, random.body()}, load{{random.unit()}, random.body()};
    const Attachment<double> on = random_attachment(random, "base"), load_on = random_attachment(random, "bars", 1);
    const auto linkage = [&](const auto& part) {
      Parts parts;
      return DynamicTree(parts.add("base", {}, base).add("bars", on, part).add("load", load_on, load));
    };
    const Vec3 x = m.plane.x, n = m.plane.normal, y = n.cross(x);
    Parts open;
    open.add("base", {}, base);
    open.add("bars", on, RevoluteLink<double>{{n}, bars.body[0]});
    open.add("coupler", {"bars", Mat3::Identity(), m.crank * x, 0}, RevoluteLink<double>{{n}, bars.body[1]});
    open.add("load", {"coupler", load_on.R, load_on.p, 0}, load);
    open.add("rocker", {"base", on.R, on.R * (m.ground(0) * x + m.ground(1) * y) + on.p, 0},
             RevoluteLink<double>{{n}, bars.body[2]});
    const DynamicTree tree(open);

    // base, crank, coupler relative to the crank, load, rocker
    const Eigen::Vector2d angles = angles_by_triangles(m, q);
    Eigen::VectorXd state(5), rate(5);
    state << random.uniform(-1, 1), q, angles(0) - q, random.uniform(-1, 1), angles(1);
    const double speed = random.uniform(-2, 2);
    // Velocities of C along coupler and rocker: crank ω × AB has no component along the coupler but the rocker's.
    const double rocker = speed * m.crank * std::sin(q - angles(0)) / (m.rocker * std::sin(angles(1) - angles(0)));
    const double coupler = speed * m.crank * std::sin(q - angles(1)) / (m.coupler * std::sin(angles(1) - angles(0)));
    rate << random.uniform(-1, 1), speed, coupler - speed, random.uniform(-1, 1), rocker;
    const auto inputs_of = [](const auto& t) {
      Inputs<std::remove_cvref_t<decltype(t)>> inputs(t, Start::empty);
      for (const char* name : {"base", "bars", "load"}) { inputs.add_motor(name); }
      inputs.add_wrench("load");
      return inputs;
    };
    // In the plane, which turns with the base.
    const Mat3 to_world = Eigen::AngleAxisd(state(0), base.joint.axis) * on.R;
    Eigen::Matrix<double, 3, Eigen::Dynamic> directions(3, 2);
    directions << to_world * x, to_world * y;
    const Multipliers reference =
        cut_loops(tree, inputs_of(tree), {{"coupler", m.coupler * x, "rocker", m.rocker * x, directions}}, state, rate);
    REQUIRE(reference.gap < 100 * eps);
    REQUIRE(reference.speed < 1000 * eps);

    const auto holds = [&](const auto& t) {
      const Eigen::Vector3d q_i(state(0), q, state(3)), qd_i(rate(0), speed, rate(3));
      const Answer answer = solve(t, inputs_of(t), q_i, qd_i);
      REQUIRE(answer.status == Status::ok);
      const std::vector<std::string> names{"base", "bars", "load"};
      // The multipliers go through (J M⁻¹ Jᵀ)⁻¹ and M⁻¹⁻¹: condition numbers of up to 1e3 each.
      CHECK(relative_error(rows_of(t, answer, names), rows_of(tree, reference.answer, names)) < 1e6 * eps);
    };
    holds(linkage(bars));
    if (parallel) {
      // The rods of this one carry the same bodies, the coupler's in axes that do not turn.
      Parallelogram<double> para;
      para.mechanism = {m.plane, m.ground, m.crank};
      const Mat3 turn = Eigen::AngleAxisd(angles(0), n).toRotationMatrix();
      para.body = {bars.body[0], bars.body[1].placed({turn, Vec3::Zero()}), bars.body[2]};
      Parts parts;
      Attachment<double> at = load_on;
      at.R = turn * load_on.R;
      at.p = turn * load_on.p;
      holds(DynamicTree(parts.add("base", {}, base).add("bars", on, para).add("load", at, load)));
    }
  }
}

}  // namespace test_type_four_bar
