// REQUIRES: json
// PROGRAM: tests_methods
// Every other method against values that share no formula with it, on all models and states.
#include "golden.hpp"

#include <iim/global_inverse.hpp>
#include <iim/iim.hpp>
#include <iim/recursive_inverse.hpp>
#include <iim/unit_force.hpp>

namespace test_golden_methods {

using namespace iim;
using namespace iim::test;

namespace {

using GoldenTree = DynamicTree<RevoluteLink<double>, FloatingBase<double>, PrismaticLink<double>>;

template <class Method>
void check(const char* title)
{
  for (const char* name : golden_models) {
    const auto golden = read_golden(name);
    if (!golden) { continue; }
    const GoldenTree tree(golden->assembly);
    const auto inputs = golden_inputs(tree, *golden);
    Method method(tree, inputs);
    const GoldenError error = golden_error<Update::projected>(method, tree, *golden);
    INFO(title << ", " << name << ": " << error);
    CHECK(error.qdd0 <= golden_bound);
    CHECK(error.Bhat <= golden_bound);
  }
}

}  // namespace

TEST_CASE("unit forces agree with the golden values")
{
  check<UnitForcePublished<GoldenTree>>("as published");
  check<UnitForce<GoldenTree>>("on the workspace");
}

TEST_CASE("global inverses agree with the golden values")
{
  check<GlobalInverse<GoldenTree, Factorization::dense>>("dense");
  check<GlobalInverse<GoldenTree, Factorization::branch_sparse>>("branch-sparse");
}

TEST_CASE("the recursive inverse agrees with the golden values") { check<RecursiveInverse<GoldenTree>>("recursive"); }

}  // namespace test_golden_methods
