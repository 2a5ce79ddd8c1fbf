// PROGRAM: tests_extreme
// The square-root form where a small rotor meets heavy links: what the heavy ones push on each other stays among them.
#include "catch.hpp"
#include "random_tree.hpp"
#include "worst.hpp"

#include <iim/iim.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

namespace test_rotor_on_light_base {

using namespace iim;
using iim::test::keep_worst;

namespace {

template <class Scalar>
using Tree = decltype(DynamicTree(std::declval<const StandardAssembly<Scalar>&>()));

/// A floating base of about 1 kg, on it a geared arm and a second link, both `load` times as heavy.
StandardAssembly<double> heavy_arm_on_light_base(double load, test::Random& random)
{
  const auto heavy = [&] {
    Body<double> body = random.body();
    body.mass *= load;
    body.inertia *= load;
    return body;
  };
  StandardAssembly<double> assembly;
  assembly.add("base", {}, FloatingBase<double>{random.body()});
  MotorArm<double> arm{{random.axis()}, heavy(), random.motor(0)};
  assembly.add("arm", {"base", random.rotation(), random.vector(0.5)}, arm);
  assembly.add("link", {"arm", random.rotation(), random.vector(0.5)}, RevoluteLink<double>{{random.axis()}, heavy()});
  return assembly;
}

/// A floating base that is `load` times lighter than the rotor on it, and lets it turn about its axis almost freely:
/// the rotor drives a slide that is lighter still.
StandardAssembly<double> light_slide_with_rotor(double load, test::Random& random)
{
  const auto light = [&](double by) {
    Body<double> body = random.body();
    body.mass /= by;
    body.inertia /= by;
    return body;
  };
  StandardAssembly<double> assembly;
  assembly.add("base", {}, FloatingBase<double>{light(load)});
  LinearMotorArm<double> slide{{random.axis()}, light(100 * load), random.motor(0)};
  slide.motor.mass = random.uniform(0.1, 1);
  slide.motor.com = random.vector(0.3);
  slide.motor.transverse_inertia = slide.motor.axial_inertia * random.uniform(0.6, 2);
  assembly.add("slide", {"base", random.rotation(), random.vector(0.5)}, slide);
  return assembly;
}

/// Largest error of q̈₀ over a few robots in motion, in ε of Scalar, against long double.
template <class Scalar>
double worst_error(double load, StandardAssembly<double> (*robot)(double, test::Random&) = heavy_arm_on_light_base)
{
  double worst = 0;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    test::Random random(seed);
    const auto rounded = robot(load, random).cast<Scalar>();
    const auto exact = test::in<long double>(rounded.template cast<double>());
    const Tree<Scalar> tree(rounded);
    const Tree<long double> exact_tree(exact);
    const test::RandomState state = test::random_state(exact_tree, 0, random);
    const VectorX<Scalar> q = state.q.cast<Scalar>(), qd = state.qd.cast<Scalar>();
    Workspace<Tree<Scalar>, Update::square_root> ws(tree);
    Workspace<Tree<long double>, Update::square_root> exact_ws(exact_tree);
    const auto fd = forward_dynamics(q, qd, ws);
    const auto reference =
        forward_dynamics(q.template cast<long double>().eval(), qd.template cast<long double>().eval(), exact_ws);
    REQUIRE(fd.ok());
    REQUIRE(reference.ok());
    const long double error =
        (fd.qdd0().template cast<long double>() - reference.qdd0()).norm() / reference.qdd0().norm();
    keep_worst(worst, static_cast<double>(error / std::numeric_limits<Scalar>::epsilon()));
  }
  return worst;
}

}  // namespace

TEST_CASE("a geared arm of 1e3 to 1e9 times the mass of its floating base keeps the digits of q̈₀ at speed")
{
  for (const double load : {1e3, 1e6, 1e9}) {
    CAPTURE(load);
    CHECK(worst_error<double>(load) < 64);
    CHECK(worst_error<float>(load) < 64);
  }
}

TEST_CASE("the moment of a fast rotor on a base of 1e-3 to 1e-9 of its mass keeps the digits of q̈₀")
{
  for (const double load : {1e3, 1e6, 1e9}) {
    CAPTURE(load);
    CHECK(worst_error<double>(load, light_slide_with_rotor) < 64);
    CHECK(worst_error<float>(load, light_slide_with_rotor) < 64);
  }
}

}  // namespace test_rotor_on_light_base
