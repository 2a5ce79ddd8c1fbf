// PROGRAM: tests_methods
// RUNS: optimised
// All input-Jacobian methods give the same B̂ and q̈₀: 10⁴ random robots of all types, random states and inputs.
#include <iim/global_inverse.hpp>
#include <iim/iim.hpp>
#include <iim/recursive_inverse.hpp>
#include <iim/unit_force.hpp>

#include "catch.hpp"
#include "random_tree.hpp"

#include <algorithm>
#include <cstdint>
#include <iostream>
#include <string>

namespace test_methods_agree {

using namespace iim;

namespace {

/// Largest differences seen, and where.
struct Worst {
  double Bhat = 0, qdd0 = 0;
  std::uint64_t Bhat_seed = 0, qdd0_seed = 0;

  /// ‖ΔB̂‖/‖B̂‖ and ‖Δq̈₀‖/‖q̈₀‖ (Frobenius); zero stands against zero only.
  void take(const AffineDynamics<double>& reference, const AffineDynamics<double>& other, std::uint64_t seed)
  {
    const auto relative = [](double difference, double size) { return difference == 0 ? 0 : difference / size; };
    const double b = relative((other.Bhat - reference.Bhat).norm(), reference.Bhat.norm());
    const double q = relative((other.qdd0 - reference.qdd0).norm(), reference.qdd0.norm());
    if (!(b <= Bhat)) {
      Bhat = b;
      Bhat_seed = seed;
    }
    if (!(q <= qdd0)) {
      qdd0 = q;
      qdd0_seed = seed;
    }
  }

  void print(const char* method) const
  {
    std::cout << "  " << method << ": B̂ " << Bhat << " (seed " << Bhat_seed << "), q̈₀ " << qdd0 << " (seed "
              << qdd0_seed << ")\n";
  }
};

// Seeds of the 10⁴ robots; a robot without a velocity has nothing to compare and is passed over for the next.
constexpr std::uint64_t first_seed = 20000;
constexpr int robots = 10000;

// Roundings on paths of at most 60 subsystems, some ten in each. The published unit forces are differences of
// accelerations, and have the roundings of q̈_[0] + B̂e (21): a few times those of B̂ for these robots.
constexpr double epsilon = Eigen::NumTraits<double>::epsilon();
constexpr double recursive_tolerance = 600 * epsilon;
constexpr double published_tolerance = 10 * recursive_tolerance;
// Cholesky's error is proportional to cond(M), for these robots 4·10³ in the median and up to 10⁶: 10⁶ ε = 2·10⁻¹⁰.
constexpr double cholesky_tolerance = 1e-10;

}  // namespace

TEST_CASE("all methods agree on random robots")
{
  Worst unit, single, published, sparse, dense, kinematic, recursive;
  int compared = 0, columns = 0, velocities = 0;
  for (std::uint64_t seed = first_seed; compared < robots; ++seed) {
    test::RandomOptions options;
    options.most = 60;
    const test::RandomRobot robot = test::random_robot(seed, options);
    const DynamicTree tree(robot.assembly);
    if (tree.n_v() == 0) { continue; }
    ++compared;
    using Tree = std::remove_const_t<decltype(tree)>;
    const auto inputs = test::make_inputs(tree, robot.inputs);
    test::Random random(seed + 1000000);
    const test::RandomState state = test::random_state(tree, inputs.columns(), random);
    columns += static_cast<int>(inputs.columns());
    velocities += static_cast<int>(tree.n_v());

    Workspace ws(tree);
    ImplicitInversion<Tree> implicit_inversion(tree, inputs);
    UnitForce<Tree> unit_force(tree, inputs);
    UnitForce<Tree, 1> unit_force_single(tree, inputs);
    UnitForcePublished<Tree> unit_force_published(tree, inputs);
    GlobalInverse<Tree> global_inverse(tree, inputs);
    GlobalInverse<Tree, Factorization::dense> global_inverse_dense(tree, inputs);
    RecursiveInverse<Tree> recursive_inverse(tree, inputs);

    const auto fd = forward_dynamics(state.q, state.qd, ws);
    CAPTURE(seed, to_string(fd.status()));
    REQUIRE(fd.ok());
    const auto reference = implicit_inversion(fd);
    REQUIRE(reference.ok());
    const auto compare = [&](Worst& worst, const AffineDynamics<double>& other) {
      if (!other.ok()) { FAIL(to_string(other.status) << " at subsystem " << other.subsystem); }
      REQUIRE(other.Bhat.cols() == inputs.columns());
      worst.take(reference, other, seed);
    };
    compare(unit, unit_force(fd));
    compare(single, unit_force_single(fd));
    compare(published, unit_force_published(fd, state.q, state.qd));
    compare(sparse, global_inverse(fd));
    compare(dense, global_inverse_dense(fd));
    compare(recursive, recursive_inverse(fd));
    compare(kinematic, global_inverse(state.q, state.qd, ws));  // overwrites the workspace
  }

  std::cout << compared << " robots from seed " << first_seed << ", " << velocities << " velocities and " << columns
            << " columns in all; largest relative difference from implicit inversion:\n";
  unit.print("unit forces");
  single.print("unit forces one by one");
  published.print("unit forces as published");
  recursive.print("recursive inverse");
  sparse.print("global inverse, branch-sparse");
  dense.print("global inverse, dense");
  kinematic.print("global inverse without the O(n) pass");

  for (const Worst* worst : {&unit, &single, &published, &recursive}) {
    CHECK(worst->Bhat <= (worst == &published ? published_tolerance : recursive_tolerance));
    CHECK(worst->qdd0 == 0);  // theirs is that of the O(n) pass
  }
  for (const Worst* worst : {&sparse, &dense, &kinematic}) {
    CHECK(worst->Bhat <= cholesky_tolerance);
    CHECK(worst->qdd0 <= cholesky_tolerance);
  }
  // The pool is what it says: robots of some size, with inputs.
  CHECK(velocities > 30 * robots);
  CHECK(columns > 15 * robots);
}

}  // namespace test_methods_agree
