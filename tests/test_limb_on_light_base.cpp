// PROGRAM: tests_parallel
// The square-root form where a free base carries one limb that is much heavier: the base moves almost freely as the
// limb's first joint does, and what inputs beyond that joint do must not drown in it.
#include "catch.hpp"
#include "random_tree.hpp"
#include "worst.hpp"

#include <iim/iim.hpp>
#include <iim/unit_force.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <type_traits>
#include <vector>

namespace test_limb_on_light_base {

using namespace iim;
using iim::test::keep_worst;

namespace {

template <class Scalar>
using Parts = Assembly<RevoluteLink<Scalar>, FloatingBase<Scalar>, PrismaticLink<Scalar>, MotorArm<Scalar>>;
template <class Scalar>
using Tree = decltype(DynamicTree(std::declval<const Parts<Scalar>&>()));

enum class First { revolute, prismatic, geared };

/// A free base `lightness` times as heavy as the links of its limb; on a slide on the world if it lies inside the tree.
Parts<double> light_base(double lightness, First first, bool inside, test::Random& random)
{
  Parts<double> assembly;
  Body<double> body = random.body();
  body.mass *= lightness;
  body.inertia *= lightness;
  if (inside) {
    assembly.add("slide", {"world", random.rotation(), random.vector(0.5)},
                 PrismaticLink<double>{{random.axis()}, random.body()});
  }
  assembly.add("base", {inside ? "slide" : "world", random.rotation(), random.vector(0.5)}, FloatingBase<double>{body});
  for (int k = 0; k < 4; ++k) {
    const std::string name = "link" + std::to_string(k);
    const Attachment<double> on{k == 0 ? "base" : "link" + std::to_string(k - 1), random.rotation(),
                                random.vector(0.5)};
    if (k > 0 || first == First::revolute) {
      assembly.add(name, on, RevoluteLink<double>{{random.axis()}, random.body()});
    }
    if (k == 0 && first == First::prismatic) {
      assembly.add(name, on, PrismaticLink<double>{{random.axis()}, random.body()});
    }
    if (k == 0 && first == First::geared) {
      MotorArm<double> arm{{random.axis()}, random.body(), random.motor(0)};
      arm.motor.axial_inertia *= lightness;  // the base stays light against the limb, its rotor included
      arm.motor.transverse_inertia *= lightness;
      arm.motor.mass *= lightness;
      assembly.add(name, on, arm);
    }
  }
  return assembly;
}

/// Inputs on the first joint as on the others; beyond it; a force on the limb's tip alone.
std::vector<test::NamedInput> inputs(int which)
{
  std::vector<test::NamedInput> named;
  for (int k = which; k < 4 && which < 2; ++k) { named.push_back({InputKind::motor, "link" + std::to_string(k)}); }
  if (which > 0) { named.push_back({InputKind::force, "link3", test::Vec3(0.1, 0.2, 0.3)}); }
  return named;
}

/// In long double `sweep` is q̈ under one input after the other, which the methods for B̂ have no part in.
struct Results {
  MatrixX<long double> product, sweep;
  VectorX<long double> qdd0, qdd;
};

template <class Scalar>
Results results(const Parts<Scalar>& assembly, const std::vector<test::NamedInput>& named, const VectorX<Scalar>& q,
                const VectorX<Scalar>& qd, double effort = 1)
{
  const Tree<Scalar> tree(assembly);
  const Inputs<Tree<Scalar>> in = test::make_inputs(tree, named);
  Workspace<Tree<Scalar>, Update::square_root> ws(tree);
  const VectorX<Scalar> u = VectorX<Scalar>::Constant(in.columns(), static_cast<Scalar>(effort));
  Results out;
  out.qdd = forward_dynamics(q, qd, in, u, ws).qdd.template cast<long double>();
  const auto fd = forward_dynamics(q, qd, ws);
  REQUIRE(fd.ok());
  out.qdd0 = fd.qdd0().template cast<long double>();
  if constexpr (std::is_same_v<Scalar, long double>) {  // q̈ under each input, everything else left out
    constexpr Scene nothing_else{.velocity = false, .gravity = false};
    out.sweep.resize(tree.n_v(), in.columns());
    for (Index j = 0; j < in.columns(); ++j) {
      out.sweep.col(j) =
          forward_dynamics<nothing_else>(q, qd, in, VectorX<Scalar>(VectorX<Scalar>::Unit(in.columns(), j)), ws).qdd;
    }
    return out;
  }
  detail::ResultMemory<Scalar> memory(tree, in);
  auto B = memory.Bhat(in.columns());
  detail::Sweep<Tree<Scalar>, 1>{tree, in}(ws, B);
  out.sweep = B.template cast<long double>();
  detail::ProductForm<Tree<Scalar>>{tree, in}(ws, B);
  out.product = B.template cast<long double>();
  return out;
}

template <class Matrix>
double relative(const Matrix& value, const Matrix& exact)
{
  return static_cast<double>((value - exact).norm() / exact.norm());
}

/// Largest errors, in ε of Scalar, against long double: B̂ as a product and by sweeps, q̈₀, q̈.
template <class Scalar>
void check(const char* name, double lightness, First first, bool inside)
{
  const double epsilon = static_cast<double>(std::numeric_limits<Scalar>::epsilon());
  for (int which = 0; which < 3; ++which) {
    std::array<double, 4> worst{};
    for (std::uint64_t seed = 1; seed <= 10; ++seed) {
      test::Random random(seed);
      const auto rounded = light_base(lightness, first, inside, random).template cast<Scalar>();
      const test::RandomState state = test::random_state(Tree<Scalar>(rounded), 0, random);
      const VectorX<Scalar> q = state.q.template cast<Scalar>(), qd = state.qd.template cast<Scalar>();
      const auto precise = rounded.template cast<long double>();
      const Results a = results<Scalar>(rounded, inputs(which), q, qd);
      const Results b =
          results<long double>(precise, inputs(which), q.template cast<long double>(), qd.template cast<long double>());
      keep_worst(worst[0], relative(a.product, b.sweep) / epsilon);
      keep_worst(worst[1], relative(a.sweep, b.sweep) / epsilon);
      keep_worst(worst[2], relative(a.qdd0, b.qdd0) / epsilon);
      keep_worst(worst[3], relative(a.qdd, b.qdd) / epsilon);
    }
    CAPTURE(name, lightness, inside, which);
    // What one ε in the data moves is 6 ε, of the force's columns as of the others; these alone take the conditioning
    // of the limb's rows, too (134 ε measured with the base 1e-6 times as heavy, 16 with a base like the links).
    for (const double error : worst) { CHECK(error < (which == 2 ? 256 : 32)); }
  }
}

/// Largest error of a column.
double worst_column(const MatrixX<long double>& value, const MatrixX<long double>& exact)
{
  double worst = 0;
  for (Index j = 0; j < exact.cols(); ++j) {
    keep_worst(worst, relative(VectorX<long double>(value.col(j)), VectorX<long double>(exact.col(j))));
  }
  return worst;
}

/// Seven links, on the world or on a free base, with `side_limbs` on the fourth and a load on the last that the wrench
/// acts on: largest errors in ε of Scalar, of q̈ under the wrench and of single columns of B̂.
struct UnderForce {
  double qdd = 0, product = 0, sweep = 0;
};

template <class Scalar>
UnderForce under_force(double load, bool on_base, int side_limbs)
{
  UnderForce worst;
  const double epsilon = static_cast<double>(std::numeric_limits<Scalar>::epsilon());
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    test::Random random(seed);
    Parts<double> assembly;
    if (on_base) { assembly.add("base", {}, FloatingBase<double>{random.body()}); }
    const auto on = [&](const std::string& parent) {
      return Attachment<double>{parent, random.rotation(), random.vector(0.5)};
    };
    for (int k = 0; k < 7; ++k) {
      for (int side = 0; k == 4 && side < side_limbs; ++side) {  // their rows are stacked beside those of the load
        const std::string name = "side" + std::to_string(side);
        assembly.add(name, on("link3"), RevoluteLink<double>{{random.axis()}, random.body()});
        assembly.add(name + "'", on(name), RevoluteLink<double>{{random.axis()}, random.body()});
      }
      const Attachment<double> at = on(k > 0 ? "link" + std::to_string(k - 1) : on_base ? "base" : "world");
      const std::string name = "link" + std::to_string(k);
      Body<double> body = random.body();
      if (k == 6) { body.mass *= load, body.inertia *= load; }
      if (k == 1) {
        assembly.add(name, at, MotorArm<double>{{random.axis()}, body, random.motor()});
      } else if (k == 4) {
        assembly.add(name, at, PrismaticLink<double>{{random.axis()}, body});
      } else {
        assembly.add(name, at, RevoluteLink<double>{{random.axis()}, body});
      }
    }
    const auto rounded = assembly.template cast<Scalar>();
    const test::RandomState state = test::random_state(Tree<Scalar>(rounded), 0, random);
    const VectorX<Scalar> q = state.q.template cast<Scalar>(), qd = state.qd.template cast<Scalar>();
    const Axes axes = random.chance(0.5) ? Axes::body : Axes::world;
    const std::vector<test::NamedInput> wrench{{InputKind::wrench, "link6", test::Vec3(0.1, 0.2, 0.3), axes},
                                               {InputKind::motor, "link0"}};
    const double u = 10 * load;
    const Results a = results<Scalar>(rounded, wrench, q, qd, u);
    const Results b = results<long double>(rounded.template cast<long double>(), wrench, q.template cast<long double>(),
                                           qd.template cast<long double>(), u);
    keep_worst(worst.qdd, relative(a.qdd, b.qdd) / epsilon);
    keep_worst(worst.product, worst_column(a.product, b.sweep) / epsilon);
    keep_worst(worst.sweep, worst_column(a.sweep, b.sweep) / epsilon);
  }
  return worst;
}

}  // namespace

