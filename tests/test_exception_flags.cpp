// PROGRAM: tests_extreme
// RUNS: optimised
// A cycle at a good state raises no floating-point exception, so that a controller may have them trapped, and computes
// with no subnormal number where the robot has none: three numbers are loaded as four, and what lies behind them must
// not be flags, indices or addresses. One such operand costs Intel's processors some 150 cycles (with clang it was 20
// to 35 % of the time for q̈₀ and B̂). The square-root form has some in comparisons, at no cost.
#include "cycle.hpp"

#include <type_traits>

#if defined(__SSE2__)
#include <xmmintrin.h>
#endif

namespace test_exception_flags {

using namespace iim;
using namespace iim::test;

#if defined(__SSE2__)

constexpr unsigned invalid = 0x01, subnormal = 0x02, zero_divided = 0x04, overflow = 0x08;
constexpr unsigned all = invalid | subnormal | zero_divided | overflow;

/// The processor's flags, which stay set until they are cleared.
template <class F>
unsigned raised(F&& f)
{
  _mm_setcsr(_mm_getcsr() & ~all);
  f();
  return _mm_getcsr() & all;
}

TEST_CASE("flags are seen")
{
  volatile double small = 1e-310, zero = 0, large = 1e300, y = 1;
  CHECK(raised([&] { y = 1 + small; }) == subnormal);
  CHECK(raised([&] { y = zero / zero; }) == invalid);
  CHECK(raised([&] { y = 1 / zero; }) == zero_divided);
  CHECK(raised([&] { y = large * large; }) == overflow);
  CHECK(raised([&] { y = large / 2; }) == 0);
}

template <class Scalar, Update update>
void check_flags(unsigned allowed)
{
  const DynamicTree tree(robot().template cast<Scalar>());
  const Inputs inputs = robot_inputs(tree);
  Workspace<std::remove_const_t<decltype(tree)>, update> ws(tree);
  ImplicitInversion product(tree, inputs);
  UnitForce sweep(tree, inputs);
  for (int k = 0; k < 4; ++k) {
    const VectorX<Scalar> q = coordinates(tree.n_q(), k).template cast<Scalar>();
    const VectorX<Scalar> qd = VectorX<Scalar>::LinSpaced(tree.n_v(), Scalar(-1), Scalar(1 + k));
    bool ok = true;
    CHECK((raised([&] { ok = product(q, qd, ws).ok() && ok; }) & ~allowed) == 0);
    CHECK((raised([&] { ok = sweep(forward_dynamics(q, qd, ws)).ok() && ok; }) & ~allowed) == 0);
    CHECK(ok);
  }
}

TEST_CASE("a cycle raises no flags")
{
  check_flags<double, Update::projected>(0);
  check_flags<float, Update::projected>(0);
  check_flags<double, Update::square_root>(subnormal);
}

#else

TEST_CASE("not seen here") { WARN("which flags are raised is known of x86 processors only"); }

#endif

}  // namespace test_exception_flags
