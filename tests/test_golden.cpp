// REQUIRES: json
// Implicit inversion against values that share no formula with it, on all five models and all their states.
#include "golden.hpp"

#include <iim/iim.hpp>

#include <limits>
#include <type_traits>
#include <variant>

using namespace iim;
using namespace iim::test;

namespace {

/// Largest error over the states.
template <Update update>
double worst(const Golden& golden)
{
  const DynamicTree tree(golden.assembly);
  const auto inputs = golden_inputs(tree, golden);
  Workspace<std::remove_const_t<decltype(tree)>, update> ws(tree);
  ImplicitInversion method(tree, inputs);
  double error = 0;
  for (const GoldenState& state : golden.states) {
    const auto result = method(forward_dynamics(state.q, state.v, ws));
    REQUIRE(result.ok());
    const double e = golden_error(result, state);
    if (!(e <= error)) { error = e; }
  }
  return error;
}

}  // namespace

// The projected update holds the error of B̂ at a few ε (DESIGN.md 4); 256 of them since a column of B̂ may be small
// beside the others, and its error is theirs.
TEST_CASE("implicit inversion agrees with the golden values")
{
  for (const char* name : golden_models) {
    const auto golden = read_golden(name);
    if (!golden) { continue; }
    const double projected = worst<Update::projected>(*golden);
    const double printed = worst<Update::printed>(*golden);
    INFO(name << ": relative error projected " << projected << ", as printed " << printed);
    CHECK(projected <= 256 * std::numeric_limits<double>::epsilon());
    CHECK(printed <= golden_bound);
  }
}

TEST_CASE("a wrong body is seen by the comparison with the golden values")
{
  const auto golden = read_golden("chain5");
  if (!golden) { return; }
  Golden wrong = *golden;
  StandardAssembly<double> assembly;
  for (auto part : golden->assembly.parts()) {
    auto link = std::get<RevoluteLink<double>>(part.part);
    if (part.name == "j4") { link.body.mass *= 1 + 1e-10; }
    assembly.add(part.name, part.on, link);
  }
  wrong.assembly = assembly;
  CHECK(worst<Update::projected>(wrong) > 10 * golden_bound);
}
