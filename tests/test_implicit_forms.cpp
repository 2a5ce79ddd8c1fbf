// PROGRAM: tests_no_heap
// Implicit inversion as a product and by sweeps: the same B̂, the cheaper one chosen, and memory O(n) where that is
// enough.
#include "catch.hpp"
#include "random_tree.hpp"

#include <iim/models.hpp>

#include <limits>

#include "heap_counter.hpp"

using namespace iim;

namespace {

using Tree = decltype(DynamicTree(std::declval<StandardAssembly<double>>()));

/// With a form of one's choice.
struct Form : ImplicitInversion<Tree> {
  Form(const Tree& tree, const Inputs<Tree>& inputs, bool product)
      : ImplicitInversion<Tree>(tree, inputs, product ? 0 : inputs.max_columns() + 1)
  {
  }
};

template <class Scalar>
Index product_from(const StandardAssembly<Scalar>& assembly)
{
  const DynamicTree tree(assembly);
  const Inputs inputs(tree);
  return ImplicitInversion(tree, inputs).product_from();
}

}  // namespace

TEST_CASE("product and sweep are the same B̂")
{
  constexpr double eps = std::numeric_limits<double>::epsilon();
  test::RandomOptions options;
  options.most = 40;
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    INFO("seed " << seed);
    const test::RandomRobot random = test::random_robot(seed, options);
    const Tree tree(random.assembly);
    const Inputs inputs = test::make_inputs(tree, random.inputs);
    test::Random draw(seed);
    const test::RandomState state = test::random_state(tree, 0, draw);
    Workspace ws(tree);
    Form product(tree, inputs, true), sweep(tree, inputs, false);
    ImplicitInversion method(tree, inputs);
    const auto fd = forward_dynamics(state.q, state.qd, ws);
    const auto a = product(fd);
    const auto b = sweep(fd);
    const auto c = method(fd);
    REQUIRE(a.ok());
    REQUIRE(b.ok());
    // Row by row: both sum along a path, of up to 40 subsystems with gears of 100. Rows may vanish, up to roundings.
    const double rounding = 16 * eps * a.Bhat.norm();
    for (Index i = 0; i < tree.n_v(); ++i) {
      CHECK((a.Bhat.row(i) - b.Bhat.row(i)).norm() <= 1e5 * eps * a.Bhat.row(i).norm() + rounding);
    }
    const bool chosen = inputs.columns() >= method.product_from();
    CHECK(c.Bhat == (chosen ? MatrixX<double>(a.Bhat) : MatrixX<double>(b.Bhat)));
  }
}

namespace {

/// One call for the pass and B̂ against one for each.
void check_one_call(const test::RandomRobot& random, bool product)
{
  const Tree tree(random.assembly);
  const Inputs inputs = test::make_inputs(tree, random.inputs);
  Workspace ws(tree), other(tree);
  Form in_one(tree, inputs, product), in_two(tree, inputs, product);
  test::Random draw(17);
  for (int k = 0; k < 2; ++k) {
    const test::RandomState state = test::random_state(tree, 0, draw);
    const auto fd = forward_dynamics(state.q, state.qd, other);
    const auto two = in_two(fd);
    const auto one = in_one(state.q, state.qd, ws);
    REQUIRE(two.ok());
    REQUIRE(one.ok());
    REQUIRE(one.fd.ok());
    CHECK(one.fd.scene() == Scene{});
    CHECK(&one.fd.workspace() == &ws);
    constexpr double eps = std::numeric_limits<double>::epsilon();
    CHECK((one.Bhat - two.Bhat).norm() <= 4 * eps * two.Bhat.norm());  // compilers may contract other products
    CHECK((one.qdd0 - two.qdd0).norm() <= 64 * eps * two.qdd0.norm());
    CHECK(one.fd.qdd0() == one.qdd0);
    VectorX<double> bad = state.q;
    bad(tree.n_q() - 1) = std::numeric_limits<double>::infinity();
    const auto wrong = in_one(bad, state.qd, ws);
    CHECK(wrong.status == Status::invalid_state);
    CHECK(wrong.fd.status() == Status::invalid_state);
    CHECK(wrong.subsystem == in_two(forward_dynamics(bad, state.qd, other)).subsystem);
    CHECK(wrong.qdd0.array().isNaN().all());
    CHECK(wrong.Bhat.array().isNaN().all());
  }
}

}  // namespace

