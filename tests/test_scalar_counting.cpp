// PROGRAM: tests_counts
// A Scalar that counts its operations: what a scene costs is a number, and what it does not need costs nothing.
#include "catch.hpp"
#include "counted.hpp"
#include "random_tree.hpp"

#include <iim/models.hpp>

#include <cmath>
#include <limits>

namespace test_scalar_counting {

using namespace iim;

namespace {

using test::Counted;
using Assembly = StandardAssembly<Counted>;
using Tree = decltype(DynamicTree(std::declval<Assembly>()));

struct Scenario {
  Tree tree;
  Inputs<Tree> inputs;
  Workspace<Tree> ws;
  ImplicitInversion<Tree> method;
  VectorX<Counted> q, qd;

  Scenario(const Assembly& assembly, bool motors, Index contacts)
      : tree(assembly), inputs(make(tree, motors, contacts)), ws(tree), method(tree, inputs), q(tree.n_q()),
        qd(tree.n_v())
  {
    test::Random draw(1);
    const test::RandomState state = test::random_state(tree, 0, draw);
    q = state.q.cast<Counted>();
    qd = state.qd.cast<Counted>();
  }

  static Inputs<Tree> make(const Tree& tree, bool motors, Index contacts)
  {
    Inputs<Tree> inputs(tree, motors ? Start::all_motors : Start::empty);
    for (Index k = 0; k < contacts; ++k) { inputs.add_force(tree.name(tree.size() - 1)); }
    return inputs;
  }

  template <Scene scene = Scene{}>
  long pass()
  {
    return test::count_products([&] { REQUIRE(forward_dynamics<scene>(q, qd, ws).ok()); });
  }
  long invert()
  {
    const auto fd = forward_dynamics(q, qd, ws);
    return test::count_products([&] { REQUIRE(method(fd).ok()); });
  }
};

long pass_of_chain(Index n) { return Scenario(models::chain<Counted>(n), true, 0).pass(); }

}  // namespace

TEST_CASE("the O(n) pass is O(n): every further link costs the same", "[scalar]")
{
  const long step = pass_of_chain(12) - pass_of_chain(11);
  CHECK(step > 0);
  for (const Index n : {3, 20, 50}) { CHECK(pass_of_chain(n + 1) - pass_of_chain(n) == step); }
  // An upper limit that nobody crosses unnoticed; one link of a chain about y, all terms, projected update.
  CHECK(step < 375);  // 367
}

TEST_CASE("a scene without velocity or gravity costs less", "[scalar]")
{
  Scenario biped(models::biped<Counted>(), true, 0);
  const long full = biped.pass();
  const long still = biped.pass<Scene{.velocity = false}>();
  const long falling = biped.pass<Scene{.gravity = false}>();
  CHECK(still < full * 4 / 5);
  CHECK(falling <= full);
}

TEST_CASE("an inactive input costs what no input costs", "[scalar]")
{
  Scenario without(models::biped<Counted>(), true, 0);
  Scenario with(models::biped<Counted>(), true, 3);
  const long active = with.invert();
  for (Index id = with.inputs.blocks() - 3; id < with.inputs.blocks(); ++id) { with.inputs.set_active(id, false); }
  CHECK(with.invert() == without.invert());
  CHECK(active > without.invert());
}

TEST_CASE("B̂ of a chain costs what its size says", "[scalar]")
{
  // Γ⁻¹, F* and what is made of them take 9n², L β n³/6 for a fully actuated chain.
  for (const Index n : {10, 20, 40, 80}) {
    Scenario chain(models::chain<Counted>(n), true, 0);
    const double size = static_cast<double>(n);
    const double products = static_cast<double>(chain.invert());
    INFO("n = " << n << ": " << products << " products");
    CHECK(products < size * size * size / 6 + 9.5 * size * size);
  }
  // One more force at the tip: 3 columns of n rows and the path's six-vectors, O(n) per column and not O(n²), as a
  // product (20 links) and by sweeps.
  const auto extra = [](Index n) {
    return Scenario(models::chain<Counted>(n), false, 3).invert() -
           Scenario(models::chain<Counted>(n), false, 2).invert();
  };
  CHECK(extra(20) <= 800);
  CHECK(extra(40) <= 3800);
  CHECK(extra(80) <= 7600);
}

TEST_CASE("what is zero in B̂'s factors is not multiplied", "[scalar]")
{
  // The product of a binary tree is far smaller than that of a chain.
  Scenario tree(models::binary_tree<Counted>(31), true, 0);
  Scenario chain(models::chain<Counted>(31), true, 0);
  CHECK(tree.invert() * 2 < chain.invert());
}

// std::numeric_limits is not specialised for it.
TEST_CASE("after a failure NaN, of such a Scalar, too", "[scalar]")
{
  Scenario scenario(models::chain<Counted>(3), true, 0);
  scenario.q(1) = std::numeric_limits<double>::infinity();
  const auto result = scenario.method(scenario.q, scenario.qd, scenario.ws);
  CHECK(result.status == Status::invalid_state);
  for (Index i = 0; i < 3; ++i) {
    CHECK(std::isnan(result.qdd0(i).x));
    for (Index j = 0; j < 3; ++j) { CHECK(std::isnan(result.Bhat(i, j).x)); }
  }
}

}  // namespace test_scalar_counting
