// Sine and cosine inline, against the same in long double.
#include "catch.hpp"
#include "worst.hpp"

#include <iim/numerics/turns.hpp>
#include <iim/scalar.hpp>
#include <iim/subsystem/motor_arm.hpp>

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

namespace {

static_assert(iim::detail::takes_turn<iim::RevoluteLink<double>>() && iim::detail::takes_turn<iim::MotorArm<float>>());
static_assert(!iim::detail::takes_turn<iim::PrismaticLink<double>>());

/// Error of `value` in units of the last place of `exact`.
template <class Scalar>
long double ulps(Scalar value, long double exact)
{
  const Scalar size = std::abs(static_cast<Scalar>(exact));
  return std::abs(value - exact) / (std::nextafter(size, std::numeric_limits<Scalar>::infinity()) - size);
}

}  // namespace

TEMPLATE_TEST_CASE("sine and cosine to one unit in the last place", "", float, double)
{
  std::mt19937 random_source(11);
  long double worst = 0;
  for (const double range : {1e-3, 0.8, 3.2, 100.0, 9999.0, 1e5, 1e12}) {
    std::uniform_real_distribution<double> angle(-range, range);
    for (int k = 0; k < 20000; ++k) {
      const auto q = static_cast<TestType>(angle(random_source));
      TestType s, c;
      iim::detail::sine_cosine(q, s, c);
      iim::test::keep_worst(worst, ulps(s, std::sin(static_cast<long double>(q))));
      iim::test::keep_worst(worst, ulps(c, std::cos(static_cast<long double>(q))));
    }
  }
  // Beside a multiple of π/2 one of the two is as small as it gets.
  for (int k = -6000; k <= 6000; ++k) {
    const auto q = static_cast<TestType>(k * 1.57079632679489661923);
    TestType s, c;
    iim::detail::sine_cosine(q, s, c);
    iim::test::keep_worst(worst, ulps(s, std::sin(static_cast<long double>(q))));
    iim::test::keep_worst(worst, ulps(c, std::cos(static_cast<long double>(q))));
  }
  INFO("worst " << worst);
  CHECK(worst < 1);
}

TEMPLATE_TEST_CASE("sine and cosine of what is no angle are not finite", "", float, double)
{
  for (const TestType q : {std::numeric_limits<TestType>::infinity(), -std::numeric_limits<TestType>::infinity(),
                           std::numeric_limits<TestType>::quiet_NaN()}) {
    TestType s, c;
    iim::detail::sine_cosine(q, s, c);
    CHECK(std::isnan(s));
    CHECK(std::isnan(c));
  }
}

TEMPLATE_TEST_CASE("all sines and cosines of a state at once are those of one angle after the other", "", float, double)
{
  using Vector = Eigen::Matrix<TestType, Eigen::Dynamic, 1>;
  std::mt19937 random_source(12);
  long double worst = 0;
  for (const double range : {0.8, 100.0, 9999.0, 1e12}) {
    std::uniform_real_distribution<double> angle(-range, range);
    for (Eigen::Index n = 0; n <= 20; ++n) {
      for (const Eigen::Index first : {0, 7}) {
        iim::detail::Turns<TestType> turns;
        for (Eigen::Index i = first; i < n; i += 1 + i % 2) { turns.add(i); }
        turns.allocate();
        Eigen::Matrix<TestType, 2, Eigen::Dynamic> both(2, n);
        for (TestType& q : both.reshaped()) { q = static_cast<TestType>(angle(random_source)); }
        const Eigen::Index no_angle = 3;  // its neighbours keep their sines
        if (n > no_angle) { both(0, no_angle) = std::numeric_limits<TestType>::quiet_NaN(); }
        const Vector q = both.row(0).transpose();
        for (const bool apart : {false, true}) {
          if (apart) {
            turns.set(both.row(0).transpose());
          } else {
            turns.set(q);
          }
          for (Eigen::Index i = first; i < n; i += 1 + i % 2) {
            if (i == no_angle) {
              CHECK(std::isnan(turns.of(i, q(i)).sine));
              continue;
            }
            const iim::Turn<TestType> turn = turns.of(i, q(i));
            const auto exact = static_cast<long double>(q(i));
            iim::test::keep_worst(worst, ulps(turn.sine, std::sin(exact)));
            iim::test::keep_worst(worst, ulps(turn.cosine, std::cos(exact)));
          }
        }
      }
    }
  }
  INFO("worst " << worst);
  CHECK(worst < 1);
}
