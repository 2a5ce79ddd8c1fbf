// REQUIRES: boost
// PROGRAM: tests_methods
// T_ip, F_i, M̄_i, h̄_i, B̄_i: put together by (9) and (11)–(13) they are the paper's M, h and B, from the literal
// reference.
#include "catch.hpp"

#include <iim/subsystem_matrices.hpp>

#include "reference/literal.hpp"
#include "reference/multiprecision.hpp"

#include <limits>
#include <vector>

using namespace iim;
using namespace iim::reference;

namespace {

struct Equations {
  Eigen::MatrixXd M, B;
  Eigen::VectorXd h;
};

/// (9), (11)–(13) from the matrices of all subsystems.
template <class Receipt>
Equations assembled(const Receipt& fd, const std::vector<test::NamedInput>& motors)
{
  const auto& tree = fd.tree();
  const Index n = tree.n_v();
  Equations e{Eigen::MatrixXd::Zero(n, n), Eigen::MatrixXd::Zero(n, static_cast<Index>(motors.size())),
              Eigen::VectorXd::Zero(n)};
  std::vector<Eigen::MatrixXd> F;
  std::vector<Eigen::VectorXd> F_dot_qd;
  for (Index i = 0; i < tree.size(); ++i) {
    const SubsystemMatrices<double> m = subsystem_matrices(fd, i);
    const Index n_i = m.F.cols();
    const Index parent = tree.node(i).parent;
    Eigen::MatrixXd F_i = Eigen::MatrixXd::Zero(6 + n_i, n);
    Eigen::VectorXd F_i_dot_qd = m.T_ip_dot_V_p;
    if (parent >= 0) {
      REQUIRE(m.T_ip.cols() == F[static_cast<std::size_t>(parent)].rows());
      F_i = m.T_ip * F[static_cast<std::size_t>(parent)];
      F_i_dot_qd += m.T_ip * F_dot_qd[static_cast<std::size_t>(parent)];
    }
    F_i.middleCols(tree.node(i).v, n_i) += m.F;
    e.M += F_i.transpose() * m.Mbar * F_i;
    e.h += F_i.transpose() * (m.Mbar * F_i_dot_qd + m.hbar);
    for (std::size_t k = 0; k < motors.size(); ++k) {
      if (tree.index(motors[k].name) == i) { e.B.col(static_cast<Index>(k)) = F_i.transpose() * m.Bbar.col(0); }
    }
    F.push_back(F_i);
    F_dot_qd.push_back(F_i_dot_qd);
  }
  return e;
}

}  // namespace

TEST_CASE("the matrices of the subsystems make the paper's M, h and B")
{
  constexpr double epsilon = std::numeric_limits<double>::epsilon();
  test::RandomOptions options;
  options.floating_inside = 0.1;
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    const test::RandomRobot random = test::random_robot(seed, options);
    const DynamicTree tree(random.assembly);
    std::vector<test::NamedInput> motors;
    for (const test::NamedInput& input : random.inputs) {
      if (input.kind == InputKind::motor && input.active) { motors.push_back(input); }
    }
    test::Random draw(seed);
    const test::RandomState state = test::random_state(tree, 0, draw, 3.0);
    Workspace ws(tree);
    const auto fd = forward_dynamics(state.q, state.qd, ws);
    REQUIRE(fd.ok());

    const Equations e = assembled(fd, motors);
    const Literal<Digits50> robot(test::in<Digits50>(random.assembly), motors, state.q, state.qd);
    INFO("seed " << seed);
    CHECK(apart(e.M, robot.M()) < 100 * epsilon);
    CHECK(apart(e.h, robot.h()) < 1000 * epsilon);
    if (!motors.empty()) { CHECK(apart(e.B, robot.B()) < 100 * epsilon); }
  }
}

TEST_CASE("what a scene leaves out is not in the subsystem's bias force")
{
  const test::RandomRobot random = test::random_robot(7);
  const DynamicTree tree(random.assembly);
  test::Random draw(7);
  const test::RandomState state = test::random_state(tree, 0, draw, 3.0);
  const Eigen::VectorXd rest = Eigen::VectorXd::Zero(tree.n_v());
  Workspace moving(tree), resting(tree), light(tree);
  const auto at_rest = forward_dynamics<Scene{.velocity = false}>(state.q, rest, resting);
  const auto also_at_rest = forward_dynamics(state.q, rest, moving);
  const auto weightless = forward_dynamics<Scene{.velocity = false, .gravity = false}>(state.q, rest, light);
  for (Index i = 0; i < tree.size(); ++i) {
    const auto expected = subsystem_matrices(also_at_rest, i);
    CHECK(subsystem_matrices(at_rest, i).hbar.isApprox(expected.hbar, 1e-14));
    CHECK(subsystem_matrices(at_rest, i).Mbar == expected.Mbar);
    CHECK(subsystem_matrices(weightless, i).hbar.isZero(0));
  }
}

TEST_CASE("the square-root form keeps the same subsystems")
{
  const test::RandomRobot random = test::random_robot(11);
  const DynamicTree tree(random.assembly);
  test::Random draw(11);
  const test::RandomState state = test::random_state(tree, 0, draw, 3.0);
  Workspace projected(tree);
  Workspace<decltype(tree), Update::square_root> root(tree);
  const auto a = forward_dynamics(state.q, state.qd, projected);
  const auto b = forward_dynamics(state.q, state.qd, root);
  for (Index i = 0; i < tree.size(); ++i) {
    CHECK(subsystem_matrices(a, i).Mbar == subsystem_matrices(b, i).Mbar);
    CHECK(subsystem_matrices(a, i).hbar.isApprox(subsystem_matrices(b, i).hbar, 1e-14));
    CHECK(subsystem_matrices(a, i).T_ip == subsystem_matrices(b, i).T_ip);
  }
}
