// PROGRAM: tests_parallel
// The projected form on free bases: the base moves along with its limb's first joint almost freely, and what the limb's
// inertia rounds to there, or what the base's own does about a point far from its centre, must not be what is left.
#include "catch.hpp"
#include "random_tree.hpp"
#include "worst.hpp"

#include <iim/iim.hpp>
#include <iim/subsystem/sprung.hpp>
#include <iim/unit_force.hpp>

#include <algorithm>
#include <limits>
#include <string>
#include <type_traits>
#include <vector>

namespace test_free_base_digits {

using namespace iim;
using iim::test::keep_worst;

namespace {

template <class Scalar>
using Parts = Assembly<RevoluteLink<Scalar>, FloatingBase<Scalar>, MotorArm<Scalar>, Sprung<MotorArm<Scalar>>>;
template <class Scalar>
using Tree = decltype(DynamicTree(std::declval<const Parts<Scalar>&>()));

struct Results {
  MatrixX<long double> Bhat, swept;  // by products, by sweeps
  VectorX<long double> qdd0;
};

template <class Scalar, Update update>
Results results(const Parts<Scalar>& assembly, const test::RandomState& state, double step, const std::string& motor)
{
  const Tree<Scalar> tree(assembly);
  Inputs<Tree<Scalar>> inputs(tree, motor.empty() ? Start::all_motors : Start::empty);
  if (motor.empty()) {
    inputs.add_wrench(tree.name(tree.size() - 1), {Scalar(0.125), Scalar(0.25), Scalar(0)});
  } else {
    inputs.add_motor(motor);
    inputs.add_force(motor);
  }
  Workspace<Tree<Scalar>, update> ws(tree);
  ImplicitInversion<Tree<Scalar>> method(tree, inputs);
  const VectorX<Scalar> q = state.q.template cast<Scalar>(), qd = state.qd.template cast<Scalar>();
  UnitForce<Tree<Scalar>> sweep(tree, inputs);
  const auto receipt = step > 0 ? implicit_step(q, qd, static_cast<Scalar>(step), ws) : forward_dynamics(q, qd, ws);
  const auto result = method(receipt), swept = sweep(receipt);
  REQUIRE(result.ok());
  REQUIRE(swept.ok());
  return {result.Bhat.template cast<long double>(), swept.Bhat.template cast<long double>(),
          result.qdd0.template cast<long double>()};
}

struct Errors {
  double Bhat = 0, qdd0 = 0;
  int over = 0;  ///< states whose B̂ is off by more than 16 ε
};

/// Largest errors in ε, against the square-root form in long double. motor: inputs are this one and a force on its arm;
/// else all motors and a wrench.
template <class Model>
Errors worst(int states, double step, Model&& model, const std::string& motor = {})
{
  Errors worst;
  for (std::uint64_t seed = 1; seed <= static_cast<std::uint64_t>(states); ++seed) {
    test::Random random(seed);
    const Parts<double> assembly = model(random);
    const test::RandomState state = test::random_state(Tree<double>(assembly), 0, random);
    const Results a = results<double, Update::projected>(assembly, state, step, motor);
    const Results b =
        results<long double, Update::square_root>(assembly.template cast<long double>(), state, step, motor);
    const double epsilon = std::numeric_limits<double>::epsilon();
    const double error = static_cast<double>((a.Bhat - b.Bhat).norm() / b.Bhat.norm()) / epsilon;
    keep_worst(worst.Bhat, error);
    keep_worst(worst.Bhat, static_cast<double>((a.swept - b.swept).norm() / b.swept.norm()) / epsilon);
    worst.over += error > 16;
    keep_worst(worst.qdd0, static_cast<double>((a.qdd0 - b.qdd0).norm() / b.qdd0.norm()) / epsilon);
  }
  return worst;
}

/// Bars of 1 m, a third of it wide; the first one floats, its frame at its end.
Parts<double> free_chain(int links, bool planar)
{
  Parts<double> assembly;
  Body<double> bar;
  bar.mass = 1;
  bar.com = {0, 0, -0.5};
  bar.inertia = test::Vec3(10.0 / 108, 10.0 / 108, 2.0 / 108).asDiagonal();
  for (int k = 0; k < links; ++k) {
    Attachment<double> on;
    if (k > 0) {
      on.parent = "bar" + std::to_string(k - 1);
      on.p = {0, 0, -1};
    }
    const std::string name = "bar" + std::to_string(k);
    if (k == 0) {
      assembly.add(name, on, FloatingBase<double>{bar});
    } else {
      assembly.add(name, on, RevoluteLink<double>{{test::Vec3::Unit(planar ? 1 : k % 2)}, bar});
    }
  }
  return assembly;
}

enum class First { revolute, geared, sprung };

/// A base a tenth as heavy as the links of its limb, and a light limb beside.
Parts<double> light_base(First first, test::Random& random)
{
  const double lightness = 0.1;
  const auto light = [&](Body<double> body) {
    body.mass *= lightness;
    body.inertia *= lightness;
    return body;
  };
  const auto motor = [&] {
    Motor<double> light_motor = random.motor(0);
    light_motor.axial_inertia *= lightness;
    light_motor.transverse_inertia *= lightness;
    light_motor.mass *= lightness;
    return light_motor;
  };
  Parts<double> assembly;
  const auto place = [&](const std::string& parent) {
    return Attachment<double>{parent, random.rotation(), random.vector(0.5)};  // in this order
  };
  // One draw after the other: compilers evaluate arguments in orders of their own.
  const Attachment<double> base_on = place("world"), first_on = place("base"), beside_on = place("base");
  assembly.add("base", base_on, FloatingBase<double>{light(random.body())});
  switch (first) {
    case First::revolute: assembly.add("link0", first_on, RevoluteLink<double>{{random.axis()}, random.body()}); break;
    case First::geared:
      assembly.add("link0", first_on, MotorArm<double>{{random.axis()}, random.body(), motor()});
      break;
    case First::sprung: {
      Sprung<MotorArm<double>> arm{{{random.axis()}, random.body(), motor()}};
      arm.stiffness(0) = 1e4;
      arm.damping(0) = 10;
      assembly.add("link0", first_on, arm);
      break;
    }
  }
  for (int k = 1; k < 4; ++k) {
    const Attachment<double> on = place("link" + std::to_string(k - 1));
    assembly.add("link" + std::to_string(k), on, MotorArm<double>{{random.axis()}, random.body(), motor()});
  }
  assembly.add("beside", beside_on, MotorArm<double>{{random.axis()}, light(random.body()), motor()});
  return assembly;
}

/// A free bar with a limb in a plane of its own at each end, one of them heavier. `heavy`: the first or the second.
Parts<double> two_planes(int heavy, test::Random& random)
{
  Parts<double> assembly;
  assembly.add("base", {}, FloatingBase<double>{random.body()});
  for (int limb = 0; limb < 2; ++limb) {
    const test::Vec3 axis = random.unit();
    for (int k = 0; k < 8; ++k) {
      const auto name = [&](int i) { return "limb" + std::to_string(limb) + "_" + std::to_string(i); };
      Body<double> body = random.body();
      if (limb == heavy) { body.mass *= 4, body.inertia *= 4; }
      const Attachment<double> on{k == 0 ? "base" : name(k - 1), test::Mat3::Identity(), random.vector(0.5)};
      assembly.add(name(k), on, RevoluteLink<double>{{axis}, body});
    }
  }
  return assembly;
}

/// A base 10⁻⁶ as heavy as the links of its limbs, whose first joints share one axis, or do not.
Parts<double> limbs_on_lightest(int limbs, bool coaxial, test::Random& random)
{
  Parts<double> assembly;
  Body<double> body = random.body();
  body.mass *= 1e-6;
  body.inertia *= 1e-6;
  assembly.add("base", {}, FloatingBase<double>{body});
  const test::Vec3 axis = random.unit();
  for (int limb = 0; limb < limbs; ++limb) {
    std::string parent = "base";
    for (int k = 0; k < 3; ++k) {
      const std::string name = std::to_string(limb) + "_" + std::to_string(k);
      Attachment<double> on{parent, test::Mat3::Identity(), random.vector(0.5)};
      if (coaxial && k == 0) { on.p = axis * random.uniform(-1, 1); }
      const test::Vec3 own = random.axis();
      assembly.add(name, on, RevoluteLink<double>{{coaxial && k == 0 ? axis : own}, random.body()});
      parent = name;
    }
  }
  return assembly;
}

}  // namespace

TEST_CASE("projected: a free chain keeps its digits whatever the axes", "[free_base]")
{
  for (const int links : {2, 5, 8, 31}) {
    for (const bool planar : {false, true}) {
      CAPTURE(links, planar);
      const Errors errors = worst(20, 0, [&](test::Random&) { return free_chain(links, planar); });
      // 19 ε; 1880 with M̄_R inverted as it is in body axes, about the frame's origin.
      CHECK(errors.Bhat < 32);
      CHECK(errors.qdd0 < 32);
    }
  }
}

TEST_CASE("projected: limbs in two planes on a free base", "[free_base]")
{
  for (const int heavy : {0, 1}) {
    CAPTURE(heavy);
    const Errors errors = worst(50, 0, [&](test::Random& random) { return two_planes(heavy, random); });
    CHECK(errors.Bhat < 32);
    CHECK(errors.qdd0 < 64);
  }
}

TEST_CASE("projected: a base lighter than its limb", "[free_base]")
{
  for (const First first : {First::revolute, First::geared, First::sprung}) {
    for (const double step : {0.0, 1e-3}) {
      CAPTURE(static_cast<int>(first), step);
      const Errors errors = worst(100, step, [&](test::Random& random) { return light_base(first, random); });
      CHECK(errors.over <= 2);  // 0 to 1 of 100; 10 to 13 with the limb's inertia added to the base's
      CHECK(errors.Bhat < 64);  // 8 to 14
      CHECK(errors.qdd0 < 48);  // 10 to 12
    }
  }
}

TEST_CASE("projected: limbs on a base lighter by 10⁶, by several axes or by one", "[free_base]")
{
  for (const int limbs : {1, 2, 4}) {
    for (const bool coaxial : {false, true}) {
      CAPTURE(limbs, coaxial);
      const Errors errors =
          worst(50, 0, [&](test::Random& random) { return limbs_on_lightest(limbs, coaxial, random); });
      CHECK(errors.Bhat < 32);  // 10⁶ to 10⁸ about one axis where C is that of the inertia as it was added up
      if (!coaxial) { CHECK(errors.qdd0 < 32); }  // 4 to 7
    }
  }
}

TEST_CASE("projected: inputs far out on a limb of a light base", "[free_base]")
{
  // The limb hands the base nothing along its first axis, which is all that a light base would feel: 1e6 ε where that
  // is what the sums leave.
  for (const int limbs : {1, 2}) {
    CAPTURE(limbs);
    const Errors errors =
        worst(50, 0, [&](test::Random& random) { return limbs_on_lightest(limbs, false, random); }, "0_2");
    CHECK(errors.Bhat < 256);  // 97
  }
  for (const First first : {First::revolute, First::geared, First::sprung}) {
    for (const double step : {0.0, 1e-3}) {
      CAPTURE(static_cast<int>(first), step);
      const Errors errors = worst(50, step, [&](test::Random& random) { return light_base(first, random); }, "link3");
      CHECK(errors.Bhat < 64);
    }
  }
}

TEST_CASE("projected: joints of a falling robot do not feel gravity", "[free_base]")
{
  test::Random random(5);
  const Parts<double> assembly = free_chain(6, false);
  const Tree<double> tree(assembly);
  Workspace<Tree<double>> ws(tree);
  for (int k = 0; k < 20; ++k) {
    const test::RandomState state = test::random_state(tree, 0, random);
    const auto still = forward_dynamics(state.q, Eigen::VectorXd(Eigen::VectorXd::Zero(tree.n_v())), ws);
    REQUIRE(still.ok());
    CHECK(ws.qdd().tail(tree.n_v() - 6).isZero(0));
  }
}

namespace {

Body<double> times(Body<double> body, double factor)
{
  body.mass *= factor;
  body.inertia *= factor;
  return body;
}

/// An arm with an armature on a base far lighter than it, and a load that turns about the same line.
Parts<double> load_in_line(test::Random& random)
{
  Parts<double> assembly;
  const test::Vec3 axis = random.axis();
  assembly.add("base", {}, FloatingBase<double>{times(random.body(), 1e-3)});
  MotorArm<double> arm{{axis}, times(random.body(), 0.1), {}};
  arm.motor.gear_ratio = random.uniform(1, 3);
  arm.motor.axial_inertia = 3e-4;
  arm.motor.armature = true;
  assembly.add("arm", {"base", test::Mat3::Identity(), random.vector(0.3)}, arm);
  assembly.add("load", {"arm", test::Mat3::Identity(), axis * random.uniform(-0.5, 0.5)},
               RevoluteLink<double>{{-axis}, times(random.body(), 1e4)});
  return assembly;
}

/// A base with a light link, and after it a limb with a load.
Parts<double> load_after_link(test::Random& random)
{
  Parts<double> assembly;
  assembly.add("base", {}, FloatingBase<double>{random.body()});
  assembly.add("side", {"base", random.rotation(), random.vector(0.5)},
               RevoluteLink<double>{{random.axis()}, times(random.body(), 0.1)});
  std::string parent = "base";
  for (int k = 0; k < 6; ++k) {
    const std::string name = "link" + std::to_string(k);
    assembly.add(name, {parent, random.rotation(), random.vector(0.5)},
                 RevoluteLink<double>{{random.axis()}, times(random.body(), k == 5 ? 1e5 : 1)});
    parent = name;
  }
  return assembly;
}

}  // namespace

TEST_CASE("projected: a load in line with a geared arm on a light base", "[free_base]")
{
  const Errors errors = worst(50, 0, [](test::Random& random) { return load_in_line(random); });
  CHECK(errors.Bhat < 32);
  CHECK(errors.qdd0 < 32);  // 2; 10⁵ where what the rotor holds of the load is left out, or the rotor
}

TEST_CASE("projected: a limb with a load, and a link that hangs on the base before it", "[free_base]")
{
  const Errors errors = worst(100, 0, [](test::Random& random) { return load_after_link(random); });
  CHECK(errors.over < 15);   // 3; with the roundings of the limb left out 60, 7·10⁵ and 3·10⁴ ε
  CHECK(errors.Bhat < 256);  // 42
  CHECK(errors.qdd0 < 64);
}

}  // namespace test_free_base_digits
