// PROGRAM: tests_loops
// What a loop cannot do comes back as a status: of the closure itself, and of the cycle for each mechanism with a loop.
#include "catch.hpp"
#include "type_robots.hpp"
#include "worst.hpp"

#include <iim/subsystem/four_bar.hpp>
#include <iim/subsystem/parallel_ankle.hpp>
#include <iim/subsystem/slider_crank.hpp>

namespace test_type_loop_status {

using namespace iim;
using namespace iim::test;

namespace {

using Parts =
    Assembly<RevoluteLink<double>, FourBar<double>, SliderCrank<double>, ActuatedLever<double>, ParallelAnkle<double>>;

Body<double> box() { return {1, Vec3(0.1, 0, 0), 0.02 * Mat3::Identity(), false}; }

/// A hinge that carries the mechanism: number 1 in the tree. Its states in turn, good ones (true) and such as it
/// refuses.
template <class Mechanism>
void answers(Mechanism mechanism, const std::vector<std::pair<Eigen::VectorXd, bool>>& states)
{
  for (Body<double>& body : mechanism.body) { body = box(); }
  Parts parts;
  const DynamicTree tree(
      parts.add("base", {}, RevoluteLink<double>{{Vec3::UnitY()}, box()}).add("loop", {"base"}, mechanism));
  const Inputs inputs(tree);
  Workspace ws(tree);
  ImplicitInversion method(tree, inputs);
  Eigen::MatrixXd first;
  for (const auto& [q_loop, good] : states) {
    Eigen::VectorXd q = Eigen::VectorXd::Zero(tree.n_q()), qd = Eigen::VectorXd::Ones(tree.n_v());
    q.tail(q_loop.size()) = q_loop;
    const auto receipt = forward_dynamics(q, qd, ws);
    const auto answer = method(receipt);
    INFO("q = " << q_loop.transpose());
    CHECK(receipt.ok() == good);
    CHECK(answer.ok() == good);
    if (good) {
      CHECK(answer.qdd0.allFinite());
      CHECK(answer.Bhat.allFinite());
      // Nothing stays behind of the refused states in between.
      if (q_loop == states[0].first && first.size() > 0) { CHECK(answer.Bhat == first); }
      if (first.size() == 0) { first = answer.Bhat; }
    } else {
      CHECK(receipt.status() == Status::invalid_state);
      CHECK(receipt.subsystem() == 1);
      CHECK(answer.qdd0.array().isNaN().all());
      CHECK(answer.Bhat.array().isNaN().all());
    }
  }
}

Eigen::VectorXd at(double q) { return Eigen::VectorXd::Constant(1, q); }

}  // namespace

TEST_CASE("The point where two bars meet: found, singular where they are in line, unreachable beyond")
{
  using D = Dependent<double, 1>;
  const auto meet = [](double distance, PlanePoint<double, 1>& C) {
    return meeting_point<double, 1>({D(0), D(0)}, 0.5, {D(distance), D(0)}, 0.5, 1, C);
  };
  PlanePoint<double, 1> C;
  CHECK(meet(0.6, C) == LoopStatus::ok);
  CHECK(std::abs(C.x.value - 0.3) < 4 * eps);
  CHECK(std::abs(C.y.value - 0.4) < 4 * eps);
  CHECK(meet(1 - 1e-9, C) == LoopStatus::ok);         // first derivatives have lost five digits
  CHECK(meet(1 - 1e-10, C) == LoopStatus::singular);  // and second ones are not known to have any
  CHECK(meet(1 + 1e-13, C) == LoopStatus::unreachable);
  CHECK(meet(1.4, C) == LoopStatus::unreachable);
}

TEMPLATE_TEST_CASE("A short bar at the end of a long one is no dead centre", "", float, double)
{
  using D = Dependent<TestType, 1>;
  const TestType b = TestType(1) / 64, zero(0), one(1), eps = std::numeric_limits<TestType>::epsilon();
  const PlanePoint<TestType, 1> A{D(zero), D(zero)}, B{D(one), D(zero)};
  PlanePoint<TestType, 1> C;
  for (const TestType side : {one, -one}) {
    REQUIRE(meeting_point<TestType, 1>(A, one, B, b, side, C) == LoopStatus::ok);
    CHECK(std::abs(C.x.value - (1 - b * b / 2)) <= eps);
    CHECK(std::abs(C.y.value - side * b * std::sqrt(1 - b * b / 4)) <= 4 * eps * b);
    REQUIRE(meeting_point<TestType, 1>(A, b, B, one, side, C) == LoopStatus::ok);
    CHECK(std::abs(C.x.value - b * b / 2) <= eps * b);
    CHECK(std::abs(C.y.value - side * b * std::sqrt(1 - b * b / 4)) <= 4 * eps * b);
  }
  // Two bars whose ends are almost in one place: as long, they turn about it freely.
  const PlanePoint<TestType, 1> near{D(eps), D(zero)};
  CHECK(meeting_point<TestType, 1>(A, one, near, one, one, C) == LoopStatus::singular);
}

TEMPLATE_TEST_CASE("Newton's closure does not take the roundings of a loop far off for a dead centre", "", float,
                   double)
{
  // Bars of 1.2 and some 1.3 m, nearly in line, 10 m from the origin.
  using D = Dependent<TestType, 1>;
  const double bar = 1.2, ground = 2.5;
  for (const double slack : {0.1, 0.01}) {
    int refused = 0;
    double worst = 0;
    for (int k = 0; k < 1000; ++k) {
      const double angle = 0.3 + 1.7e-3 * k, x = ground - std::cos(angle), y = -std::sin(angle);
      const double way = std::hypot(x, y), other = way * (1 + slack) - bar;
      const auto equations = [&]<class T>(const std::array<T, 2>& turned, const std::array<T, 1>& q) {
        const auto number = [](double value) { return T(TestType(value)); };
        return std::array<T, 2>{
            number(10) + cos(q[0]) + cos(turned[0]) * number(bar) - cos(turned[1]) * number(other) -
                number(10 + ground),
            number(10) + sin(q[0]) + sin(turned[0]) * number(bar) - sin(turned[1]) * number(other) - number(10)};
      };
      const double at_bar = std::acos((way * way + bar * bar - other * other) / (2 * way * bar)),
                   at_other = std::acos((way * way + other * other - bar * bar) / (2 * way * other)),
                   along = std::atan2(y, x);
      const Eigen::Vector2d exact(along + at_bar, along + std::acos(-1.0) - at_other);
      const auto loop = close_loop<2>(
          equations, std::array<D, 1>{D(TestType(angle), Eigen::Matrix<TestType, 1, 1>(1), TestType(1), TestType(0))},
          Eigen::Matrix<TestType, 2, 1>(exact.cast<TestType>() + Eigen::Matrix<TestType, 2, 1>::Constant(0.01f)));
      refused += loop.status != LoopStatus::ok;
      for (std::size_t i = 0; i < 2; ++i) {
        keep_worst(worst, std::abs(static_cast<double>(loop.y[i].value) - exact(static_cast<Index>(i))));
      }
    }
    CHECK(refused == 0);
    CHECK(worst < 1000 * std::numeric_limits<TestType>::epsilon());  // the sine between the bars is 0.1 or more
  }
}

TEST_CASE("Newton's closure: unreachable and singular are different statuses")
{
  using D = Dependent<double, 1>;
  // y² = 1 − q²: two ways for |q| < 1, one with no derivative at 1, none beyond.
  const auto circle = []<class T>(const std::array<T, 1>& y, const std::array<T, 1>& q) {
    return std::array<T, 1>{y[0] * y[0] + q[0] * q[0] - T(1)};
  };
  const auto close = [&](double q, double start) {
    return close_loop<1>(circle, std::array<D, 1>{D(q, Eigen::Matrix<double, 1, 1>(1), 1, 0)},
                         Eigen::Matrix<double, 1, 1>(start));
  };
  for (const double side : {1.0, -1.0}) {
    const auto loop = close(0.6, side);
    REQUIRE(loop.status == LoopStatus::ok);
    CHECK(std::abs(loop.y[0].value - side * 0.8) < 4 * eps);
    CHECK(std::abs(loop.y[0].gradient(0) + side * 0.75) < 8 * eps);         // −q/y
    CHECK(std::abs(loop.y[0].bias + side / (0.8 * 0.8 * 0.8)) < 32 * eps);  // −1/y³
  }
  CHECK(close(1, 0.5).status == LoopStatus::singular);
  CHECK(close(2, 0.5).status == LoopStatus::unreachable);
}

TEST_CASE("A four-bar refuses angles out of reach and dead centres")
{
  FourBar<double> bars;
  bars.mechanism = {{}, {1, 0}, 0.4, 0.5, 0.5, 1};
  const double dead = std::acos(0.2);  // B is 1 m from D there, coupler and rocker in line
  answers(
      bars,
      {{at(0.3), true}, {at(3), false}, {at(0.3), true}, {at(dead), false}, {at(dead - 1e-3), true}, {at(0.3), true}});
}

TEST_CASE("Where a four-bar folds up q̈₀ is right or refused")
{
  // Opposite bars are as long: a parallelogram, whose other way to go begins at q = 0.
  FourBar<double> bars;
  bars.mechanism = {{}, {1, 0}, 0.3, 1, 0.3, -1};
  Parallelogram<double> same;
  same.mechanism = {{}, {1, 0}, 0.3};
  for (std::size_t k = 0; k < bars.body.size(); ++k) { bars.body[k] = same.body[k] = box(); }
  using One = Assembly<FourBar<double>>;
  using Other = Assembly<Parallelogram<double>>;
  const DynamicTree tree(One().add("loop", {}, bars).set_gravity({0, -9.81, 0}));
  const DynamicTree other_tree(Other().add("loop", {}, same).set_gravity({0, -9.81, 0}));
  Workspace ws(tree);
  Workspace other_ws(other_tree);
  const Eigen::VectorXd qd = Eigen::VectorXd::Ones(1);
  int right = 0, refused = 0;
  for (double q = 1; q > 1e-7; q /= 1.3) {
    CAPTURE(q);
    const auto fd = forward_dynamics(at(q), qd, ws);
    const auto expected = forward_dynamics(at(q), qd, other_ws);
    REQUIRE(expected.ok());
    if (!fd.ok()) {
      ++refused;
      CHECK(fd.status() == Status::invalid_state);
      continue;
    }
    ++right;
    CHECK(std::abs(fd.qdd0()(0) - expected.qdd0()(0)) < 0.01 * std::abs(expected.qdd0()(0)));
  }
  CHECK(right > 30);
  CHECK(refused > 10);
}

TEST_CASE("Where a lever's pin comes to its pivot q̈₀ is right or refused")
{
  // As far from the hinge: the pin is 2 sin(q/2) away, the actuator's angle (q + π)/2; the cylinder alone has a body.
  ActuatedLever<double> lever;
  lever.mechanism = {{}, {1, 0}, {1, 0}, 1};
  for (Body<double>& body : lever.body) { body = Body<double>::massless(); }
  lever.body[1] = {1, Vec3(0.2, 0, 0), 0.02 * Mat3::Identity(), false};
  Assembly<ActuatedLever<double>> parts;
  const DynamicTree tree(parts.add("lever", {}, lever).set_gravity({0, -9.81, 0}));
  Workspace ws(tree);
  int right = 0, refused = 0;
  for (double q = 1; q > 1e-8; q /= 1.3) {
    CAPTURE(q);
    const auto fd = forward_dynamics(at(q), Eigen::VectorXd::Ones(1), ws);
    if (!fd.ok()) {
      ++refused;
      CHECK(fd.status() == Status::invalid_state);
      continue;
    }
    ++right;
    const double inertia = 0.02 + 0.04, moment = -9.81 * 0.2 * std::cos((q + std::acos(-1.0)) / 2);
    CHECK(std::abs(fd.qdd0()(0) - 2 * moment / inertia) < 0.01);
  }
  CHECK(right > 30);
  CHECK(refused > 10);
}

TEST_CASE("A slider-crank refuses angles where its rod is too short, and where it stands across the guide")
{
  SliderCrank<double> slider;
  slider.mechanism = {{}, 0.3, 0.15, 0, 1};
  const double dead = std::asin(0.5);
  answers(slider, {{at(0.2), true}, {at(1.2), false}, {at(dead), false}, {at(dead - 1e-3), true}, {at(0.2), true}});
}

TEST_CASE("An actuated lever refuses the angle where its pin meets the pivot")
{
  ActuatedLever<double> lever;
  lever.mechanism = {{}, {0.2, 0}, {0, 0.2}, 1};
  answers(lever, {{at(0.3), true}, {at(-std::acos(0.0)), false}, {at(-1.5), true}, {at(0.3), true}});
}

TEST_CASE("A parallel ankle refuses what a rod cannot reach, and a rod in line with its crank")
{
  ParallelAnkle<double> ankle;
  for (std::size_t k = 0; k < 2; ++k) {
    PushRod<double>& r = ankle.mechanism.rod[k];
    const double y = k == 0 ? 0.04 : -0.04;
    r.hinge = {0, y, 0.25};
    r.crank = {-0.05, 0, 0};
    r.foot = {-0.05, y, 0};
    r.rod = 0.25;
    r.rod_mass = 0.2;
  }
  const auto tilt = [](double first, double second) { return Eigen::VectorXd(Eigen::Vector2d(first, second)); };
  // About y by t the rod's end is at 0.05 (−cos t, 0, sin t): in line with the crank where it is 0.3 m off the hinge.
  //     0.05² + 0.25² − 0.025 sin t = 0.3²   for none; 0.2²: sin t = 1, t = π/2
  answers(ankle,
          {{tilt(0.2, 0.1), true}, {tilt(std::acos(0.0), 0), false}, {tilt(1.2, 0), true}, {tilt(0.2, 0.1), true}});
  // The same with a rod of 0.22 m: sin t = (0.065 − 0.27²)/0.025 < 0 is where it is fully out.
  for (PushRod<double>& r : ankle.mechanism.rod) { r.rod = 0.22; }
  const double out = std::asin((0.065 - 0.27 * 0.27) / 0.025);
  answers(ankle, {{tilt(0.2, 0.1), true},
                  {tilt(out - 0.1, 0), false},
                  {tilt(out, 0), false},
                  {tilt(out + 0.01, 0), true},
                  {tilt(0.2, 0.1), true}});
}

TEST_CASE("Mechanisms that close nowhere are refused when the tree is made")
{
  const auto refuses = [](auto mechanism, const char* what) {
    CHECK_THROWS_WITH(mechanism.prepare("knee"), Catch::Matchers::ContainsSubstring(what));
  };
  refuses(FourBarLinkage<double>{{}, {3, 0}, 0.5, 1, 1, 1}, "does not close");
  refuses(FourBarLinkage<double>{{}, {1, 0}, 0.5, 3, 1, 1}, "does not close");
  refuses(FourBarLinkage<double>{{}, {1, 0}, 4, 1, 1, 1}, "does not close");
  refuses(SliderCrankLinkage<double>{{}, 0.3, 0.5, 0.9, 1}, "do not reach");
  ParallelAnkleLinkage<double> ankle;
  ankle.second = -ankle.first;
  refuses(ankle, "must differ");
}

TEST_CASE("A slider-crank whose guide lies beyond the crank closes where its crank leans over")
{
  SliderCrank<double> slider;
  slider.mechanism = {{}, 0.3, 0.6, 0.5, 1};
  answers(slider, {{at(1.2), true}, {at(-1.2), false}, {at(0.5), true}});
}

TEST_CASE("A parallel ankle refuses what either rod alone cannot reach")
{
  for (std::size_t longer = 0; longer < 2; ++longer) {
    ParallelAnkle<double> ankle;
    for (std::size_t k = 0; k < 2; ++k) {
      PushRod<double>& r = ankle.mechanism.rod[k];
      const double y = k == 0 ? 0.04 : -0.04;
      r.hinge = {0, y, 0.25};
      r.crank = {k == longer ? -0.05 : -0.02, 0, 0};
      r.foot = {-0.05, y, 0};
      r.rod = (r.hinge + r.crank - r.foot).norm();
      r.rod_mass = 0.2;
    }
    const auto tilt = [](double first) { return Eigen::VectorXd(Eigen::Vector2d(first, 0)); };
    answers(ankle, {{tilt(0.2), true}, {tilt(0.8), false}, {tilt(0.2), true}});
  }
}

TEST_CASE("Newton's closure of one equation: where y is no function of q, from near and far")
{
  const auto status = [](double q, double start, const LoopOptions<double>& options = {}) {
    const auto square = [](const auto& y, const auto& x) { return std::array{y[0] * y[0] - x[0]}; };
    const std::array<Dependent<double, 1>, 1> x{{{q, Eigen::Matrix<double, 1, 1>(1), 1, 0}}};
    return close_loop<1>(square, x, Eigen::Matrix<double, 1, 1>(start), options).status;
  };
  CHECK(status(1, 2) == LoopStatus::ok);
  CHECK(status(-1, 2) == LoopStatus::unreachable);
  CHECK(status(1e-12, 1) == LoopStatus::singular);  // ∂y/∂q = 5·10⁵
  CHECK(status(0, 1) == LoopStatus::singular);
  CHECK(status(0, 100) == LoopStatus::singular);  // the iteration ends before it converges
  LoopOptions<double> any_pivot;
  any_pivot.singular = 0;
  CHECK(status(1e-12, 1, any_pivot) == LoopStatus::ok);
  CHECK(status(0, 1, any_pivot) ==
        LoopStatus::singular);  // what is left of Φ_y is what the last step has changed it by
}

}  // namespace test_type_loop_status
