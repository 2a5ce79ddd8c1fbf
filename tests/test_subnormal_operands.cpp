// RUNS: optimised
// No step of a cycle computes with subnormal numbers where a robot has none: three numbers are loaded as four, and what
// lies behind them must not be flags, indices or addresses. One such operand costs Intel's processors some 150 cycles
// (with clang it was 20 to 35 % of the time for q̈₀ and B̂). The square-root form has some in comparisons, at no cost.
#include "cycle.hpp"

#if defined(__SSE2__)
#include <xmmintrin.h>
#endif

namespace test_subnormal_operands {

using namespace iim;
using namespace iim::test;

#if defined(__SSE2__)

/// Whether f had a subnormal operand.
template <class F>
bool meets_subnormals(F&& f)
{
  constexpr unsigned flag = 0x0002;  // DE, which stays set until it is cleared
  _mm_setcsr(_mm_getcsr() & ~flag);
  f();
  return (_mm_getcsr() & flag) != 0;
}

TEST_CASE("a subnormal operand is seen")
{
  volatile double x = 1e-310, y = 1;
  CHECK(meets_subnormals([&] { y = y + x; }));
  CHECK(!meets_subnormals([&] { y = y * 2; }));
}

template <class Scalar>
void check_no_subnormals()
{
  const DynamicTree tree(robot().template cast<Scalar>());
  const Inputs inputs = robot_inputs(tree);
  Workspace ws(tree);
  ImplicitInversion product(tree, inputs);
  UnitForce sweep(tree, inputs);
  for (int k = 0; k < 4; ++k) {
    const VectorX<Scalar> q = coordinates(tree.n_q(), k).template cast<Scalar>();
    const VectorX<Scalar> qd = VectorX<Scalar>::LinSpaced(tree.n_v(), Scalar(-1), Scalar(1 + k));
    bool ok = true;
    CHECK(!meets_subnormals([&] { ok = product(q, qd, ws).ok() && ok; }));
    CHECK(!meets_subnormals([&] { ok = sweep(forward_dynamics(q, qd, ws)).ok() && ok; }));
    CHECK(ok);
  }
}

TEST_CASE("no operand of a cycle is subnormal")
{
  check_no_subnormals<double>();
  check_no_subnormals<float>();
}

#else

TEST_CASE("not seen here") { WARN("whether operands are subnormal is known of x86 processors only"); }

#endif

}  // namespace test_subnormal_operands
