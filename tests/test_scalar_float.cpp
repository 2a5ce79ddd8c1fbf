// PROGRAM: tests_several
// float, double and long double: the same numbers, each to its own precision.
#include "catch.hpp"
#include "scalar_check.hpp"

#include <algorithm>
#include <limits>

using namespace iim;

namespace {

template <class Low, class High>
double apart(const Low& low, const High& high)
{
  using T = typename High::Scalar;
  const T norm = high.norm();
  return static_cast<double>(norm > 0 ? (low.template cast<T>() - high).norm() / norm : T(0));
}

}  // namespace

TEST_CASE("float and long double agree with double", "[scalar]")
{
  test::RandomOptions options;
  options.floating_inside = 0.1;
  for (std::uint64_t seed = 1; seed <= 100; ++seed) {
    INFO("seed " << seed);
    const test::RandomRobot random = test::random_robot(seed, options);
    const DynamicTree tree(random.assembly);
    test::Random draw(seed);
    const test::RandomState state = test::random_state(tree, 0, draw);
    const auto d = test::affine<double>(random, state);
    const auto f = test::affine<float>(random, state);
    const auto l = test::affine<long double>(random, state);
    // The limit of test_reference_library for the projected update, in units of each Scalar's ε.
    CHECK(apart(f.Bhat, d.Bhat) < 800.0 * std::numeric_limits<float>::epsilon());
    CHECK(apart(f.qdd0, d.qdd0) < 800.0 * std::numeric_limits<float>::epsilon());
    CHECK(apart(d.Bhat, l.Bhat) < 800.0 * std::numeric_limits<double>::epsilon());
    CHECK(apart(d.qdd0, l.qdd0) < 800.0 * std::numeric_limits<double>::epsilon());
    // It is the long double that the double is held against, not a double in disguise.
    if (l.Bhat.size() > 50) { CHECK(apart(d.Bhat, l.Bhat) > 0.01 * std::numeric_limits<double>::epsilon()); }
  }
}
