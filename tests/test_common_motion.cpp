// PROGRAM: tests_implicit
// A free base that is far lighter than two limbs, both of which let it move in one way (two balls: about the line
// through their centres): in square-root form q̈ and B̂ have their digits there, since of what the limbs pass on nothing
// acts along that motion but the loads on their joints.
#include "catch.hpp"
#include "random_tree.hpp"
#include "worst.hpp"

#include <iim/iim.hpp>
#include <iim/subsystem/joint_more.hpp>

#include <cstdint>
#include <limits>
#include <string>
#include <utility>

namespace test_common_motion {

using namespace iim;

namespace {

using Parts = Assembly<RevoluteLink<double>, FloatingBase<double>, SphericalLink<double>, PlanarLink<double>,
                       CylindricalLink<double>, HelicalLink<double>, UniversalLink<double>>;

enum class First { ball, plane, along, cross };

/// One of the 24 that turn coordinate axes onto each other: exact in every Scalar.
Matrix3<double> exact_rotation(test::Random& random)
{
  Matrix3<double> R = Matrix3<double>::Zero();
  const int first = random.below(3), step = 1 + random.below(2);
  for (int k = 0; k < 3; ++k) { R(k, (first + step * k) % 3) = random.chance(0.5) ? 1 : -1; }
  R.col(0) *= R.determinant();
  return R;
}

/// Two limbs of four joints on a base `lightness` times as heavy as a link; `along` is a cylindrical joint and
/// `cross` a universal one whose (first) axis is the normal of a plane, or goes through a ball, or is that of the
/// other.
Parts robot(First one, First other, double lightness, test::Random& random)
{
  Parts assembly;
  Attachment<double> on;
  on.R = random.rotation();
  on.p = random.vector(0.5);
  Body<double> base = random.body();
  base.mass *= lightness;
  base.inertia *= lightness;
  assembly.add("base", on, FloatingBase<double>{base});
  const Matrix3<double> R = exact_rotation(random);
  const Vector3<double> p = random.vector(0.5), axis = R.col(2);
  int limb = 0;
  for (const First first : {one, other}) {
    const bool apart = one == other && limb > 0 && one != First::cross;  // two planes meet, two balls lie apart
    on = Attachment<double>{};
    on.parent = "base";
    on.R = R;
    if (apart) { on.R << R.col(1), R.col(2), R.col(0); }
    // (A universal joint with a ball, or another one, at its own centre would let the base turn about its second axis.)
    const bool crossed = one == First::cross;
    on.p = apart ? random.vector(0.5)
                 : Vector3<double>(
                       p + axis * random.uniform(!crossed || limb > 0 ? -0.5 : 0.1, crossed && limb > 0 ? -0.1 : 0.5));
    const std::string name = std::to_string(limb);
    if (first == First::ball) {
      assembly.add(name, on, SphericalLink<double>{{}, random.body()});
    } else if (first == First::plane) {
      assembly.add(name, on, PlanarLink<double>{{}, random.body()});
    } else if (first == First::along) {
      assembly.add(name, on, CylindricalLink<double>{{}, random.body()});
    } else {
      const Vector3<double> second(0.6, 0.0, 0.8);  // not perpendicular
      assembly.add(name, on, UniversalLink<double>{{Vector3<double>::UnitZ(), second}, random.body()});
    }
    on = Attachment<double>{};
    on.parent = name;
    for (int k = 1; k < 4; ++k) {
      on.R = random.rotation();
      on.p = random.vector(0.5);
      const std::string link = name + std::to_string(k);
      assembly.add(link, on, RevoluteLink<double>{{random.unit()}, random.body()});
      on.parent = link;
    }
    ++limb;
  }
  return assembly;
}

template <class Tree>
void make_balls_unit(const Tree& tree, VectorX<double>& q, test::Random& random)
{
  for (const char* name : {"0", "1"}) {
    const Index i = tree.index(name), first = tree.node(i).q;
    if (tree.node(i + 1).q - first != 4) { continue; }
    for (int k = 0; k < 4; ++k) { q(first + k) = random.uniform(-1, 1); }
    q.template segment<4>(first).normalize();
  }
}

/// Of q̈₀, of q̈ under loads on all joints, of B̂, and of the columns of the first limb's end.
struct Errors {
  double rest = 0, loaded = 0, all = 0, last = 0;
};

template <class Scalar>
Errors worst(First one, First other, double lightness)
{
  Errors errors;
  const auto error = [](const auto& a, const auto& right) {
    return static_cast<double>((a.template cast<long double>() - right).norm() / right.norm()) /
           static_cast<double>(std::numeric_limits<Scalar>::epsilon());
  };
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    test::Random random(seed);
    // Exact in the Scalar and in long double.
    const auto assembly = robot(one, other, lightness, random).template cast<Scalar>().template cast<double>();
    const DynamicTree tree(assembly.template cast<Scalar>());
    const DynamicTree exact_tree(assembly.template cast<long double>());
    const Inputs inputs(tree);
    const Inputs exact_inputs(exact_tree);
    Inputs few(tree, Start::empty);
    Inputs exact_few(exact_tree, Start::empty);
    few.add_motor("03");
    exact_few.add_motor("03");
    Workspace<std::remove_const_t<decltype(tree)>, Update::square_root> ws(tree);
    Workspace<std::remove_const_t<decltype(exact_tree)>, Update::square_root> exact_ws(exact_tree);
    ImplicitInversion method(tree, inputs), by_sweep(tree, few);
    ImplicitInversion exact(exact_tree, exact_inputs), exact_by_sweep(exact_tree, exact_few);
    for (int k = 0; k < 4; ++k) {
      test::RandomState state = test::random_state(DynamicTree(assembly), 0, random);
      make_balls_unit(tree, state.q, random);
      const VectorX<Scalar> q = state.q.template cast<Scalar>(), qd = state.qd.template cast<Scalar>();
      const VectorX<long double> Q = q.template cast<long double>(), V = qd.template cast<long double>();
      const auto result = method(q, qd, ws);
      const auto right = exact(Q, V, exact_ws);
      REQUIRE(result.ok());
      REQUIRE(right.ok());
      test::keep_worst(errors.rest, error(result.qdd0, right.qdd0));
      test::keep_worst(errors.all, error(result.Bhat, right.Bhat));
      test::keep_worst(errors.last, error(by_sweep(result.fd).Bhat.col(0), exact_by_sweep(right.fd).Bhat.col(0)));
      VectorX<Scalar> u(inputs.columns());
      for (Index j = 0; j < u.size(); ++j) { u(j) = Scalar(random.uniform(-3, 3)); }
      const VectorX<long double> U = u.template cast<long double>();
      const auto qdd = forward_dynamics(q, qd, inputs, u, ws).qdd;
      test::keep_worst(errors.loaded, error(qdd, forward_dynamics(Q, V, exact_inputs, U, exact_ws).qdd));
    }
  }
  return errors;
}

// Without: q̈₀ and a motor's column 10⁵ to 10⁸ times as large for a base of 10⁻⁶.
void check(const Errors& errors)
{
  CAPTURE(errors.rest, errors.loaded, errors.all, errors.last);
  CHECK(errors.rest < 64);
  CHECK(errors.all < 64);
  CHECK(errors.last < 512);
  CHECK(errors.loaded < 2048);  // loads on the two joints may nearly cancel
}

}  // namespace

