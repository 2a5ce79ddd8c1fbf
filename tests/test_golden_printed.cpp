// REQUIRES: json
// Implicit inversion, with M̄* updated as the paper prints it, against values that share no formula with it, on all
// models and states.
#include "golden.hpp"

#include <iim/iim.hpp>

using namespace iim;
using namespace iim::test;

namespace {

double worst(const Golden& golden)
{
  const DynamicTree tree(golden.assembly);
  return implicit_inversion_error<Update::printed>(tree, golden_inputs(tree, golden), golden);
}

}  // namespace

TEST_CASE("implicit inversion with the printed update agrees with the golden values")
{
  for (const char* name : golden_models) {
    const auto golden = read_golden(name);
    if (!golden) { continue; }
    const double error = worst(*golden);
    INFO(name << ": relative error " << error);
    CHECK(error <= golden_bound);
  }
}
