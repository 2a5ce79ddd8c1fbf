// REQUIRES: json
// PROGRAM: tests_methods
// Implicit inversion on the other forms of M̄*'s update against values that share no formula with it.
#include "golden.hpp"

#include <iim/iim.hpp>

namespace test_golden_printed {

using namespace iim;
using namespace iim::test;

namespace {

template <Update update>
GoldenError worst(const Golden& golden)
{
  const DynamicTree tree(golden.assembly);
  const auto inputs = golden_inputs(tree, golden);
  ImplicitInversion method(tree, inputs);
  return golden_error<update>(method, tree, golden);
}

}  // namespace

TEST_CASE("implicit inversion with the update as printed agrees with the golden values")
{
  for (const char* name : golden_models) {
    const auto golden = read_golden(name);
    if (!golden) { continue; }
    const GoldenError error = worst<Update::printed>(*golden);
    INFO(name << ": " << error);
    CHECK(error.qdd0 <= golden_bound);
    CHECK(error.Bhat <= golden_bound);
  }
}

TEST_CASE("implicit inversion in square-root form agrees with the golden values")
{
  for (const char* name : golden_models) {
    const auto golden = read_golden(name);
    if (!golden) { continue; }
    const GoldenError error = worst<Update::square_root>(*golden);
    INFO(name << ": " << error);
    CHECK(error.qdd0 <= few);
    CHECK(error.Bhat <= few);
    CHECK(error.columns <= few);
  }
}

}  // namespace test_golden_printed
