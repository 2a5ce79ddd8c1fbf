// REQUIRES: json
// Implicit inversion against values that share no formula with it, on all models and states.
#include "golden.hpp"

#include <iim/iim.hpp>

#include <limits>
#include <variant>

using namespace iim;
using namespace iim::test;

namespace {

double worst(const Golden& golden)
{
  const DynamicTree tree(golden.assembly);
  const auto inputs = golden_inputs(tree, golden);
  ImplicitInversion method(tree, inputs);
  return golden_error_of<Update::projected>(method, tree, golden);
}

}  // namespace

// The projected update holds the error of B̂ at a few ε (DESIGN.md 4); 256 of them since a column of B̂ may be small
// beside the others, and its error is theirs.
TEST_CASE("implicit inversion agrees with the golden values")
{
  for (const char* name : golden_models) {
    const auto golden = read_golden(name);
    if (!golden) { continue; }
    const double error = worst(*golden);
    INFO(name << ": relative error " << error);
    CHECK(error <= 256 * std::numeric_limits<double>::epsilon());
  }
}

TEST_CASE("a mass that is wrong in the tenth digit is seen by the comparison")
{
  const auto golden = read_golden("chain5");
  if (!golden) { return; }
  Golden wrong = *golden;
  wrong.assembly = {};
  for (const auto& part : golden->assembly.parts()) {
    auto link = std::get<RevoluteLink<double>>(part.part);
    if (part.name == "j4") { link.body.mass *= 1 + 1e-10; }
    wrong.assembly.add(part.name, part.on, link);
  }
  CHECK(worst(wrong) > 10 * golden_bound);
}