TEST_CASE("the pass and B̂ in one call are those of two calls")
{
  test::RandomOptions options;
  options.most = 40;
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    INFO("seed " << seed);
    const test::RandomRobot random = test::random_robot(seed, options);
    if (Tree(random.assembly).n_v() == 0) { continue; }
    for (const bool product : {true, false}) {
      INFO("product " << product);
      check_one_call(random, product);
    }
  }
}

TEST_CASE("what was active before leaves nothing behind")
{
  test::RandomOptions options;
  options.most = 40;
  int changed = 0;
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    INFO("seed " << seed);
    const test::RandomRobot random = test::random_robot(seed, options);
    const Tree tree(random.assembly);
    Inputs inputs = test::make_inputs(tree, random.inputs);
    test::Random draw(seed);
    Workspace ws(tree);
    Form product(tree, inputs, true), sweep(tree, inputs, false);
    for (std::uint64_t choice :
         {0xffff'ffffu, 0x5555'3333u, 0x0f0f'0101u, 0u, 0xf0f0'8421u, 0xf0f0'8421u, 0xffff'ffffu}) {
      for (Index id = 0; id < inputs.blocks(); ++id) { inputs.set_active(id, (choice >> (id % 32) & 1u) != 0); }
      const test::RandomState state = test::random_state(tree, 0, draw);
      const auto fd = forward_dynamics(state.q, state.qd, ws);
      Form new_product(tree, inputs, true), new_sweep(tree, inputs, false);
      const auto a = product(fd), b = new_product(fd), c = sweep(fd), d = new_sweep(fd);
      REQUIRE(a.ok());
      CHECK(a.Bhat.cols() == inputs.columns());
      CHECK(a.Bhat == b.Bhat);  // to the last bit: the same operations
      CHECK(c.Bhat == d.Bhat);
      // A copy does not refer to what it was copied from.
      Form copy = new_product;
      inputs.set_active(0, !inputs.block(0).active);
      REQUIRE(new_product(fd).ok());
      inputs.set_active(0, !inputs.block(0).active);
      CHECK(copy(fd).Bhat == a.Bhat);
      changed += inputs.columns() < inputs.max_columns();
    }
  }
  CHECK(changed > 200);
}

TEST_CASE("the product pays on short paths and for many inputs")
{
  // Where exactly, depends on the width of the registers.
  CHECK(product_from(models::chain<double>(3)) <= 2);
  CHECK(product_from(models::chain<double>(7)) <= 8);
  CHECK(product_from(models::chain<double>(20)) <= 9);
  CHECK(product_from(models::chain<double>(50)) > 4);  // a sweep of a register's columns takes as long
  CHECK(product_from(models::chain<double>(50)) <= 33);
  CHECK(product_from(models::binary_tree<double>(63)) <= 9);
  CHECK(product_from(models::chain<double>(200)) >= 200);    // half of it is computed where all joints are driven
  CHECK(product_from(models::chain<double>(300)) == 301);    // never
  CHECK(product_from(models::chain<double>(1000)) == 1001);  // never
  CHECK(product_from(models::chain<float>(100)) == 101);     // never: L has numbers without a full mantissa
  CHECK(product_from(models::binary_tree<float>(127)) <= 9);
}

#ifdef IIM_COUNTS
TEST_CASE("workspace and method of a chain of 1000 links with one input take less than 2 MB")
{
  const Tree tree(models::chain<double>(1000));
  Inputs inputs(tree, Start::empty);
  inputs.add_motor(tree.name(999));
  const long before = heap_bytes;
  Workspace ws(tree);
  ImplicitInversion method(tree, inputs);
  const long bytes = heap_bytes - before;
  INFO(bytes << " bytes");
  CHECK(bytes < 2'000'000);
  CHECK(method(forward_dynamics(VectorX<double>::Zero(1000), VectorX<double>::Zero(1000), ws)).ok());
}
#endif
