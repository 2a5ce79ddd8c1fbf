// PROGRAM: tests_parallel
// Arms of slender links that grow lighter outward, roll and pitch joints in turn, skew to the axes of the world: pivots
// of stretched wrists are differences of what stands across them, and B̂ has its digits, of one state and of several.
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

}  // namespace

TEST_CASE("B̂ of slender arms, one state and several")
{
  double worst = 0, worst_of_several = 0;
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    test::Random random(seed);
    const Links assembly = arm(random);
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
      test::keep_worst(worst, error(k, result.Bhat));
    }
    several.for_each(q, qd, [&](Index k, const auto& result) {
      REQUIRE(result.ok());
      test::keep_worst(worst_of_several, error(k, result.Bhat));
    });
  }
  CAPTURE(worst, worst_of_several);
  CHECK(worst < 16);             // 8 to 12, by compiler
  CHECK(worst_of_several < 20);  // 8 to 16.3
}

}  // namespace test_slender_arms
