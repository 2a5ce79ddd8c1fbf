// PROGRAM: tests_extreme
// Where a pivot is told from its roundings: what must be refused, and what only looks as if.
#include "catch.hpp"
#include "random_tree.hpp"

#include <iim/iim.hpp>
#include <iim/models.hpp>

#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <utility>

namespace test_status_sizes {

using namespace iim;

namespace {

template <class Scalar>
using Tree = decltype(DynamicTree(std::declval<const StandardAssembly<Scalar>&>()));

/// A floating base with one limb of one to five links, `load` times as heavy as the random bodies are.
StandardAssembly<double> base_and_limb(const Body<double>& base, double load, test::Random& random)
{
  StandardAssembly<double> assembly;
  assembly.add("base", {}, FloatingBase<double>{base});
  std::string parent = "base";
  for (int k = random.below(5); k >= 0; --k) {
    RevoluteLink<double> link{{random.axis()}, random.body()};
    link.body.mass *= load;
    link.body.inertia *= load;
    const std::string name = "link" + std::to_string(k);
    assembly.add(name, {parent, random.rotation(), random.vector(0.5)}, link);
    parent = name;
  }
  return assembly;
}

template <class Scalar>
Status square_root_status(const StandardAssembly<double>& assembly, test::Random& random)
{
  const Tree<Scalar> tree(assembly.cast<Scalar>());
  Workspace<Tree<Scalar>, Update::square_root> ws(tree);
  const test::RandomState x = test::random_state(tree, 0, random);
  return forward_dynamics(x.q.cast<Scalar>().eval(), x.qd.cast<Scalar>().eval(), ws).status();
}

/// Of q̈₀ at the state rounded to float, relative, in the norm; nothing if float refuses.
template <class Exact, class Float>
std::optional<double> error_in_float(const test::RandomState& x, Exact& exact_ws, Float& ws)
{
  const VectorX<float> q = x.q.cast<float>(), qd = x.qd.cast<float>();
  const auto reference = forward_dynamics(q.cast<double>().eval(), qd.cast<double>().eval(), exact_ws);
  const auto fd = forward_dynamics(q, qd, ws);
  REQUIRE(reference.ok());
  if (!fd.ok()) { return {}; }
  return (fd.qdd0().template cast<double>() - reference.qdd0()).norm() / reference.qdd0().norm();
}

}  // namespace

TEST_CASE("a chain of 1000 links in a plane is heavy across the plane only: float has all of its digits")
{
  const StandardAssembly<double> chain = models::chain<double>(1000);
  const Tree<double> exact(chain);
  const Tree<float> tree(chain.cast<float>());
  Workspace<Tree<double>> exact_ws(exact);
  Workspace<Tree<float>> ws(tree);
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    test::Random random(seed);
    const test::RandomState x = test::random_state(exact, 0, random);
    const std::optional<double> error = error_in_float(x, exact_ws, ws);
    REQUIRE(error);
    CHECK(*error < 64 * std::numeric_limits<float>::epsilon());
  }
}

TEST_CASE("arms under loads that float cannot hold: refused rather than wrong")
{
  // Loads to 1e12 times the links: what float has left of the arm is wrong by more than 10 % or refused; of the former
  // none. Up to 1e4 times, all states are computed, of 3000 under 1e6 95 %.
  int refused_light = 0, refused_at_1e6 = 0, refused_heavy = 0;
  for (const double load : {1e2, 1e3, 1e4, 1e6, 1e9, 1e12}) {
    Assembly<RevoluteLink<double>> arm;
    arm.set_gravity({0, 0, -9.81});
    for (int k = 0; k < 7; ++k) {
      RevoluteLink<double> link{{Vector3<double>::Unit(k % 2 == 0 ? 2 : 1)}, {}};
      link.body.mass = k == 6 ? load : 1;
      link.body.com = {0.1, 0, -0.2};
      link.body.inertia = link.body.mass * Vector3<double>(0.02, 0.025, 0.015).asDiagonal().toDenseMatrix();
      arm.add("link" + std::to_string(k),
              {.parent = k == 0 ? "world" : "link" + std::to_string(k - 1), .p = {0, 0.05, k == 0 ? 0 : -0.4}}, link);
    }
    const DynamicTree tree(arm.cast<float>());
    const DynamicTree exact(arm.cast<float>().cast<double>());
    Workspace ws(tree);
    Workspace<decltype(exact), Update::square_root> exact_ws(exact);
    for (std::uint64_t seed = 1; seed <= 100; ++seed) {
      test::Random random(seed);
      const test::RandomState x = test::random_state(exact, 0, random);
      const std::optional<double> error = error_in_float(x, exact_ws, ws);
      if (!error) {
        ++(load < 1e6 ? refused_light : load > 1e6 ? refused_heavy : refused_at_1e6);
        continue;
      }
      CAPTURE(load, seed);
      CHECK(*error < 0.1);
    }
  }
  CHECK(refused_light == 0);
  CHECK(refused_at_1e6 <= 12);
  CHECK(refused_heavy > 150);
}

TEST_CASE("square-root form: a base without mass on one limb is refused, a base up to 1e10 times lighter is not")
{
  for (std::uint64_t seed = 1; seed <= 30; ++seed) {
    CAPTURE(seed);
    test::Random random(seed);
    const auto massless = base_and_limb(Body<double>::massless(), 1, random);
    CHECK(square_root_status<double>(massless, random) == Status::not_positive_definite);
    CHECK(square_root_status<float>(massless, random) == Status::not_positive_definite);
    const auto light = base_and_limb(random.body(), std::pow(10.0, random.uniform(0, 10)), random);
    CHECK(square_root_status<double>(light, random) == Status::ok);
    CHECK(square_root_status<float>(light, random) == Status::ok);
  }
}

}  // namespace test_status_sizes
