// FLAGS: -O2 -funsafe-math-optimizations
// Sines where the compiler may reorder sums, as clang says by no macro: π/2 in parts, and rounding by a large number
// that is added and subtracted, would go (errors of 0.7).
#include "catch.hpp"
#include "worst.hpp"

#include <iim/numerics/lanes.hpp>
#include <iim/numerics/sine_cosine.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

namespace test_sine_reassociated {

TEMPLATE_TEST_CASE("sine and cosine are right in whatever order the compiler adds", "", float, double)
{
  std::mt19937_64 bits(5);
  double worst = 0, worst_lanes = 0;
  for (int k = 0; k < 20000; ++k) {
    const auto q = static_cast<TestType>(100 * (static_cast<double>(bits() >> 11) * 0x1p-52 - 1));
    const double exact_sine = std::sin(static_cast<double>(q)), exact_cosine = std::cos(static_cast<double>(q));
    TestType s, c;
    iim::detail::sine_cosine(q, s, c);
    iim::test::keep_worst(worst, std::abs(s - exact_sine));
    iim::test::keep_worst(worst, std::abs(c - exact_cosine));
    const iim::Lanes<TestType> angles(q);
    iim::test::keep_worst(worst_lanes, std::abs(sin(angles)[0] - exact_sine));
    iim::test::keep_worst(worst_lanes, std::abs(cos(angles)[0] - exact_cosine));
  }
  CHECK(worst < 2 * std::numeric_limits<TestType>::epsilon());
  CHECK(worst_lanes < 2 * std::numeric_limits<TestType>::epsilon());
}

}  // namespace test_sine_reassociated
