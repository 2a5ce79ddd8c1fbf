// PROGRAM: tests_parallel
// B̂ of arms skew to the axes of the world has its digits, of one state and of several. Slender links that grow lighter
// outward, roll and pitch joints in turn: pivots of stretched wrists are differences of what stands across them. Links
// of any shape, on placements that turn: their axes stay orthogonal.
#include "catch.hpp"
#include "random_tree.hpp"
#include "worst.hpp"

#include <iim/iim.hpp>
#include <iim/several_states.hpp>

#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

namespace test_slender_arms {

using namespace iim;

namespace {

using Links = Assembly<RevoluteLink<double>>;

/// An arm of links that grow lighter outward, in axes that are skew to those of the world.
Links arm(test::Random& random)
{
  Links assembly;
  Attachment<double> on;
  on.R = random.rotation();
  double mass = 3;
  for (int k = 0; k < 7; ++k) {
    const double length = random.uniform(0.1, 0.4), width = random.uniform(0.05, 0.1);
    RevoluteLink<double> link;
    link.joint.axis = k % 2 == 0 ? Vector3<double>::UnitZ() : Vector3<double>::UnitY();
    link.body.mass = mass;
    link.body.com = Vector3<double>(random.uniform(-0.01, 0.01), random.uniform(-0.01, 0.01), length / 2);
    const double across = mass / 12 * (width * width + length * length);
    link.body.inertia.diagonal() << across, across, mass / 6 * width * width;
    const std::string name = "axis" + std::to_string(k);
    assembly.add(name, on, link);
    on = Attachment<double>{};
    on.parent = name;
    on.p.z() = length;
    mass *= random.uniform(0.6, 0.9);
  }
  return assembly;
}

/// An arm of compact links, each on a placement that turns.
Links turned_arm(test::Random& random)
{
  Links assembly;
  Attachment<double> on;
  for (int k = 0; k < 7; ++k) {
    RevoluteLink<double> link;
    link.joint.axis = random.axis();
    link.body = random.body();
    const double mass = random.uniform(1, 3);
    link.body.inertia *= mass / link.body.mass;
    link.body.mass = mass;
    const std::string name = "axis" + std::to_string(k);
    on.R = random.rotation();
    assembly.add(name, on, link);
    on.parent = name;
    on.p = random.vector(0.4);
  }
  return assembly;
}

/// Of B̂, in ε.
struct Worst {
  double one = 0, several = 0;
};
void keep_worst(Worst& worst, const Links& assembly, test::Random& random)
{
  const DynamicTree tree(assembly);
  const DynamicTree exact_tree(assembly.cast<long double>());
  const Inputs inputs(tree);
  const Inputs exact_inputs(exact_tree);
  Workspace ws(tree);
  Workspace exact_ws(exact_tree);
  ImplicitInversion method(tree, inputs);
  ImplicitInversion exact_method(exact_tree, exact_inputs);
  SeveralStates several(assembly, inputs);
  const Index count = 40;
  MatrixX<double> q(7, count), qd(7, count);
  std::vector<MatrixX<long double>> exact;
  const auto error = [&](Index k, const auto& Bhat) {
    const MatrixX<long double>& right = exact[static_cast<std::size_t>(k)];
    return static_cast<double>((Bhat.template cast<long double>() - right).norm() / right.norm()) /
           std::numeric_limits<double>::epsilon();
  };
  for (Index k = 0; k < count; ++k) {
    const test::RandomState state = test::random_state(tree, 0, random);
    q.col(k) = state.q;
    qd.col(k) = state.qd;
    exact.emplace_back(
        exact_method(state.q.cast<long double>().eval(), state.qd.cast<long double>().eval(), exact_ws).Bhat);
    const auto result = method(state.q, state.qd, ws);
    REQUIRE(result.ok());
    test::keep_worst(worst.one, error(k, result.Bhat));
  }
  several.for_each(q, qd, [&](Index k, const auto& result) {
    REQUIRE(result.ok());
    test::keep_worst(worst.several, error(k, result.Bhat));
  });
}

}  // namespace

TEST_CASE("B̂ of slender arms, one state and several")
{
  Worst worst;
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    test::Random random(seed);
    const Links assembly = arm(random);
    keep_worst(worst, assembly, random);
  }
  CAPTURE(worst.one, worst.several);
  CHECK(worst.one < 16);      // 4 to 12, by compiler
  CHECK(worst.several < 16);  // 8 to 10
}

TEST_CASE("B̂ of arms on placements that turn, one state and several")
{
  Worst worst;
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    test::Random random(seed);
    const Links assembly = turned_arm(random);
    keep_worst(worst, assembly, random);
  }
  CAPTURE(worst.one, worst.several);
  CHECK(worst.one < 16);      // 6 to 11
  CHECK(worst.several < 24);  // 13 to 19; with axes made orthogonal at every 16th joint alone 25 to 40
}

}  // namespace test_slender_arms
