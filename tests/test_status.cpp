// PROGRAM: tests_methods
// In the cycle nothing throws: what cannot be computed comes back as a status with the subsystem, results are NaN, and
// the next good state computes as if nothing had been.
#include "catch.hpp"
#include "random_tree.hpp"

#include <limits>
#include <string>
#include <utility>

namespace test_status {

using namespace iim;
using test::Vec3;

namespace {

using Tree = decltype(DynamicTree(std::declval<StandardAssembly<double>>()));
constexpr double NaN = std::numeric_limits<double>::quiet_NaN();
constexpr double Inf = std::numeric_limits<double>::infinity();

/// Workspace and method on one tree.
template <Update update>
struct Cycle {
  const Tree& tree;
  const Inputs<Tree>& inputs;
  Workspace<Tree, update> ws{tree};
  ImplicitInversion<Tree> method{tree, inputs};

  AffineDynamics<double> operator()(const Eigen::VectorXd& q, const Eigen::VectorXd& qd)
  {
    return method(forward_dynamics(q, qd, ws));
  }

  /// The status, and that nothing in the result looks like a number.
  void check_fails(const Eigen::VectorXd& q, const Eigen::VectorXd& qd, Status status, Index subsystem)
  {
    const auto fd = forward_dynamics(q, qd, ws);
    CHECK(fd.status() == status);
    CHECK(fd.subsystem() == subsystem);
    CHECK_FALSE(fd.ok());
    const auto result = method(fd);
    CHECK(result.status == status);
    CHECK(result.subsystem == subsystem);
    CHECK(result.qdd0.size() == tree.n_v());
    CHECK(result.Bhat.cols() == inputs.columns());
    CHECK(result.qdd0.array().isNaN().all());
    CHECK(result.Bhat.array().isNaN().all());
  }
};

template <Update update>
void check_every_subsystem(std::uint64_t seed)
{
  test::RandomOptions options;
  options.fewest = 4;
  const test::RandomRobot random = test::random_robot(seed, options);
  const Tree tree(random.assembly);
  const Inputs inputs(tree);
  test::Random draw(seed);
  const test::RandomState state = test::random_state(tree, inputs.columns(), draw);
  Cycle<update> cycle{tree, inputs};
  const auto fresh = cycle(state.q, state.qd);
  REQUIRE(fresh.ok());
  const Eigen::MatrixXd Bhat = fresh.Bhat;
  const Eigen::VectorXd qdd0 = fresh.qdd0;

  tree.outward([&]<class N, class S>(const N& node, const S&) {
    INFO("subsystem " << node.index);
    for (const double bad : {NaN, Inf, -Inf}) {
      for (Index d = 0; d < S::n_q; ++d) {
        Eigen::VectorXd q = state.q;
        q(node.q + d) = bad;
        cycle.check_fails(q, state.qd, Status::invalid_state, node.index);
      }
      for (Index d = 0; d < S::n_i; ++d) {
        Eigen::VectorXd qd = state.qd;
        qd(node.v + d) = bad;
        cycle.check_fails(state.q, qd, Status::invalid_state, node.index);
      }
    }
    if constexpr (detail::is_free<S>()) {
      for (const double length : {0.0, 0.9, 1.1, 1e200}) {
        Eigen::VectorXd q = state.q;
        q.template segment<4>(node.q + 3) *= length;
        cycle.check_fails(q, state.qd, Status::invalid_state, node.index);
      }
    }
    if constexpr (S::n_u > 0) {
      Eigen::VectorXd u = state.u;
      u(node.u) = NaN;
      const auto acceleration = forward_dynamics(state.q, state.qd, inputs, u, cycle.ws);
      CHECK(acceleration.status == Status::invalid_state);
      CHECK(acceleration.subsystem == node.index);
    }
    // Not a bit remains of what went wrong.
    const auto again = cycle(state.q, state.qd);
    REQUIRE(again.ok());
    CHECK(again.subsystem == -1);
    CHECK(again.Bhat == Bhat);
    CHECK(again.qdd0 == qdd0);
  });
}

/// base – arm – hand, the hand without mass.
Tree massless_hand(bool rotor)
{
  test::Random draw(1);
  StandardAssembly<double> assembly;
  assembly.add("base", {}, FloatingBase<double>{draw.body()});
  assembly.add("arm", {.parent = "base"}, RevoluteLink<double>{{Vec3::UnitY()}, draw.body()});
  MotorArm<double> hand{{Vec3::UnitX()}, Body<double>::massless(), {}};
  if (rotor) { hand.motor = {.gear_ratio = 10.0, .axial_inertia = 1e-4, .axis = Vec3::UnitX()}; }
  assembly.add("hand", {.parent = "arm"}, hand);
  return Tree(assembly);
}

template <Update update>
void check_massless()
{
  const Tree tree = massless_hand(false);
  const Inputs inputs(tree);
  test::Random draw(2);
  const test::RandomState state = test::random_state(tree, inputs.columns(), draw);
  Cycle<update> cycle{tree, inputs};
  cycle.check_fails(state.q, state.qd, Status::not_positive_definite, tree.index("hand"));
  const auto acceleration = forward_dynamics(state.q, state.qd, inputs, state.u, cycle.ws);
  CHECK(acceleration.status == Status::not_positive_definite);
  CHECK(acceleration.subsystem == tree.index("hand"));

  // The rotor alone is inertia enough.
  const Tree driven = massless_hand(true);
  const Inputs motors(driven);
  Cycle<update> good{driven, motors};
  CHECK(good(state.q, state.qd).ok());
}

}  // namespace

TEST_CASE("a state that is not finite, at each subsystem", "[status]")
{
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    INFO("seed " << seed);
    check_every_subsystem<Update::projected>(seed);
  }
  check_every_subsystem<Update::printed>(13);
  check_every_subsystem<Update::square_root>(14);
}

