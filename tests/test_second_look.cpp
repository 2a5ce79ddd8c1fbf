// PROGRAM: tests_extreme
// Loads that leave pivots few digits: what comes back ok is right, in float and in double, and what can be computed
// comes back.
#include "catch.hpp"
#include "random_tree.hpp"
#include "worst.hpp"

#include <iim/iim.hpp>
#include <iim/subsystem/sprung.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <type_traits>

using namespace iim;

namespace {

using Parts = Assembly<RevoluteLink<double>, FloatingBase<double>>;

/// Six links with joints at random, the last `load` times as heavy as the others, on the world or on a free body.
Parts loaded_arm(double load, bool floats, double base, test::Random& random)
{
  Parts parts;
  std::string parent = "world";
  if (floats) {
    FloatingBase<double> free{random.body()};
    free.body.mass *= base;
    free.body.inertia *= base;
    parts.add(parent = "base", {}, free);
  }
  for (int i = 0; i < 6; ++i) {
    RevoluteLink<double> link{{random.axis()}, random.body()};
    if (i == 5) {
      link.body.mass *= load;
      link.body.inertia *= load;
    }
    const std::string name = "link" + std::to_string(i);
    parts.add(name, {parent, random.rotation(), random.vector(0.4)}, link);
    parent = name;
  }
  return parts;
}

/// Seven rods of 1 kg and 0.4 m, axes in turn, the last `load` times as heavy.
Parts loaded_rods(double load)
{
  Parts parts;
  for (int i = 0; i < 7; ++i) {
    RevoluteLink<double> link{{test::Vec3::Unit(i % 3)}, {}};
    link.body.mass = i == 6 ? load : 1;
    link.body.com = test::Vec3(0, 0, -0.2);
    link.body.inertia = 0.016 * link.body.mass * test::Vec3(1, 1, 0.1).asDiagonal();
    Attachment<double> on;
    if (i > 0) { on = {"link" + std::to_string(i - 1), test::Mat3::Identity(), {0.05, 0, -0.4}}; }
    parts.add("link" + std::to_string(i), on, link);
  }
  return parts;
}

/// A hand of 1 g and 1 cm, which unit loads turn by 10⁴ times as much as any other joint.
void add_hand(Parts& parts, const std::string& parent)
{
  RevoluteLink<double> hand{{test::Vec3::UnitX()}, {}};
  hand.body.mass = 1e-3;
  hand.body.com = test::Vec3(0, 0, -0.01);
  hand.body.inertia = 1e-7 * test::Mat3::Identity();
  parts.add("hand", {parent, test::Mat3::Identity(), {0.1, 0, 0}}, hand);
}

struct Count {
  int ok = 0;
  double worst = 0;       ///< of B̂, relative, and of q̈₀ where it is more than roundings of forces
  double worst_row = 0;   ///< of B̂
  int held = 0;           ///< come back under motors that hold the robot still
  double worst_held = 0;  ///< of that, to 16 times what roundings of u do to q̈
};

/// Of `states` states that many come back, and their errors. What q, q̇ and the robot are in Scalar is exact.
template <class Scalar, Update update>
Count count(const Parts& parts, int states, test::Random& random)
{
  using Exact = long double;
  const DynamicTree tree(parts.cast<Scalar>());
  const DynamicTree exact_tree(parts.cast<Scalar>().template cast<Exact>());
  const DynamicTree for_states(parts);
  using Tree = std::remove_const_t<decltype(tree)>;
  using ExactTree = std::remove_const_t<decltype(exact_tree)>;
  const std::string& last = tree.name(tree.size() - 1);
  Inputs inputs(tree);
  Inputs exact_inputs(exact_tree);
  inputs.add_wrench(last);
  exact_inputs.add_wrench(last);
  Workspace<Tree, update> ws(tree);
  Workspace<ExactTree, Update::square_root> exact_ws(exact_tree);
  ImplicitInversion method(tree, inputs);
  ImplicitInversion exact_method(exact_tree, exact_inputs);
  Count all;
  for (int k = 0; k < states; ++k) {
    const test::RandomState state = test::random_state(for_states, 0, random);
    const VectorX<Scalar> q = state.q.cast<Scalar>(), qd = state.qd.cast<Scalar>();
    const auto fd = forward_dynamics(q, qd, ws);
    const auto result = method(fd);
    if (!result.ok()) {
      CHECK(result.status == Status::not_positive_definite);
      continue;
    }
    const auto exact =
        exact_method(forward_dynamics(q.template cast<Exact>().eval(), qd.template cast<Exact>().eval(), exact_ws));
    REQUIRE(exact.ok());
    const auto error = [](const auto& x, const auto& right) {
      const auto relative = static_cast<double>((x.template cast<Exact>() - right).norm() / right.norm());
      REQUIRE(std::isfinite(relative));
      return relative;
    };
    // What is wrong of q̈ counts if it is more than 16 roundings of the forces on the joints make.
    const auto acceleration_error = [&](const auto& x, const auto& right) {
      if (inputs.columns() != tree.n_v() + 6) { return error(x, right); }
      const MatrixX<Exact> motors = exact.Bhat.leftCols(tree.n_v());
      const VectorX<Exact> forces = motors.fullPivLu().solve(exact.qdd0);
      const VectorX<Exact> by_roundings = motors.cwiseAbs() * forces.cwiseAbs();
      const auto wrong = static_cast<double>((x.template cast<Exact>() - right).norm() / by_roundings.norm());
      return wrong < 16 * Eigen::NumTraits<Scalar>::epsilon() ? 0.0 : error(x, right);
    };
    ++all.ok;
    all.worst = std::max({all.worst, error(result.Bhat, exact.Bhat), acceleration_error(result.qdd0, exact.qdd0)});
    for (Index v = 0; v < tree.n_v(); ++v) {
      all.worst_row = std::max(all.worst_row, error(result.Bhat.row(v), exact.Bhat.row(v)));
    }
    // Under inputs, a wrench on the last part among them, with the same digits.
    const VectorX<Scalar> u = VectorX<Scalar>::LinSpaced(inputs.columns(), Scalar(-1), Scalar(1));
    const auto moved = forward_dynamics(q, qd, inputs, u, ws);
    if (moved.status == Status::ok) {
      const VectorX<Exact> right = exact.qdd0 + exact.Bhat * u.template cast<Exact>();
      all.worst = std::max(all.worst, acceleration_error(moved.qdd, right));
    }
    if (inputs.columns() != tree.n_v() + 6) { continue; }
    // As far as its Scalar lets them, motors hold it still: q̈ is of roundings alone.
    VectorX<Scalar> holding = u;
    const MatrixX<Exact> motors = exact.Bhat.leftCols(tree.n_v());
    const VectorX<Exact> to_hold = exact.qdd0 + exact.Bhat.rightCols(6) * u.tail(6).template cast<Exact>();
    holding.head(tree.n_v()) = -motors.fullPivLu().solve(to_hold).template cast<Scalar>();
    const auto held = forward_dynamics(q, qd, inputs, holding, ws);
    if (held.status != Status::ok) { continue; }
    ++all.held;
    const VectorX<Exact> left =
        held.qdd.template cast<Exact>() - exact.qdd0 - exact.Bhat * holding.template cast<Exact>();
    const Exact by_roundings = (exact.Bhat.cwiseAbs() * holding.template cast<Exact>().cwiseAbs()).norm();
    test::keep_worst(all.worst_held,
                     static_cast<double>(left.norm() / by_roundings) / (16 * Eigen::NumTraits<Scalar>::epsilon()));
  }
  return all;
}

}  // namespace