TEST_CASE("a free base keeps the digits of B̂ and q̈ under one limb that is up to 1e9 times as heavy")
{
  const struct {
    const char* name;
    First first;
  } cases[] = {{"revolute", First::revolute}, {"prismatic", First::prismatic}, {"geared", First::geared}};
  for (const auto& c : cases) {
    for (const double lightness : {1.0, 1e-3, 1e-6, 1e-9}) {
      for (const bool inside : {false, true}) {
        check<double>(c.name, lightness, c.first, inside);
        check<float>(c.name, lightness, c.first, inside);
      }
    }
  }
}

TEST_CASE("a tiny geared arm that its rotor all but locks to a free base keeps the digits of B̂")
{
  // What the joint undoes of the base's turning is then a small part of 1, of which the rest must not be subtracted.
  for (const bool armature : {false, true}) {
    for (std::uint64_t seed = 1; seed <= 20; ++seed) {
      test::Random random(seed);
      const auto tiny = [&] {
        Body<double> body = random.body();
        body.mass *= 1e-9;
        body.com *= 1e-3;
        body.inertia *= 1e-15;
        return body;
      };
      Parts<double> parts;
      parts.add("base", {}, FloatingBase<double>{random.body()});
      MotorArm<double> arm{{random.axis()}, tiny(), random.motor(0)};
      arm.motor.gear_ratio = -54;
      arm.motor.axial_inertia = 7e-4;
      arm.motor.mass = 0;
      arm.motor.armature = armature;
      parts.add("arm", {"base", random.rotation(), random.vector(0.4e-3)}, arm);
      parts.add("link", {"arm", random.rotation(), random.vector(0.4e-3)},
                RevoluteLink<double>{{random.axis()}, tiny()});
      parts.add("slide", {"link", random.rotation(), random.vector(0.4e-3)},
                PrismaticLink<double>{{random.axis()}, tiny()});
      const auto precise = parts.cast<long double>();
      const test::RandomState state = test::random_state(Tree<double>(parts), 0, random);
      const std::vector<test::NamedInput> motor{{InputKind::motor, "arm"}};
      const Results a = results<double>(parts, motor, state.q, state.qd);
      const Results b = results<long double>(precise, motor, state.q.cast<long double>(), state.qd.cast<long double>());
      CAPTURE(armature, seed);
      // Some roundings; hundreds of ε where it is subtracted.
      CHECK(relative(a.product, b.sweep) < 32 * std::numeric_limits<double>::epsilon());
      CHECK(relative(a.sweep, b.sweep) < 32 * std::numeric_limits<double>::epsilon());
    }
  }
}