TEST_CASE("a distal link without mass", "[status]")
{
  check_massless<Update::printed>();
  check_massless<Update::projected>();
  check_massless<Update::square_root>();
}

TEST_CASE("an inertia that rounding eats is reported, not divided by", "[status]")
{
  // A point mass on the joint's axis: M̄_R is zero but for rounding.
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    INFO("seed " << seed);
    test::Random draw(seed);
    StandardAssembly<double> assembly;
    RevoluteLink<double> upper{{draw.unit()}, draw.body()}, point{{draw.unit()}, {}};
    point.body.mass = 1;
    point.body.com = draw.uniform(-1, 1) * point.joint.axis;
    assembly.add("upper", {}, upper)
        .add("point", {.parent = "upper", .R = draw.rotation(), .p = draw.vector(1)}, point);
    const Tree tree(assembly);
    const Inputs inputs(tree);
    const test::RandomState state = test::random_state(tree, 0, draw);
    Cycle<Update::projected> projected{tree, inputs};
    projected.check_fails(state.q, state.qd, Status::not_positive_definite, 1);
    Cycle<Update::square_root> root{tree, inputs};
    root.check_fails(state.q, state.qd, Status::not_positive_definite, 1);
  }
}

TEST_CASE("overflow is reported, not passed on", "[status]")
{
  test::Random draw(5);
  StandardAssembly<double> assembly;
  assembly.add("upper", {}, RevoluteLink<double>{{Vec3::UnitY()}, draw.body()});
  assembly.add("lower", {.parent = "upper", .p = Vec3(0, 0, 1)}, RevoluteLink<double>{{Vec3::UnitX()}, draw.body()});
  const Tree tree(assembly);
  const Inputs inputs(tree);
  Cycle<Update::projected> cycle{tree, inputs};
  const Eigen::Vector2d q(0.3, 0.4);
  const auto good = cycle(q, Eigen::Vector2d(1, 2));
  REQUIRE(good.ok());
  const Eigen::MatrixXd Bhat = good.Bhat;
  const auto over = cycle(q, Eigen::Vector2d(1e200, -1e200));
  CHECK(over.status == Status::not_finite);
  CHECK(over.subsystem == -1);
  CHECK(over.qdd0.array().isNaN().all());
  CHECK(over.Bhat.array().isNaN().all());
  CHECK(cycle(q, Eigen::Vector2d(1, 2)).Bhat == Bhat);
}

TEST_CASE("q̈ near overflow under a load that pivots are mended for stays what it is", "[status]")
{
  StandardAssembly<double> assembly;
  std::string parent = "world";
  for (int k = 0; k < 7; ++k) {
    RevoluteLink<double> link{{Vec3::Unit(k % 3)}, {}};
    link.body.mass = k == 6 ? 1e3 : 1;
    link.body.com = {0, 0, -0.5};
    link.body.inertia = Vec3(0.1, 0.1, 0.01).asDiagonal() * link.body.mass;
    const std::string name = "link" + std::to_string(k);
    assembly.add(name, {.parent = parent, .p = Vec3(0, 0, k == 0 ? 0 : -1)}, link);
    parent = name;
  }
  const Tree tree(assembly);
  const Inputs inputs(tree);
  Workspace ws(tree);
  Workspace<Tree, Update::square_root> root(tree);
  test::Random draw(1);
  int computed = 0;
  for (int k = 0; k < 2000; ++k) {
    const Eigen::VectorXd q = test::random_state(tree, 7, draw).q, zero = Eigen::VectorXd::Zero(7);
    Eigen::VectorXd u(7);
    for (double& x : u) { x = 1e307 * draw.uniform(-1.5, 1.5); }
    const auto a = forward_dynamics(q, zero, inputs, u, ws), b = forward_dynamics(q, zero, inputs, u, root);
    CHECK((a.status == Status::ok || a.status == Status::not_finite));
    if (a.status == Status::not_finite) { CHECK(a.subsystem == -1); }
    if (a.status != Status::ok || b.status != Status::ok) { continue; }
    ++computed;
    const double size = b.qdd.lpNorm<Eigen::Infinity>();  // squares would overflow
    CHECK((a.qdd / size - b.qdd / size).norm() < 1e-9 * (b.qdd / size).norm());
  }
  CHECK(computed > 200);
}

TEST_CASE("a workspace that failed is as good as new", "[status]")
{
  for (std::uint64_t seed = 1; seed <= 30; ++seed) {
    INFO("seed " << seed);
    const test::RandomRobot random = test::random_robot(seed);
    const Tree tree(random.assembly);
    const Inputs inputs = test::make_inputs(tree, random.inputs);
    test::Random draw(seed);
    const test::RandomState state = test::random_state(tree, inputs.columns(), draw);
    Cycle<Update::projected> used{tree, inputs}, fresh{tree, inputs};
    if (tree.n_v() > 0) {
      const auto broken = used(Eigen::VectorXd::Constant(tree.n_q(), NaN), Eigen::VectorXd::Constant(tree.n_v(), Inf));
      CHECK(broken.status == Status::invalid_state);
      const test::RandomState other = test::random_state(tree, inputs.columns(), draw);
      CHECK(used(other.q, other.qd).ok());
    }
    const auto a = used(state.q, state.qd);
    const auto b = fresh(state.q, state.qd);
    CHECK(a.qdd0 == b.qdd0);
    CHECK(a.Bhat == b.Bhat);
  }
}

}  // namespace test_status
