// PROGRAM: tests_parallel
// Inertias that no body can have but a file can give (Body::any_moments): a principal moment above the sum of the other
// two.
#include "catch.hpp"
#include "random_tree.hpp"

#include <iim/global_inverse.hpp>
#include <iim/iim.hpp>

#include <array>
#include <utility>

namespace test_any_moments {

using namespace iim;
using test::Vec3;

namespace {

/// A link whose joint has a housing on the inlet.
struct HousedLink : RevoluteLink<double> {
  Body<double> housing;

  std::array<CarriedBody<double>, 2> bodies() const { return {{{0, body}, {-1, housing}}}; }
};

using Parts = Assembly<RevoluteLink<double>, FloatingBase<double>, HousedLink>;
using Tree = decltype(DynamicTree(std::declval<const Parts&>()));

/// A free base and two links; `moments` are those of the base, of the last link and of its housing on the other, turned
/// out of their axes.
Parts robot(const Vec3& moments)
{
  Body<double> sound{2, {0.1, -0.2, 0.05}, Vec3(0.02, 0.03, 0.04).asDiagonal()};
  Body<double> odd = sound;
  const Eigen::Matrix3d R = Eigen::AngleAxisd(0.7, Vec3(1, 2, -2) / 3).toRotationMatrix();
  odd.inertia = R * moments.asDiagonal() * R.transpose();
  odd.inertia = (0.5 * (odd.inertia + odd.inertia.transpose())).eval();
  odd.any_moments = true;
  Parts parts;
  parts.add("base", {}, FloatingBase<double>{odd});
  parts.add("arm", {"base", Eigen::Matrix3d::Identity(), {0.2, 0, 0}}, RevoluteLink<double>{{Vec3::UnitX()}, sound});
  parts.add("hand", {"arm", Eigen::Matrix3d::Identity(), {0, 0.3, 0}}, HousedLink{{{Vec3::UnitZ()}, odd}, odd});
  return parts;
}

template <Update update, Scene scene = Scene{}>
Status check_against_global_inverse(const Tree& tree, const test::RandomState& state)
{
  Inputs<Tree> inputs(tree);
  inputs.add_force("hand", {0.1, 0, 0});
  Workspace<Tree> dense_workspace(tree);
  GlobalInverse<Tree, Factorization::branch_sparse, scene> dense(tree, inputs);
  const auto expected = dense(forward_dynamics<scene>(state.q, state.qd, dense_workspace));
  REQUIRE(expected.ok());
  Workspace<Tree, update> ws(tree);
  ImplicitInversion<Tree> method(tree, inputs);
  const auto result = method(forward_dynamics<scene>(state.q, state.qd, ws));
  if (result.ok()) {
    CHECK((result.qdd0 - expected.qdd0).norm() <= 1e-11 * expected.qdd0.norm());
    CHECK((result.Bhat - expected.Bhat).norm() <= 1e-11 * expected.Bhat.norm());
  }
  return result.status;
}

}  // namespace

TEST_CASE("a moment above the sum of the others: refused unless the body says so, then exact in every form")
{
  Parts refused = robot({0.01, 0.02, 0.2});
  Body<double> body{1, {0, 0, 0}, Vec3(0.01, 0.02, 0.2).asDiagonal()};
  refused.add("lid", {"hand"}, RevoluteLink<double>{{Vec3::UnitX()}, body});
  CHECK_THROWS_WITH(Tree(refused),
                    Catch::Matchers::ContainsSubstring("'lid'") && Catch::Matchers::ContainsSubstring("sum"));

  const Tree tree(robot({0.01, 0.02, 0.2}));
  test::Random random(7);
  for (int k = 0; k < 20; ++k) {
    const test::RandomState state = test::random_state(tree, 0, random);
    CHECK(check_against_global_inverse<Update::projected>(tree, state) == Status::ok);
    CHECK(check_against_global_inverse<Update::printed>(tree, state) == Status::ok);
    CHECK(check_against_global_inverse<Update::square_root>(tree, state) == Status::ok);
  }
}

// In square-root form the body has no row that could hold the moment by which it turns about such an axis.
TEST_CASE("two moments zero and the third not: exact in every form")
{
  const Tree tree(robot({0, 0, 0.2}));
  test::Random random(8);
  for (int k = 0; k < 20; ++k) {
    const test::RandomState state = test::random_state(tree, 0, random);
    CHECK(check_against_global_inverse<Update::projected>(tree, state) == Status::ok);
    CHECK(check_against_global_inverse<Update::square_root>(tree, state) == Status::ok);
    constexpr Scene at_rest{.velocity = false};
    CHECK(check_against_global_inverse<Update::square_root, at_rest>(tree, state) == Status::ok);
  }
}

// A rod's two moments, as a file rounds them: 2e-5 of q̈₀ where the moment that they make is left out.
TEST_CASE("two moments that differ in the sixth digit and the third zero: exact in every form")
{
  const Tree tree(robot({0.2, 0.2 * (1 + 9e-6), 0}));
  test::Random random(10);
  for (int k = 0; k < 20; ++k) {
    test::RandomState state = test::random_state(tree, 0, random);
    state.qd *= 10;
    CHECK(check_against_global_inverse<Update::projected>(tree, state) == Status::ok);
    CHECK(check_against_global_inverse<Update::square_root>(tree, state) == Status::ok);
  }
}

// As files of real robots have them: what a program has computed of a point.
TEST_CASE("moments that are roundings of a point mass")
{
  const Tree tree(robot({1e-18, 0, -1e-21}));
  test::Random random(9);
  for (int k = 0; k < 20; ++k) {
    const test::RandomState state = test::random_state(tree, 0, random);
    CHECK(check_against_global_inverse<Update::projected>(tree, state) == Status::ok);
    CHECK(check_against_global_inverse<Update::square_root>(tree, state) == Status::ok);
  }
}

TEST_CASE("a negative moment is refused all the same")
{
  CHECK_THROWS_WITH(Tree(robot({-0.01, 0.02, 0.2})), Catch::Matchers::ContainsSubstring("negative principal moment"));
}

}  // namespace test_any_moments
