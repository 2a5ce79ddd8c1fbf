// Lanes: each lane is the number that the same text computes by itself; decisions are for all lanes, or marked.
#include "catch.hpp"
#include "worst.hpp"

#include <iim/several_states.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <type_traits>

using namespace iim;
using iim::test::keep_worst;

namespace {

template <class T>
using Pack = Lanes<T>;

/// Different numbers in all lanes.
template <class T>
Pack<T> draw(std::mt19937_64& bits, double size)
{
  Pack<T> x;
  for (int k = 0; k < Pack<T>::size; ++k) {
    x.set(k, static_cast<T>(size * (static_cast<double>(bits() >> 11) * 0x1p-52 - 1)));
  }
  return x;
}

/// Distance from the exact value in units of its last place.
template <class T>
double ulps(T x, long double exact)
{
  const T rounded = static_cast<T>(exact);
  const long double place = std::nextafter(std::abs(rounded), std::numeric_limits<T>::infinity()) - std::abs(rounded);
  return static_cast<double>(std::abs(static_cast<long double>(x) - exact) / place);
}

template <class T>
void check_arithmetic()
{
  std::mt19937_64 bits(1);
  for (int round = 0; round < 200; ++round) {
    const Pack<T> a = draw<T>(bits, 3), b = draw<T>(bits, 3);
    for (int k = 0; k < Pack<T>::size; ++k) {
      CHECK((a + b)[k] == a[k] + b[k]);
      CHECK((a - b)[k] == a[k] - b[k]);
      CHECK((a * b)[k] == a[k] * b[k]);
      CHECK((a / b)[k] == a[k] / b[k]);
      CHECK((-a)[k] == -a[k]);
      CHECK(abs(a)[k] == std::abs(a[k]));
      CHECK(max(a, b)[k] == std::max(a[k], b[k]));
      CHECK(min(a, b)[k] == std::min(a[k], b[k]));
      CHECK(sqrt(a * a)[k] == std::sqrt(a[k] * a[k]));
      CHECK(atan2(a, b)[k] == std::atan2(a[k], b[k]));
    }
  }
  for (const T x : {T(0), T(-0.0), T(1.5), std::numeric_limits<T>::infinity(), std::numeric_limits<T>::denorm_min()}) {
    const Pack<T> all = x;
    for (int k = 0; k < Pack<T>::size; ++k) {
      CHECK(all[k] == x);
      CHECK(std::signbit(all[k]) == std::signbit(x));
    }
    CHECK(static_cast<double>(all) == static_cast<double>(x));
  }
  Pack<T> apart = T(1);
  apart.set(Pack<T>::size - 1, T(2));
  CHECK(std::isnan(static_cast<double>(apart)));
}

template <class T>
void check_sine(double size)
{
  std::mt19937_64 bits(2);
  double worst = 0;
  for (int round = 0; round < 4000; ++round) {
    const Pack<T> x = draw<T>(bits, size);
    const Pack<T> s = sin(x), c = cos(x);
    for (int k = 0; k < Pack<T>::size; ++k) {
      keep_worst(worst, ulps(s[k], std::sin(static_cast<long double>(x[k]))));
      keep_worst(worst, ulps(c[k], std::cos(static_cast<long double>(x[k]))));
    }
  }
  INFO("angles up to " << size);
  // Last rounding 0.5. Each of the reduction's roundings 0.5 of the reduced angle's places, up to two of the result's:
  // one for small angles, two where multiples of π/2 have more digits than fit.
  CHECK(worst < (size <= 100 ? 1.5 : 2.5));
}

/// The multiples of π/2 that T holds best, and their neighbours: the reduction cancels most there.
template <class T>
void check_sine_at_quarter_turns(int turns)
{
  double worst = 0;
  for (int n = -turns; n <= turns; n += std::max(1, turns / 5000)) {
    const T near = static_cast<T>(n * std::acos(-1.0L) / 2);
    const Pack<T> x = near;
    keep_worst(worst, ulps(sin(x)[0], std::sin(static_cast<long double>(near))));
    keep_worst(worst, ulps(cos(x)[0], std::cos(static_cast<long double>(near))));
  }
  CHECK(worst < 2.5);
}

template <class T>
void check_sine_of_anything()
{
  using Limits = std::numeric_limits<T>;
  // One lane beyond the reduction's range: all lanes are right still.
  for (const T odd :
       {T(1e7), T(-1e7), Limits::max(), Limits::infinity(), Limits::quiet_NaN(), Limits::min(), T(-0.0)}) {
    for (int at = 0; at < Pack<T>::size; ++at) {
      Pack<T> x = T(0.5);
      x.set(at, odd);
      for (int k = 0; k < Pack<T>::size; ++k) {
        const T s = sin(x)[k], c = cos(x)[k];
        if (std::isfinite(x[k])) {
          CHECK(std::abs(s - std::sin(x[k])) <= 2 * Limits::epsilon() * std::abs(s));
          CHECK(std::abs(c - std::cos(x[k])) <= 2 * Limits::epsilon() * std::abs(c));
        } else {
          CHECK(std::isnan(s));
          CHECK(std::isnan(c));
        }
      }
    }
  }
}

template <class T>
void check_decisions()
{
  using Limits = std::numeric_limits<T>;
  const Pack<T> one = T(1), two = T(2);
  LaneVote::reset();
  CHECK(one < two);
  CHECK_FALSE(two < one);
  CHECK(one <= one);
  CHECK(two > one);
  CHECK(two >= two);
  CHECK(one == one);
  CHECK(one != two);
  CHECK_FALSE(LaneVote::divided());  // all lanes were of one mind
  for (int at = 0; at < Pack<T>::size; ++at) {
    Pack<T> mixed = one;
    mixed.set(at, T(3));
    LaneVote::reset();
    CHECK_FALSE(mixed < two);
    CHECK(LaneVote::divided());
    LaneVote::reset();
    CHECK_FALSE(mixed > two);
    CHECK(LaneVote::divided());
    LaneVote::reset();
    CHECK_FALSE(mixed == one);
    CHECK(LaneVote::divided());
    LaneVote::reset();
    CHECK(mixed != one);
    CHECK(LaneVote::divided());
    LaneVote::reset();

    // The questions of the cycle: as the single Scalar answers, for the worst lane; not marked.
    using One = ScalarTraits<T>;
    for (const T x :
         {T(0), T(-0.0), T(-1), Limits::quiet_NaN(), -Limits::quiet_NaN(), Limits::infinity(), -Limits::infinity(),
          Limits::denorm_min(), -Limits::denorm_min(), Limits::min(), Limits::max(), T(5)}) {
      mixed = one;
      mixed.set(at, x);
      CHECK(ScalarTraits<Pack<T>>::is_positive(mixed) == One::is_positive(x));
      CHECK(ScalarTraits<Pack<T>>::is_finite(mixed) == One::is_finite(x));
      Vector3<Pack<T>> v(one, mixed, one);
      CHECK(detail::all_finite(v) == One::is_finite(x));
    }
    CHECK_FALSE(LaneVote::divided());
  }
}

/// from_lanes: entry r of lane l becomes entry r of column l, for every size and number of states.
template <class T, int N>
void check_columns()
{
  using P = Lanes<T, N>;
  for (int size = 0; size <= 2 * N + 1; ++size) {
    VectorX<P> rows(size);
    for (int r = 0; r < size; ++r) {
      for (int l = 0; l < N; ++l) { rows(r).set(l, static_cast<T>(100 * r + l)); }
    }
    for (int count = 1; count <= N; ++count) {
      const T untouched = -1;
      MatrixX<T> columns = MatrixX<T>::Constant(size + 1, N, untouched);
      detail::from_lanes(rows.data(), size, count, columns.data(), size + 1);
      for (int l = 0; l < N; ++l) {
        for (int r = 0; r <= size; ++r) {
          CHECK(columns(r, l) == (r < size && l < count ? static_cast<T>(100 * r + l) : untouched));
        }
      }
    }
  }
}

template <class T, int N>
void check_columns_up_to()
{
  check_columns<T, N>();
  if constexpr (N > 1) { check_columns_up_to<T, N / 2>(); }
}

}  // namespace

TEST_CASE("arithmetic in lanes is that of the lanes", "[lanes]")
{
  check_arithmetic<double>();
  check_arithmetic<float>();
}

TEST_CASE("sin and cos in lanes, to about one unit in the last place", "[lanes]")
{
  for (const double size : {1e-8, 0.5, 4.0, 100.0, 1e6}) { check_sine<double>(size); }
  for (const double size : {1e-4, 0.5, 4.0, 100.0, 1e4}) { check_sine<float>(size); }
  check_sine_at_quarter_turns<double>(600000);
  check_sine_at_quarter_turns<float>(6000);
  check_sine_of_anything<double>();
  check_sine_of_anything<float>();
}

TEST_CASE("decisions are for all lanes, or marked", "[lanes]")
{
  check_decisions<double>();
  check_decisions<float>();
}

TEST_CASE("lanes to columns", "[lanes]")
{
  check_columns_up_to<double, Lanes<double>::size>();
  check_columns_up_to<float, Lanes<float>::size>();
}