TEST_CASE("forces on a load of up to 1e9 times the links' mass: q̈ and each column of B̂ without a loss of digits")
{
  for (const double load : {1.0, 1e3, 1e6, 1e9}) {
    for (const bool on_base : {false, true}) {
      for (const int side_limbs : {0, 8}) {
        CAPTURE(load, on_base, side_limbs);
        // Measured: up to 178 ε, at a load of 1 as of 1e9 times; with the force beside the rows 1e8 ε of q̈ and of its
        // columns.
        const UnderForce in_double = under_force<double>(load, on_base, side_limbs);
        const UnderForce in_float = under_force<float>(load, on_base, side_limbs);
        for (const UnderForce& worst : {in_double, in_float}) {
          CHECK(worst.qdd < 512);
          CHECK(worst.product < 512);
          CHECK(worst.sweep < 512);
        }
      }
    }
  }
}

TEST_CASE("a base that stands as it is attached, the first axis of its limb through its origin")
{
  for (const double tilt : {0.0, 1e-9}) {
    for (int k = 0; k < 6; ++k) {
      CAPTURE(tilt, k);
      test::Random random(static_cast<std::uint64_t>(k) + 1);
      test::Vec3 axis = test::Vec3::Unit(k % 3) * (k < 3 ? 1.0 : -1.0);
      axis((k + 1) % 3) += tilt;
      axis((k + 2) % 3) -= tilt;
      Parts<double> parts;
      Body<double> light = random.body();
      light.mass *= 1e-3;
      light.inertia *= 1e-3;
      light.com.setZero();
      parts.add("base", {}, FloatingBase<double>{light});
      parts.add("link0", {"base"}, RevoluteLink<double>{{axis.normalized()}, random.body()});
      for (int link = 1; link < 4; ++link) {
        parts.add("link" + std::to_string(link),
                  {"link" + std::to_string(link - 1), random.rotation(), random.vector(0.5)},
                  RevoluteLink<double>{{random.axis()}, random.body()});
      }
      test::RandomState state = test::random_state(Tree<double>(parts), 0, random);
      state.q.head(7) << 0, 0, 0, 0, 0, 0, 1;
      const Results a = results<double>(parts, inputs(0), state.q, state.qd);
      const Results b = results<long double>(parts.cast<long double>(), inputs(0), state.q.cast<long double>(),
                                             state.qd.cast<long double>());
      const double epsilon = std::numeric_limits<double>::epsilon();
      CHECK(relative(a.product, b.sweep) / epsilon < 64);
      CHECK(relative(a.sweep, b.sweep) / epsilon < 64);
      CHECK(relative(a.qdd0, b.qdd0) / epsilon < 64);
    }
  }
}