TEST_CASE("a light base between two limbs that it moves along in one way")
{
  for (const auto& [one, other] : {std::pair(First::ball, First::ball), std::pair(First::plane, First::plane),
                                   std::pair(First::ball, First::plane), std::pair(First::along, First::ball),
                                   std::pair(First::along, First::plane), std::pair(First::cross, First::cross),
                                   std::pair(First::cross, First::ball), std::pair(First::cross, First::plane)}) {
    CAPTURE(static_cast<int>(one), static_cast<int>(other));
    for (const double lightness : {1e-2, 1e-6, 1e-9}) {
      CAPTURE(lightness);
      check(worst<double>(one, other, lightness));
    }
    CAPTURE(sizeof(float));
    check(worst<float>(one, other, 1e-6));
  }
}

TEST_CASE("a screw on a free base, which has no line, beside a ball")
{
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    test::Random random(seed);
    Parts parts;
    parts.add("base", {}, FloatingBase<double>{random.body()});
    for (const char* name : {"0", "1"}) {
      Attachment<double> on{"base", random.rotation(), random.vector(0.5)};
      if (name[0] == '0') {
        Body<double> heavy = random.body();
        heavy.mass *= 10;
        heavy.inertia *= 10;
        parts.add(name, on, HelicalLink<double>{{random.unit(), 0.1}, heavy});
      } else {
        parts.add(name, on, SphericalLink<double>{{}, random.body()});
      }
      on = {name, random.rotation(), random.vector(0.5)};
      parts.add(name + std::string("on"), on, RevoluteLink<double>{{random.unit()}, random.body()});
    }
    const DynamicTree tree(parts);
    const Inputs inputs(tree);
    Workspace<std::remove_const_t<decltype(tree)>, Update::square_root> ws(tree);
    Workspace<std::remove_const_t<decltype(tree)>> other_ws(tree);
    ImplicitInversion method(tree, inputs), other(tree, inputs);
    test::RandomState state = test::random_state(tree, 0, random);
    make_balls_unit(tree, state.q, random);
    const auto one = method(state.q, state.qd, ws);
    const auto two = other(state.q, state.qd, other_ws);
    REQUIRE(one.ok());
    REQUIRE(two.ok());
    CHECK((one.qdd0 - two.qdd0).norm() < 1e-11 * two.qdd0.norm());
    CHECK((one.Bhat - two.Bhat).norm() < 1e-11 * two.Bhat.norm());
  }
}

TEST_CASE("loads on the joints between a light base and its limbs move the base")
{
  for (const First first : {First::ball, First::plane, First::cross}) {
    CAPTURE(static_cast<int>(first));
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      test::Random random(seed);
      const DynamicTree tree(robot(first, first, 1e-6, random));
      const Inputs inputs(tree);
      Workspace<std::remove_const_t<decltype(tree)>, Update::square_root> ws(tree);
      ImplicitInversion method(tree, inputs);
      test::RandomState state = test::random_state(tree, inputs.columns(), random);
      make_balls_unit(tree, state.q, random);
      const VectorX<double> loaded = forward_dynamics(state.q, state.qd, inputs, state.u, ws).qdd;
      const auto result = method(state.q, state.qd, ws);
      REQUIRE(result.ok());
      const VectorX<double> expected = result.qdd0 + result.Bhat * state.u;
      CHECK((loaded - expected).norm() < 1e-11 * expected.norm());
    }
  }
}

}  // namespace test_common_motion
