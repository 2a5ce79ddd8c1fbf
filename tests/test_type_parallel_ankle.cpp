// PROGRAM: tests_loops
// Parallel ankle: the laws, and the cut tree with its two rods as bodies of their own.
#include "catch.hpp"
#include "type_robots.hpp"

#include <iim/law_suite.hpp>
#include <iim/subsystem/joint_more.hpp>
#include <iim/subsystem/parallel_ankle.hpp>

using namespace iim;
using namespace iim::test;

namespace {

/// An ankle in the manner of human size: motors above each other in the shank, rods to the heel's two sides.
ParallelAnkle<double> random_ankle(Random& random)
{
  ParallelAnkle<double> ankle;
  auto& m = ankle.mechanism;
  for (std::size_t k = 0; k < 2; ++k) {
    const double y = k == 0 ? 0.04 : -0.04;
    auto& r = m.rod[k];
    r.hinge = Vec3(0.01, y, k == 0 ? 0.25 : 0.18) + random.vector(0.01);
    r.axis = (Vec3::UnitY() + random.vector(0.1)).normalized();
    const Vec3 back = -Vec3::UnitX();
    r.crank = 0.07 * (back - r.axis * r.axis.dot(back)).normalized();
    r.foot = Vec3(-0.05, y, 0.01) + random.vector(0.01);
    r.rod = (r.hinge + r.crank - r.foot).norm();  // so that crank and foot angles are zero together
    r.side = 1;
    r.rod_mass = random.uniform(0.1, 0.4);
    r.gear_ratio = random.uniform(5, 10);
    r.rotor_inertia = random.uniform(1e-4, 1e-3);
  }
  for (std::size_t k = 0; k < 3; ++k) { ankle.body[k] = random.body(); }
  return ankle;
}

constexpr double range = 0.5;  // [rad]; rods and cranks stay 30° off their dead centres

}  // namespace

TEST_CASE("A parallel ankle obeys the laws")
{
  Random random(61);
  LawOptions<ParallelAnkle<double>> options;
  options.range = range;
  const LawReport report = check_laws(random_ankle(random), options);
  INFO(report.text());
  CHECK(report.ok());
}

