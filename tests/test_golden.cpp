// REQUIRES: json
// PROGRAM: tests_methods
// Implicit inversion against values that share no formula with it, on all models and states.
#include "golden.hpp"

#include <iim/iim.hpp>

#include <variant>

namespace test_golden {

using namespace iim;
using namespace iim::test;

namespace {

GoldenError worst(const Golden& golden)
{
  const DynamicTree tree(golden.assembly);
  const auto inputs = golden_inputs(tree, golden);
  ImplicitInversion method(tree, inputs);
  return golden_error<Update::projected>(method, tree, golden);
}

}  // namespace

TEST_CASE("implicit inversion agrees with the golden values")
{
  for (const char* name : golden_models) {
    const auto golden = read_golden(name);
    if (!golden) { continue; }
    const GoldenError error = worst(*golden);
    INFO(name << ": " << error);
    CHECK(error.qdd0 <= few);
    CHECK(error.Bhat <= few);
    CHECK(error.columns <= few);
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
  CHECK(worst(wrong).Bhat > 10 * golden_bound);
}

}  // namespace test_golden