TEST_CASE("forces on a load that a part without mass carries on a free base: q̈ and each column of B̂")
{
  for (const double load : {1e3, 1e6, 1e9}) {
    UnderForce worst;
    for (std::uint64_t seed = 1; seed <= 20; ++seed) {
      test::Random random(seed);
      Parts<double> parts;
      const auto times = [&](double factor) {
        Body<double> body = random.body();
        body.mass *= factor;
        body.inertia *= factor;
        return body;
      };
      parts.add("base", {}, FloatingBase<double>{times(1)});
      parts.add("part", {"base", random.rotation(), random.vector(0.5)},
                RevoluteLink<double>{{random.axis()}, Body<double>::massless()});
      parts.add("load", {"part", random.rotation(), random.vector(0.5)},
                RevoluteLink<double>{{random.axis()}, times(load)});
      const test::RandomState state = test::random_state(Tree<double>(parts), 0, random);
      const std::vector<test::NamedInput> named{{InputKind::wrench, "load", test::Vec3(0.1, 0.2, 0.3)},
                                                {InputKind::motor, "part"}};
      const Results a = results<double>(parts, named, state.q, state.qd, load);
      const Results b = results<long double>(parts.cast<long double>(), named, state.q.cast<long double>(),
                                             state.qd.cast<long double>(), load);
      const double epsilon = std::numeric_limits<double>::epsilon();
      keep_worst(worst.qdd, relative(a.qdd, b.qdd) / epsilon);
      keep_worst(worst.product, worst_column(a.product, b.sweep) / epsilon);
      keep_worst(worst.sweep, worst_column(a.sweep, b.sweep) / epsilon);
    }
    CAPTURE(load, worst.qdd, worst.product, worst.sweep);
    CHECK(worst.qdd < 64);
    CHECK(worst.product < 2048);  // 446; where the load is not told from the part 2·10⁴ to 10¹⁰
    CHECK(worst.sweep < 2048);
  }
}

TEST_CASE("forces on a load at one state after another, by the same method")
{
  test::Random random(3);
  Parts<double> parts;
  std::string parent = "world";
  for (int k = 0; k < 4; ++k) {
    Body<double> body = random.body();
    if (k == 3) { body.mass *= 1e6, body.inertia *= 1e6; }
    const std::string name = "link" + std::to_string(k);
    parts.add(name, {parent, random.rotation(), random.vector(0.5)}, RevoluteLink<double>{{random.axis()}, body});
    parent = name;
  }
  const Tree<double> tree(parts);
  Inputs<Tree<double>> in(tree, Start::empty);
  in.add_wrench("link3");
  Workspace<Tree<double>, Update::square_root> ws(tree);
  UnitForce<Tree<double>> sweep(tree, in);
  ImplicitInversion<Tree<double>> product(tree, in);
  for (int k = 0; k < 5; ++k) {
    const test::RandomState state = test::random_state(tree, 0, random);
    const auto fd = forward_dynamics(state.q, state.qd, ws);
    REQUIRE(fd.ok());
    UnitForce<Tree<double>> new_sweep(tree, in);
    ImplicitInversion<Tree<double>> new_product(tree, in);
    CHECK(sweep(fd).Bhat == new_sweep(fd).Bhat);
    CHECK(product(fd).Bhat == new_product(fd).Bhat);
  }
}

}  // namespace test_limb_on_light_base
