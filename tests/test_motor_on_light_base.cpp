// PROGRAM: tests_implicit
// Motors on a limb that hangs on a far lighter free base by a joint of several velocities: in square-root form their
// columns of B̂, and q̈ under them, have their digits, though along that joint the base moves by roundings of any force.
#include "catch.hpp"
#include "random_tree.hpp"
#include "worst.hpp"

#include <iim/iim.hpp>
#include <iim/subsystem/joint_more.hpp>

#include <cstdint>
#include <limits>
#include <string>

namespace test_motor_on_light_base {

using namespace iim;

namespace {

using Parts = Assembly<RevoluteLink<double>, FloatingBase<double>, SphericalLink<double>, PlanarLink<double>,
                       CylindricalLink<double>, UniversalLink<double>, MotorArm<double>, PrismaticLink<double>>;

enum class First { ball, plane, along, cross };

/// Every other one a rod, which turns about itself without inertia: its rows do not carry all wrenches.
Body<double> link(test::Random& random)
{
  Body<double> body = random.body();
  if (random.chance(0.5)) {
    const Vector3<double> along = random.unit();
    body.inertia = body.mass / 50 * (Matrix3<double>::Identity() - along * along.transpose());
  }
  return body;
}

/// One or two limbs of five joints: the first as said, then a revolute one, a geared one, a slide, and a universal or
/// planar one.
Parts robot(First first, int limbs, double lightness, test::Random& random)
{
  Parts assembly;
  Attachment<double> on;
  Body<double> base = random.body();
  base.mass *= lightness;
  base.inertia *= lightness;
  assembly.add("base", on, FloatingBase<double>{base});
  for (int limb = 0; limb < limbs; ++limb) {
    on.parent = "base";
    on.p = random.vector(0.5);
    if (limb > 0) { on.R << 0, 0, 1, 1, 0, 0, 0, 1, 0; }  // in two parallel planes a base moves in three ways
    const std::string name = std::to_string(limb);
    switch (first) {
      case First::ball: assembly.add(name, on, SphericalLink<double>{{}, link(random)}); break;
      case First::plane: assembly.add(name, on, PlanarLink<double>{{}, link(random)}); break;
      case First::along: assembly.add(name, on, CylindricalLink<double>{{}, link(random)}); break;
      case First::cross: assembly.add(name, on, UniversalLink<double>{{}, link(random)}); break;
    }
    on.parent = name;
    on.R.setIdentity();
    on.p = random.vector(0.5);
    assembly.add(name + "1", on, RevoluteLink<double>{{random.unit()}, link(random)});
    on.parent = name + "1";
    assembly.add(name + "2", on, MotorArm<double>{{random.unit()}, link(random), random.motor()});
    on.parent = name + "2";
    assembly.add(name + "3", on, PrismaticLink<double>{{random.unit()}, link(random)});
    on.parent = name + "3";
    if (random.chance(0.5)) {
      assembly.add(name + "4", on, UniversalLink<double>{{}, link(random)});
    } else {
      assembly.add(name + "4", on, PlanarLink<double>{{}, link(random)});
    }
  }
  return assembly;
}

template <class Tree>
void make_balls_unit(const Tree& tree, VectorX<double>& q, test::Random& random)
{
  tree.outward([&]<class S>(const Node& node, const S&) {
    if constexpr (S::n_q == 4) {
      for (int k = 0; k < 4; ++k) { q(node.q + k) = random.uniform(-1, 1); }
    }
  });
  normalize(tree, q);
}

/// Of single columns by sweep and by product, and of q̈ under these inputs.
struct Errors {
  double sweep = 0, product = 0, loaded = 0;
  int states = 0;
};

template <class Scalar>
Errors worst(First first, int limbs, double lightness)
{
  Errors errors;
  const auto error = [](const auto& a, const auto& right) {
    return static_cast<double>((a.template cast<long double>() - right).norm() / right.norm()) /
           static_cast<double>(std::numeric_limits<Scalar>::epsilon());
  };
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    test::Random random(seed);
    // Exact in the Scalar and in long double.
    const auto assembly = robot(first, limbs, lightness, random).template cast<Scalar>().template cast<double>();
    const DynamicTree tree(assembly.template cast<Scalar>());
    const DynamicTree exact_tree(assembly.template cast<long double>());
    using Tree = std::remove_const_t<decltype(tree)>;
    using ExactTree = std::remove_const_t<decltype(exact_tree)>;
    const Inputs<Tree> all(tree);
    Inputs<Tree> far(tree, Start::empty);
    const Inputs<ExactTree> exact_all(exact_tree);
    Inputs<ExactTree> exact_far(exact_tree, Start::empty);
    for (const char* name : {"01", "02", "03", "04"}) {
      far.add_motor(name);
      exact_far.add_motor(name);
    }
    Workspace<Tree, Update::square_root> ws(tree);
    Workspace<ExactTree, Update::square_root> exact_ws(exact_tree);
    ImplicitInversion<Tree> by_product(tree, all), by_sweep(tree, far);
    ImplicitInversion<ExactTree> exact(exact_tree, exact_far);
    for (int k = 0; k < 3; ++k) {
      test::RandomState state = test::random_state(tree, 0, random);
      VectorX<double> q_d = state.q;
      make_balls_unit(DynamicTree(assembly), q_d, random);
      const VectorX<Scalar> q = q_d.template cast<Scalar>(), qd = state.qd.template cast<Scalar>();
      const VectorX<long double> Q = q.template cast<long double>(), V = qd.template cast<long double>();
      const auto right = exact(Q, V, exact_ws);
      REQUIRE(right.ok());
      const auto sweep = by_sweep(q, qd, ws);
      if (sizeof(Scalar) == sizeof(float) && sweep.status == Status::not_positive_definite) {
        continue;
      }  // up to a third, on a plane
      REQUIRE(sweep.ok());
      ++errors.states;
      const auto product = by_product(sweep.fd);
      REQUIRE(product.ok());
      far.for_each_active([&](const Input<Scalar>& input, Index first_column) {
        const Index in_all = all.column(all.motor(input.name));
        for (Index j = 0; j < input.size; ++j) {
          const VectorX<long double> column = right.Bhat.col(first_column + j);
          test::keep_worst(errors.sweep, error(sweep.Bhat.col(first_column + j), column));
          test::keep_worst(errors.product, error(product.Bhat.col(in_all + j), column));
        }
      });
      const VectorX<Scalar> u = VectorX<Scalar>::Constant(far.columns(), Scalar(100));
      const VectorX<long double> U = u.template cast<long double>();
      const auto qdd = forward_dynamics(q, qd, far, u, ws).qdd;
      test::keep_worst(errors.loaded, error(qdd, forward_dynamics(Q, V, exact_far, U, exact_ws).qdd));
    }
  }
  return errors;
}

// Without: 10⁵, 10⁸ and 10¹¹ for bases of 10⁻³, 10⁻⁶ and 10⁻⁹. (The slides of a plane are drawn out to metres.)
void check(First first, const Errors& errors)
{
  CAPTURE(errors.sweep, errors.product, errors.loaded);
  const double bound = first == First::plane ? 4096 : 512;
  CHECK(errors.sweep < bound);
  CHECK(errors.product < bound);
  CHECK(errors.loaded < 2048);  // loads may nearly cancel
  CHECK(errors.states > 15);
}

}  // namespace

TEST_CASE("motors on a limb of a light base, beyond a joint of several velocities")
{
  for (const First first : {First::ball, First::plane, First::along, First::cross}) {
    for (const int limbs : {1, 2}) {
      CAPTURE(static_cast<int>(first), limbs);
      for (const double lightness : {1.0, 1e-3, 1e-6, 1e-9}) {
        CAPTURE(lightness);
        check(first, worst<double>(first, limbs, lightness));
      }
      CAPTURE(sizeof(float));
      check(first, worst<float>(first, limbs, 1e-2));
    }
  }
}

}  // namespace test_motor_on_light_base