TEST_CASE("A parallel ankle is a cut tree with Lagrange multipliers")
{
  Random random(62);
  using Parts = Assembly<RevoluteLink<double>, MotorArm<double>, UniversalLink<double>, ParallelAnkle<double>>;
  for (int k = 0; k < 100; ++k) {
    const ParallelAnkle<double> ankle = random_ankle(random);
    const auto& m = ankle.mechanism;
    const RevoluteLink<double> base{{random.unit()}, random.body()}, load{{random.unit()}, random.body()};
    const Attachment<double> on = random_attachment(random, "base"), load_on = random_attachment(random, "foot");
    Parts closed, open;
    FrameMass<double> shank;  // the rotors of 0.3 kg are parts of it in the closed tree
    shank.add(base.body);
    for (const auto& r : m.rod) { shank.add({0.3, on.R * r.hinge + on.p, Mat3::Zero(), false}); }
    closed.add("base", {}, RevoluteLink<double>{base.joint, {shank.mass, shank.com, shank.central_inertia, false}});
    closed.add("foot", on, ankle).add("load", load_on, load);

    Eigen::Vector4d q, qd;
    for (Index j = 0; j < 4; ++j) {
      q(j) = random.uniform(-range, range);
      qd(j) = random.uniform(-2, 2);
    }
    std::array<RelativeMotion<double, 2>, 7> frames;
    REQUIRE(m.place(independent<double, 2>(Eigen::Vector2d::Zero(), Eigen::Vector2d::Zero()), frames));
    REQUIRE((frames[1].R - Mat3::Identity()).norm() < 100 * eps);  // the branch on which all angles are zero together
    REQUIRE(m.place(independent<double, 2>(q.segment<2>(1), qd.segment<2>(1)), frames));
    const auto cranks = m.cranks(independent<double, 2>(q.segment<2>(1), qd.segment<2>(1)));

    open.add("base", {}, base);
    open.add("foot", on, UniversalLink<double>{{m.first, m.second}, ankle.body[0]}).add("load", load_on, load);
    Eigen::VectorXd state(10), rate(10);
    state.head<4>() = q;
    rate.head<4>() = qd;
    std::vector<Cut> cuts;
    for (std::size_t j = 0; j < 2; ++j) {
      const auto& r = m.rod[j];
      const std::string crank = "crank" + std::to_string(j), rod = "rod" + std::to_string(j);
      const Motor<double> motor{r.gear_ratio, r.rotor_inertia, r.axis, 0.3, Vec3::Zero(), r.rotor_inertia / 2, false};
      open.add(crank, {"base", on.R, on.R * r.hinge + on.p, 0}, MotorArm<double>{{r.axis}, ankle.body[j + 1], motor});
      // Rod along z of a universal joint, whose z is the rod for zero angles.
      Mat3 turn;
      turn.col(2) = (r.foot - r.hinge - r.crank).normalized();
      turn.col(0) = r.axis.cross(turn.col(2)).normalized();
      turn.col(1) = turn.col(2).cross(turn.col(0));
      Body<double> slender{r.rod_mass, Vec3(0, 0, r.rod / 2), Mat3::Zero(), false};
      slender.inertia(0, 0) = slender.inertia(1, 1) = r.rod_mass * r.rod * r.rod / 12;
      open.add(rod, {crank, turn, r.crank, 0}, UniversalLink<double>{{Vec3::UnitX(), Vec3::UnitY()}, slender});
      cuts.push_back({rod, Vec3(0, 0, r.rod), "foot", r.foot, Mat3::Identity()});

      const RelativeMotion<double, 2>& c = frames[j + 1];
      const RelativeMotion<double, 2> pin = c.at(r.crank), end = frames[0].at(r.foot);
      const Mat3 to_joint = (c.R * turn).transpose();
      const Vec3 d = to_joint * (end.p - pin.p) / r.rod;
      const Vec3 ddot = to_joint * (end.velocity - pin.velocity - c.omega.cross(end.p - pin.p)) / r.rod;
      const Index at = 4 + 3 * static_cast<Index>(j);
      state.segment<3>(at) << cranks[j].value, std::atan2(-d.y(), d.z()), std::asin(d.x());
      rate.segment<3>(at) << cranks[j].rate, (d.y() * ddot.z() - d.z() * ddot.y()) / (d.y() * d.y() + d.z() * d.z()),
          ddot.x() / std::cos(std::asin(d.x()));
    }
    const DynamicTree a(closed), b(open);
    Inputs of_a(a, Start::empty);
    auto of_b = decltype(of_a)(b, Start::empty);
    for (auto* inputs : {&of_a, &of_b}) {
      inputs->add_motor("base");
      inputs->add_motor("load");
      inputs->add_wrench("load");
    }
    of_a.add_motor("foot");
    of_b.add_motor("crank0");
    of_b.add_motor("crank1");
    const Multipliers reference = cut_loops(b, of_b, cuts, state, rate);
    REQUIRE(reference.gap < 100 * eps);
    REQUIRE(reference.speed < 1000 * eps);
    const Answer answer = solve(a, of_a, q, qd);
    REQUIRE(answer.status == Status::ok);
    const std::vector<std::string> names{"base", "foot", "load"};
    // The multipliers go through (J M⁻¹ Jᵀ)⁻¹ and M⁻¹⁻¹ with rods that are light: condition numbers of up to 1e5.
    CHECK(relative_error(rows_of(a, answer, names), rows_of(b, reference.answer, names)) < 1e7 * eps);
  }
}

TEST_CASE("A parallel ankle refuses what its rods cannot reach, and wrong parameters")
{
  Random random(63);
  ParallelAnkle<double> ankle = random_ankle(random);
  for (PushRod<double>& r : ankle.mechanism.rod) {  // 0.02 m of crank do not follow 0.05 m of foot
    r.crank *= 0.02 / 0.07;
    r.rod = (r.hinge + r.crank - r.foot).norm();
  }
  Assembly<ParallelAnkle<double>> parts;
  const DynamicTree tree(parts.add("ankle", {}, ankle));
  Workspace ws(tree);
  const auto status = [&](double first) {
    return forward_dynamics(Eigen::Vector2d(first, 0), Eigen::Vector2d::Zero(), ws).status();
  };
  CHECK(status(0.2) == Status::ok);
  CHECK(status(1.4) == Status::invalid_state);
  CHECK(status(-1.4) == Status::invalid_state);
  CHECK(status(0.2) == Status::ok);
  const auto refuses = [&](auto change, const std::string& words) {
    ParallelAnkle<double> wrong = ankle;
    change(wrong.mechanism.rod[1]);
    Assembly<ParallelAnkle<double>> assembly;
    assembly.add("ankle", {}, wrong);
    CHECK_THROWS_WITH(DynamicTree(assembly), Catch::Matchers::ContainsSubstring("ankle': push-rod 1") &&
                                                 Catch::Matchers::ContainsSubstring(words));
  };
  refuses([](PushRod<double>& r) { r.rod = -0.2; }, "-0.2");
  refuses([](PushRod<double>& r) { r.crank = 0.05 * r.axis; }, "perpendicular");
  refuses([](PushRod<double>& r) { r.side = 0; }, "side");
  refuses([](PushRod<double>& r) { r.rotor_inertia = -1; }, "negative");
}