TEST_CASE("float: results that small pivots went into are right, or refused")
{
  test::Random random(1);
  const auto check = [&](const Parts& parts, int least) {
    const Count projected = count<float, Update::projected>(parts, 200, random);
    CHECK(projected.worst < 0.01);
    CHECK(projected.ok >= least);
    CHECK(4 * projected.held >= 3 * projected.ok);  // 1 of 15 where q̈ alone was compared with; measured 96 % and more
    CHECK(projected.worst_held < 1);
    CHECK(count<float, Update::printed>(parts, 200, random).worst < 0.01);
  };
  // With pivots as A leaves them and no second look 169, 70 and 1 come back, the worst 3.6 % off.
  check(loaded_rods(1e4), 195);
  check(loaded_rods(1e5), 190);
  check(loaded_rods(1e6), 160);
}

TEST_CASE("float: a light hand hides nothing that is wrong of the arm beside it, or that it is on")
{
  test::Random random(1);
  for (const std::string parent : {"world", "link3", "link6"}) {
    CAPTURE(parent);
    Parts parts = loaded_rods(1e6);
    add_hand(parts, parent);
    const Count projected = count<float, Update::projected>(parts, 200, random);
    CHECK(projected.ok >= 40);
    CHECK(projected.worst_row < 0.05);  // looked at as one, 58 to 87 % come back, rows of them 60 to 75 % off
  }
}

