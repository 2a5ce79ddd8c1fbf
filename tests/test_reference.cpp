// The paper against itself: every way that it gives to B̂ and q̈₀ leads to the same numbers, in 50 digits.
// REQUIRES: boost
#include "catch.hpp"

#include "reference/literal.hpp"
#include "reference/multiprecision.hpp"

using namespace iim;
using namespace iim::reference;
using test::RandomOptions;

namespace {

using Matrix = Dense<Digits50>;

// 50 digits, ten of them for the condition number of M (here below 1e8) and for sums over at most 40 velocities.
constexpr double tolerance = 1e-40;

}  // namespace

TEST_CASE("every form of the paper gives the same B̂ and q̈₀", "[reference]")
{
  RandomOptions options;
  options.most = 9;
  options.floating_inside = 0.1;
  for (std::uint64_t seed = 1; seed <= 25; ++seed) {
    INFO("seed " << seed);
    const test::RandomRobot random = test::random_robot(seed, options);
    const StandardAssembly<Digits50> assembly = test::in<Digits50>(random.assembly);
    const DynamicTree tree(random.assembly);
    const Inputs inputs = test::make_inputs(tree, random.inputs);
    test::Random draw(seed);
    const test::RandomState state = test::random_state(tree, inputs.columns(), draw);
    const Literal<Digits50> robot(assembly, random.inputs, state.q, state.qd);
    const Matrix u(state.u);
    const Matrix none(u.rows());

    const auto [Bhat, qdd0] = direct_solution(robot);  // (9), (11)–(13), (2)
    const Recursion<Digits50> pass = robot.recursion(none);
    CHECK(apart(pass.qdd, qdd0) < tolerance);                           // (14)–(19)
    CHECK(apart(robot.recursion(u).qdd, qdd0 + Bhat * u) < tolerance);  // (2)

    const Matrix Gamma = robot.Gamma(pass);
    const Matrix Gamma_inv = robot.Gamma_inv(pass);
    const Matrix one = Matrix::identity(robot.n());
    CHECK(apart(Gamma * Gamma_inv, one) < tolerance);                                   // (48)
    CHECK(apart(robot.Gamma_inv_cascade(Gamma), Gamma_inv) < tolerance);                // (33)–(35)
    CHECK(apart(robot.T_star(pass) * robot.diag_F(), robot.F_star(pass)) < tolerance);  // (25), (31)
    CHECK(apart(robot.Bhat(pass), Bhat) < tolerance);                                   // (50)
    CHECK(apart(robot.algorithm_1(pass), Bhat) < tolerance);
    // Not printed in the paper: M⁻¹ = Γ⁻¹ diag(M̄_R⁻¹) Γ⁻ᵀ, and Γ⁻¹ = diag(Fᵀ) F*.
    CHECK(apart(robot.M() * Gamma_inv * robot.diag_MbarR_inv(pass) * Gamma_inv.transpose(), one) < tolerance);
    CHECK(apart(robot.diag_F().transpose() * robot.F_star(pass), Gamma_inv) < tolerance);
    for (std::size_t i = 0; i < robot.parts().size(); ++i) {
      if (robot.parts()[i].parent < 0) { continue; }
      const Matrix star = pass.T_star[i].transpose() * pass.M_star[i] * pass.T_star[i];
      const Matrix printed = pass.T_star[i].transpose() * pass.M_star[i] * robot.parts()[i].T_ip;  // (14)
      // A floating base hands nothing on: both sides are roundings of zero beside M̄*.
      CHECK((star - printed).norm() < tolerance * pass.M_star[i].norm());
    }
  }
}
