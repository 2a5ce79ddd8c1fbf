// The library in fifty digits is the reference in fifty digits.
// REQUIRES: boost
#include "catch.hpp"
#include "reference/literal.hpp"
#include "reference/multiprecision.hpp"
#include "scalar_check.hpp"

#include <iim/subsystem/flexible_link.hpp>

using namespace iim;
using namespace iim::reference;

TEST_CASE("the library in 50 digits is the paper in 50 digits", "[scalar]")
{
  test::RandomOptions options;
  options.floating_inside = 0.1;
  // 50 digits, ten of them for the condition of M and for sums (as in test_reference).
  constexpr double tolerance = 1e-40;
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    INFO("seed " << seed);
    const test::RandomRobot random = test::random_robot(seed, options);
    const DynamicTree tree(random.assembly);
    test::Random draw(seed);
    const test::RandomState state = test::random_state(tree, 0, draw);
    const Literal<Digits50> robot(test::in<Digits50>(random.assembly), random.inputs, state.q, state.qd);
    const auto [Bhat, qdd0] = direct_solution(robot);
    const auto projected = test::affine<Digits50>(random, state);
    CHECK(apart(projected.Bhat, Bhat) < tolerance);
    CHECK(apart(projected.qdd0, qdd0) < tolerance);
  }
}

TEST_CASE("so it is with square roots", "[scalar]")
{
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    INFO("seed " << seed);
    const test::RandomRobot random = test::random_robot(seed);
    const DynamicTree tree(random.assembly);
    test::Random draw(seed);
    const test::RandomState state = test::random_state(tree, 0, draw);
    const auto projected = test::affine<Digits50>(random, state);
    const auto root = test::affine<Digits50, Update::square_root>(random, state);
    CHECK(apart(root.Bhat, projected.Bhat) < 1e-40);
    CHECK(apart(root.qdd0, projected.qdd0) < 1e-40);
  }
}

TEST_CASE("a beam of one shape in 50 digits is what it is in double", "[scalar]")
{
  using Beam = FlexibleLink<Revolute<double>, 1, 1, 0>;
  Assembly<Beam> robot;
  robot.add("beam", {}, Beam());
  const DynamicTree tree(robot);
  const DynamicTree exact_tree(robot.cast<Digits50>());
  Workspace ws(tree);
  Workspace exact_ws(exact_tree);
  const VectorX<double> q = VectorX<double>::LinSpaced(tree.n_q(), 0.1, 0.2), qd = 3 * q;
  const auto fd = forward_dynamics(q, qd, ws);
  const auto exact = forward_dynamics(q.cast<Digits50>().eval(), qd.cast<Digits50>().eval(), exact_ws);
  REQUIRE(fd.ok());
  REQUIRE(exact.ok());
  CHECK(apart(fd.qdd0().cast<Digits50>().eval(), exact.qdd0()) < 1e-13);
}
