// PROGRAM: tests_methods
// The factorisation M = LᵀL of random robots: its product, its solutions, and what it says of a singular matrix.
#include <iim/iim.hpp>
#include <iim/mass_matrix/branch_cholesky.hpp>
#include <iim/mass_matrix/sparse_equations.hpp>

#include "catch.hpp"
#include "random_tree.hpp"
#include "worst.hpp"

#include <algorithm>
#include <cstdint>
#include <iostream>
#include <type_traits>
#include <vector>

namespace test_branch_cholesky {

using namespace iim;
using iim::test::keep_worst;

namespace {

constexpr std::uint64_t first_seed = 500;

/// M from its rows by path position, symmetric.
MatrixX<double> dense(const detail::Limbs& limbs, const MatrixX<double>& rows)
{
  const Index n = limbs.n_v();
  MatrixX<double> M = MatrixX<double>::Zero(n, n);
  for (Index v = 0; v < n; ++v) {
    const Index limb = limbs.limb_of_velocity(v);
    limbs.for_each_run(limb, 0, limbs[limb].begin + (v - limbs[limb].v) + 1, [&](Index a, Index first, Index count) {
      for (Index k = 0; k < count; ++k) { M(v, first + k) = M(first + k, v) = rows(a + k, v); }
    });
  }
  return M;
}

}  // namespace

TEST_CASE("the factorisation is M's, branch-sparse and dense, and solves")
{
  constexpr double epsilon = Eigen::NumTraits<double>::epsilon();
  double worst_product = 0, worst_residual = 0;
  for (std::uint64_t seed = first_seed; seed < first_seed + 200; ++seed) {
    CAPTURE(seed);
    test::RandomOptions options;
    options.most = 60;
    const test::RandomRobot robot = test::random_robot(seed, options);
    const DynamicTree tree(robot.assembly);
    if (tree.n_v() == 0) { continue; }
    using DoubleTree = std::remove_const_t<decltype(tree)>;
    const Inputs<DoubleTree> inputs(tree);
    test::Random random(seed);
    const test::RandomState state = test::random_state(tree, 0, random);
    Workspace ws(tree);
    REQUIRE(forward_dynamics(state.q, state.qd, ws).ok());
    detail::SparseEquations<DoubleTree> equations(tree, inputs);
    equations.compute(ws);
    const detail::Limbs limbs(tree);
    const MatrixX<double> M = dense(limbs, equations.M());
    const Index n = tree.n_v();

    detail::BranchCholesky<double> cholesky(limbs);
    REQUIRE(cholesky.factorise(equations.M()) == -1);
    const MatrixX<double> L = dense(limbs, equations.M()).triangularView<Eigen::Lower>();
    keep_worst(worst_product, (L.transpose() * L - M).norm() / M.norm());

    detail::BranchCholesky<double> plain(detail::Limbs::unbranched(n));
    MatrixX<double> full = MatrixX<double>::Zero(detail::padded<double>(n), n);
    full.topRows(n) = M;
    REQUIRE(plain.factorise(full) == -1);
    const MatrixX<double> L_full = MatrixX<double>(full.topRows(n).transpose()).triangularView<Eigen::Lower>();
    keep_worst(worst_product, (L_full.transpose() * L_full - M).norm() / M.norm());

    // One right-hand side on one path, one on all, through four lanes; the others are zero and stay so.
    const Index v = random.below(static_cast<int>(n));
    const Index limb = limbs.limb_of_velocity(v);
    MatrixX<double> b = MatrixX<double>::Zero(n, 4);
    limbs.for_each_run(limb, 0, limbs[limb].begin + (v - limbs[limb].v) + 1, [&](Index, Index first, Index count) {
      for (Index k = 0; k < count; ++k) { b(first + k, 1) = random.uniform(-1, 1); }
    });
    std::vector<double> X(static_cast<std::size_t>(4 * n));
    Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, 4, Eigen::RowMajor>> x(X.data(), n, 4);
    x = b;
    cholesky.begin_solve();
    cholesky.reach(v);
    cholesky.solve<4>(X.data());
    keep_worst(worst_residual, (M * x.col(1) - b.col(1)).norm() / (M.norm() * x.col(1).norm()));
    CHECK(x.col(0).norm() + x.col(2).norm() + x.col(3).norm() == 0);

    for (Index k = 0; k < n; ++k) { b(k, 3) = random.uniform(-1, 1); }
    x = b;
    plain.begin_solve();
    plain.reach(n - 1);
    plain.solve<4>(X.data());
    keep_worst(worst_residual, (M * x - b).norm() / (M.norm() * x.norm()));
  }
  std::cout << "LᵀL against M " << worst_product << ", residual " << worst_residual << '\n';
  // Higham 2002, Theorems 10.3 and 10.4: backward errors of at most (n+1) ε and (3n+1) ε, n ≤ 110 here.
  CHECK(worst_product < 111 * epsilon);
  CHECK(worst_residual < 331 * epsilon);
}

TEST_CASE("a matrix that is not positive definite is found at its velocity")
{
  const Index n = 11;
  for (const Index bad : {Index(0), Index(3), Index(7), Index(10)}) {
    MatrixX<double> M = MatrixX<double>::Zero(detail::padded<double>(n), n);
    for (Index v = 0; v < n; ++v) { M(v, v) = v == bad ? 0.0 : 1.0; }
    detail::BranchCholesky<double> cholesky(detail::Limbs::unbranched(n));
    CHECK(cholesky.factorise(M) == bad);
  }
}

}  // namespace test_branch_cholesky
