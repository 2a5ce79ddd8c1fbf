// PROGRAM: tests_mechanisms
// The methods agree where floating bases hang on moving parts: their coordinates are relative, and nothing passes on.
#include <iim/global_inverse.hpp>
#include <iim/iim.hpp>
#include <iim/recursive_inverse.hpp>
#include <iim/unit_force.hpp>

#include "catch.hpp"
#include "random_tree.hpp"
#include "worst.hpp"

#include <algorithm>
#include <cstdint>
#include <iostream>
#include <type_traits>

namespace test_methods_floating_inside {

using namespace iim;
using iim::test::keep_worst;

namespace {

constexpr std::uint64_t first_seed = 70000;
constexpr int robots = 500;

// As in test_methods_agree.cpp.
constexpr double recursive_tolerance = 600 * Eigen::NumTraits<double>::epsilon();
constexpr double cholesky_tolerance = 1e-10;

double difference(const AffineDynamics<double>& value, const AffineDynamics<double>& reference)
{
  REQUIRE(value.ok());
  if (reference.Bhat.cols() == 0) { return 0; }
  const double difference = (value.Bhat - reference.Bhat).norm();
  return difference == 0 ? 0 : difference / reference.Bhat.norm();
}

}  // namespace

TEST_CASE("the methods agree on floating bases inside a tree")
{
  double implicit_worst = 0, recursive_worst = 0, global_worst = 0;
  int inside = 0;
  for (std::uint64_t seed = first_seed; seed < first_seed + robots; ++seed) {
    CAPTURE(seed);
    test::RandomOptions options;
    options.most = 20;
    options.floating_inside = 0.2;
    const test::RandomRobot robot = test::random_robot(seed, options);
    const DynamicTree tree(robot.assembly);
    if (tree.n_v() == 0) { continue; }
    tree.outward([&]<class N, class S>(const N& node, const S&) { inside += detail::is_free<S>() && node.path_v > 0; });
    using Tree = std::remove_const_t<decltype(tree)>;
    const auto inputs = test::make_inputs(tree, robot.inputs);
    test::Random random(seed);
    const test::RandomState state = test::random_state(tree, inputs.columns(), random);
    Workspace ws(tree);
    UnitForce<Tree> unit_force(tree, inputs);
    ImplicitInversion<Tree> implicit_inversion(tree, inputs);
    RecursiveInverse<Tree> recursive_inverse(tree, inputs);
    GlobalInverse<Tree> global_inverse(tree, inputs);
    const auto fd = forward_dynamics(state.q, state.qd, ws);
    REQUIRE(fd.ok());
    const auto reference = unit_force(fd);
    keep_worst(implicit_worst, difference(implicit_inversion(fd), reference));
    keep_worst(recursive_worst, difference(recursive_inverse(fd), reference));
    keep_worst(global_worst, difference(global_inverse(fd), reference));
  }
  std::cout << robots << " robots from seed " << first_seed << ", " << inside
            << " floating bases on moving parts; largest relative difference of B̂ from unit forces: implicit inversion "
            << implicit_worst << ", recursive inverse " << recursive_worst << ", global inverse " << global_worst
            << '\n';
  CHECK(inside > robots / 2);
  CHECK(implicit_worst <= recursive_tolerance);
  CHECK(recursive_worst <= recursive_tolerance);
  CHECK(global_worst <= cholesky_tolerance);
}

}  // namespace test_methods_floating_inside
