// PROGRAM: tests_methods
// Laws that share no formula with the recursions: energy, momentum, finite differences, permutation, rigid motion.
// REQUIRES: boost
//
// Time derivatives are central differences in 50 digits: with a step of 1e-12 their error is 1e-24 of the third
// derivative, so that the library in double is what is measured.
#include "catch.hpp"

#include "reference/literal.hpp"
#include "reference/multiprecision.hpp"

#include <limits>
#include <utility>

namespace test_law_balance {

using namespace iim;
using namespace iim::reference;
using Matrix = Dense<Digits50>;

namespace {

constexpr double eps = std::numeric_limits<double>::epsilon();

/// Kinetic and potential energy, and momentum about the world's origin (linear; angular), body by body.
struct Mechanics {
  Digits50 energy{0};
  Matrix momentum{6};
  Digits50 mass{0};
  Matrix moment{3};  ///< Σ m c, world axes

  explicit Mechanics(const Literal<Digits50>& robot)
  {
    for (const Part<Digits50>& part : robot.parts()) {
      energy += part.dynamics.kinetic;
      for (const auto& body : part.dynamics.bodies) {
        const Matrix c = part.r0 + part.R0 * body.centre;
        const Matrix p = part.R0 * body.momentum.head(3);
        energy -= body.mass * dot(robot.gravity(), c);
        momentum += stacked(p, part.R0 * body.momentum.tail(3) + tilde(c) * p);
        mass += body.mass;
        moment += body.mass * c;
      }
    }
  }
};

struct Motion {
  StandardAssembly<Digits50> assembly;
  std::vector<test::NamedInput> inputs;
  Matrix q, qd, q_rate, qdd;

  /// The mechanics 1e-12 s later (sign 1) or earlier (−1).
  Mechanics aside(int sign) const
  {
    const Digits50 t = Digits50(sign) * Digits50("1e-12");
    return Mechanics(Literal<Digits50>(assembly, inputs, q + t * q_rate, qd + t * qdd));
  }
};

/// dq/dt from the library's own coordinate_rate.
template <class Tree>
Eigen::VectorXd rate_of(const Tree& tree, const Eigen::VectorXd& q, const Eigen::VectorXd& qd)
{
  Eigen::VectorXd rate(tree.n_q());
  coordinate_rate(tree, q, qd, rate);
  return rate;
}

struct Case {
  test::RandomRobot random;
  DynamicTree<RevoluteLink<double>, MotorArm<double>, FloatingBase<double>, PrismaticLink<double>, FixedLink<double>,
              LinearMotorArm<double>>
      tree;
  Inputs<decltype(tree)> inputs;
  test::RandomState state;

  Case(std::uint64_t seed, const test::RandomOptions& options)
      : random(test::random_robot(seed, options)), tree(random.assembly), inputs(test::make_inputs(tree, random.inputs))
  {
    test::Random draw(seed);
    state = test::random_state(tree, inputs.columns(), draw);
  }

  Motion motion()
  {
    Workspace ws(tree);
    ImplicitInversion method(tree, inputs);
    const auto result = method(forward_dynamics(state.q, state.qd, ws));
    REQUIRE(result.ok());
    const Eigen::VectorXd qdd = result.qdd0 + result.Bhat * state.u;
    return {
        test::in<Digits50>(random.assembly), random.inputs, state.q, state.qd, rate_of(tree, state.q, state.qd), qdd};
  }
};

/// Central difference of two values at ±1e-12 s.
Digits50 derivative(const Digits50& after, const Digits50& before) { return (after - before) / Digits50("2e-12"); }

}  // namespace

TEST_CASE("the power balance: d(T + V)/dt is the power of the inputs", "[law]")
{
  test::RandomOptions options;
  options.floating_inside = 0.1;
  options.most = 10;
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    INFO("seed " << seed);
    Case scene(seed, options);
    const Motion motion = scene.motion();
    const Literal<Digits50> robot(motion.assembly, motion.inputs, motion.q, motion.qd);
    const Digits50 gain = derivative(motion.aside(1).energy, motion.aside(-1).energy);
    const Matrix V = robot.F() * motion.qd;
    const Digits50 power =
        scene.state.u.size() > 0 ? Digits50(dot(robot.Bbar().transpose() * V, Matrix(scene.state.u))) : Digits50(0);
    // Both are sums over M q̈ q̇: the errors of q̈ weighted with M are what separates them.
    const Matrix forces = robot.M() * motion.qdd;
    Digits50 scale = abs(power);
    for (Index k = 0; k < robot.n(); ++k) { scale += abs(forces(k) * motion.qd(k)); }
    const Matrix M = robot.M();
    for (Index k = 0; k < robot.n(); ++k) { scale += abs(M(k, k) * motion.qdd(k) * motion.qd(k)); }
    CHECK(static_cast<double>(abs(gain - power) / (scale > 0 ? scale : Digits50(1))) < 200 * eps);
  }
}

TEST_CASE("the momentum balance of robots without a foundation", "[law]")
{
  test::RandomOptions options;
  options.most = 8;
  options.root = 0;
  options.floating_root = 1;
  options.armature = 0;  // leaves out reaction torques, so that momentum is not conserved
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    INFO("seed " << seed);
    Case scene(seed, options);
    const Motion motion = scene.motion();
    const Literal<Digits50> robot(motion.assembly, motion.inputs, motion.q, motion.qd);
    const Mechanics now(robot);
    const Matrix after = motion.aside(1).momentum, before = motion.aside(-1).momentum;
    // Gravity, and the guidance rows of B̄_i u: the wrench that the inputs are on the whole subsystem.
    Matrix wrench = stacked(now.mass * robot.gravity(), tilde(now.moment) * robot.gravity());
    Digits50 scale = wrench.norm() + now.momentum.norm();
    const Matrix Bu = robot.Bbar() * Matrix(scene.state.u);
    for (const Part<Digits50>& part : robot.parts()) {
      const Matrix f = part.R0 * Bu.rows(part.V, 3), n = part.R0 * Bu.rows(part.V + 3, 3);
      wrench += stacked(f, n + tilde(part.r0) * f);
      scale += f.norm() + n.norm();
    }
    // Momentum changes by M̄ q̈ part by part; errors of q̈ come in with that weight.
    const Matrix M = robot.M();
    for (Index k = 0; k < robot.n(); ++k) { scale += abs(M(k, k) * motion.qdd(k)); }
    const Matrix gain = (Digits50(1) / Digits50("2e-12")) * (after - before);
    CHECK(static_cast<double>((gain - wrench).norm() / scale) < 100 * eps);
  }
}

}  // namespace test_law_balance
