// REQUIRES: json
// Implicit inversion on the other forms of M̄*'s update against values that share no formula with it.
#include "golden.hpp"

#include <iim/iim.hpp>

#include <limits>

using namespace iim;
using namespace iim::test;

namespace {

template <Update update>
double worst(const Golden& golden)
{
  const DynamicTree tree(golden.assembly);
  const auto inputs = golden_inputs(tree, golden);
  ImplicitInversion method(tree, inputs);
  return golden_error_of<update>(method, tree, golden);
}

}  // namespace

TEST_CASE("implicit inversion with the update as printed agrees with the golden values")
{
  for (const char* name : golden_models) {
    const auto golden = read_golden(name);
    if (!golden) { continue; }
    const double error = worst<Update::printed>(*golden);
    INFO(name << ": relative error " << error);
    CHECK(error <= golden_bound);
  }
}

// A few ε as the projected one (DESIGN.md 4), times a column that is small beside the others.
TEST_CASE("implicit inversion in square-root form agrees with the golden values")
{
  for (const char* name : golden_models) {
    const auto golden = read_golden(name);
    if (!golden) { continue; }
    const double error = worst<Update::square_root>(*golden);
    INFO(name << ": relative error " << error);
    CHECK(error <= 256 * std::numeric_limits<double>::epsilon());
  }
}