TEST_CASE("float: free bodies with a loaded limb")
{
  for (const double base : {1.0, 1e-3, 1e-6}) {
    CAPTURE(base);
    int ok = 0;
    for (std::uint64_t seed = 1; seed <= 6; ++seed) {
      test::Random random(seed);
      const Count projected = count<float, Update::projected>(loaded_arm(1e5, true, base, random), 50, random);
      CHECK(projected.worst < 0.01);
      ok += projected.ok;
    }
    CHECK(ok >= 130);  // without a second look 31, 12 and 12 of 300
  }
}

TEST_CASE("double: the same under loads as heavy for it")
{
  test::Random random(1);
  const Count projected = count<double, Update::projected>(loaded_rods(1e14), 200, random);
  CHECK(projected.worst < 1e-10);
  CHECK(projected.ok >= 180);
}

TEST_CASE("nothing of a pass is left in the next one: inputs, weak pivots, the length of a step")
{
  const auto check = []<class Scalar>(Scalar, double load) {
    const DynamicTree tree(loaded_rods(load).cast<Scalar>());
    const DynamicTree for_states(loaded_rods(load));
    using Tree = std::remove_const_t<decltype(tree)>;
    Inputs<Tree> twice(tree, Start::empty), once(tree, Start::empty);
    for (const char* frame : {"link6", "link3", "link6"}) { twice.add_wrench(frame); }
    for (const char* frame : {"link6", "link3"}) { once.add_wrench(frame); }
    Workspace<Tree> used(tree);
    test::Random random(5);
    for (int k = 0; k < 200; ++k) {
      CAPTURE(load, k);
      const test::RandomState state = test::random_state(for_states, 0, random);
      const VectorX<Scalar> q = state.q.cast<Scalar>(), qd = state.qd.cast<Scalar>();
      VectorX<Scalar> u = VectorX<Scalar>::LinSpaced(18, Scalar(-1), Scalar(1)) * Scalar(10 * load), sum = u.head(12);
      sum.head(6) += u.tail(6);
      const auto same = [&](auto&& pass) {
        Workspace<Tree> fresh(tree);
        const auto again = pass(used);
        const VectorX<Scalar> qdd = again.second;
        const auto expected = pass(fresh);
        CHECK(again.first == expected.first);
        if (expected.first == Status::ok) { CHECK(qdd == expected.second); }
      };
      using Result = std::pair<Status, VectorX<Scalar>>;
      same([&](auto& ws) -> Result {
        const auto result = forward_dynamics(q, qd, twice, u, ws);
        return {result.status, result.qdd};
      });
      same([&](auto& ws) -> Result {
        const auto fd = forward_dynamics(q, qd, ws);
        return {fd.status(), fd.qdd0()};
      });
      // Two wrenches at one point are their sum.
      Workspace<Tree> ws(tree), other(tree);
      const auto of_two = forward_dynamics(q, qd, twice, u, ws);
      const auto of_sum = forward_dynamics(q, qd, once, sum, other);
      if (of_two.ok() && of_sum.ok()) { CHECK((of_two.qdd - of_sum.qdd).norm() <= Scalar(0.02) * of_sum.qdd.norm()); }
    }
  };
  for (const double load : {20.0, 40.0, 100.0}) { check(1.0, load); }
  check(1.0F, 1e5);
}

TEST_CASE("the springs of a step are no inertias in the pass after it")
{
  using Link = Sprung<RevoluteLink<double>>;
  for (const double load : {20.0, 100.0, 1e4}) {
    Assembly<Link> parts;
    for (int i = 0; i < 7; ++i) {
      Link link;
      link.joint.axis = test::Vec3::Unit(i % 3);
      link.body.mass = i == 6 ? load : 1;
      link.body.com = test::Vec3(0, 0, -0.2);
      link.body.inertia = 0.016 * link.body.mass * test::Vec3(1, 1, 0.1).asDiagonal();
      link.stiffness(0) = 1e4;
      link.damping(0) = 10;
      Attachment<double> on;
      if (i > 0) { on = {"link" + std::to_string(i - 1), test::Mat3::Identity(), {0.05, 0, -0.4}}; }
      parts.add("link" + std::to_string(i), on, link);
    }
    const DynamicTree tree(parts);
    Workspace used(tree);
    test::Random random(6);
    for (int k = 0; k < 100; ++k) {
      CAPTURE(load, k);
      const test::RandomState state = test::random_state(tree, 0, random);
      CHECK(implicit_step(state.q, state.qd, 0.05, used).ok());
      Workspace fresh(tree);
      CHECK(forward_dynamics(state.q, state.qd, used).qdd0() == forward_dynamics(state.q, state.qd, fresh).qdd0());
    }
  }
}
