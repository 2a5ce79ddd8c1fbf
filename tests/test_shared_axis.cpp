// PROGRAM: tests_extreme
// Square-root form on axes that nearly or exactly coincide: what a joint undoes of its parent's motion does not cost
// digits, whatever the type of the two joints, in q̈ with and without inputs and in every method that is built on the
// workspace.
#include "catch.hpp"

#include "random_tree.hpp"

#include <iim/iim.hpp>
#include <iim/unit_force.hpp>

#include <array>
#include <cmath>
#include <cstdio>
#include <string>
#include <utility>

namespace test_shared_axis {

namespace {

using namespace iim;

constexpr double apart = 0x1p-20;  // m

enum class Kind { revolute, prismatic, ideal, geared };

Body<double> rod(double length)
{
  Body<double> body;
  body.mass = 1;
  body.com = Vector3<double>(0, 0, -length / 2);
  body.inertia = Vector3<double>(length * length / 10, length * length / 10, length * length / 100).asDiagonal();
  return body;
}

/// Four short links before four long ones, each pair about (or along) one axis.
StandardAssembly<double> pairs(Kind outer, Kind inner, double distance)
{
  StandardAssembly<double> parts;
  parts.set_gravity(Vector3<double>(2, 3, -9));  // along every axis that slides
  for (int i = 0; i < 8; ++i) {
    const Vector3<double> axis = Vector3<double>::Unit(i / 2 % 2);
    const bool is_inner = i % 2 == 0;
    const Body<double> body = rod(is_inner ? distance : 1.0);
    Attachment<double> on;
    if (i > 0) {
      on.parent = "link" + std::to_string(i - 1);
      on.p = is_inner ? Vector3<double>(0.125, 0, -1) : Vector3<double>(distance / 8, 0, -distance);
    }
    const Kind kind = is_inner ? inner : outer;
    const std::string name = "link" + std::to_string(i);
    if (kind == Kind::revolute) { parts.add(name, on, RevoluteLink<double>{{axis}, body}); }
    if (kind == Kind::prismatic) {
      Body<double> heavier = body;
      if (is_inner) { heavier.mass = distance * distance; }  // its acceleration is as large as that of a short link
      parts.add(name, on, PrismaticLink<double>{{axis}, heavier});
    }
    if (kind == Kind::ideal || kind == Kind::geared) {
      MotorArm<double> arm{{axis}, body, {}};
      if (kind == Kind::geared) {
        arm.motor.gear_ratio = 20;
        arm.motor.axial_inertia = 1e-4;
        arm.motor.axis = axis;
      }
      parts.add(name, on, arm);
    }
  }
  parts.add_frame("tip", {.parent = "link7", .p = Vector3<double>(0, 0.25, -1)});
  parts.add_frame("knee", {.parent = "link2", .p = Vector3<double>(0, distance, 0)});
  return parts;
}

template <class Scalar>
struct Results {
  MatrixX<long double> product, sweep;
  VectorX<long double> qdd0, qdd;
};

template <class Scalar, class State>
Results<Scalar> results(const StandardAssembly<double>& parts, const State& state)
{
  using Tree = decltype(DynamicTree(std::declval<StandardAssembly<Scalar>>()));
  const Tree tree(parts.cast<Scalar>());
  Inputs<Tree> inputs(tree);
  inputs.add_force("tip");
  inputs.add_force("knee");
  Workspace<Tree, Update::square_root> ws(tree);
  const VectorX<Scalar> q = state.q.template cast<Scalar>(), qd = state.qd.template cast<Scalar>(),
                        u = state.u.template cast<Scalar>();
  ImplicitInversion<Tree> inversion(tree, inputs);
  UnitForce<Tree> unit_force(tree, inputs);
  Results<Scalar> results;
  const auto fd = forward_dynamics(q, qd, ws);
  const auto a = inversion(fd), b = unit_force(fd);
  REQUIRE(a.ok());
  REQUIRE(b.ok());
  results.product = a.Bhat.template cast<long double>();
  results.sweep = b.Bhat.template cast<long double>();
  results.qdd0 = a.qdd0.template cast<long double>();
  const auto with = forward_dynamics(q, qd, inputs, u, ws);
  REQUIRE(with.status == Status::ok);
  results.qdd = with.qdd.template cast<long double>();
  return results;
}

struct PreciseState {
  VectorX<long double> q, qd, u;
};

template <class Matrix>
double relative(const Matrix& value, const Matrix& exact)
{
  return static_cast<double>((value - exact).norm() / exact.norm());
}

template <class Scalar>
void check(const StandardAssembly<double>& parts, const char* name, double bound)
{
  const DynamicTree tree(parts);
  const auto epsilon = static_cast<double>(Eigen::NumTraits<Scalar>::epsilon());
  std::array<double, 4> worst{};
  INFO(name);
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    test::Random draw(seed);
    test::RandomState state = test::random_state(tree, 8 + 6, draw);
    for (auto* x : {&state.q, &state.qd, &state.u}) { *x = x->template cast<float>().template cast<double>(); }
    const auto exact = results<long double>(parts, state);
    const auto apart_from = [&](const auto& other) {
      return std::array{relative(other.product, exact.product) / epsilon,
                        relative(other.sweep, exact.product) / epsilon, relative(other.qdd0, exact.qdd0) / epsilon,
                        relative(other.qdd, exact.qdd) / epsilon};
    };
    const auto errors = apart_from(results<Scalar>(parts, state));
    // What half an ε in q and q̇ moves, the most of some samples: no result can be expected to be nearer.
    std::array<double, 4> sensitivity{};
    for (int sample = 0; sample < 6; ++sample) {
      PreciseState moved{state.q.cast<long double>(), state.qd.cast<long double>(), state.u.cast<long double>()};
      for (auto* x : {&moved.q, &moved.qd}) {
        for (long double& value : *x) {
          value *= 1 + (draw.chance(0.5) ? 0.5L : -0.5L) * static_cast<long double>(epsilon);
        }
      }
      const auto movement = apart_from(results<long double>(parts, moved));
      for (std::size_t k = 0; k < 4; ++k) { sensitivity[k] = std::fmax(sensitivity[k], movement[k]); }
    }
    for (std::size_t k = 0; k < 4; ++k) {
      worst[k] = std::fmax(worst[k], errors[k]);
      CHECK(errors[k] < std::fmax(bound, 16 * sensitivity[k]));
    }
  }
  std::printf("%-28s %-6s product %5.3g sweep %5.3g qdd0 %5.3g qdd %5.3g eps\n", name,
              sizeof(Scalar) == 4 ? "float" : "double", worst[0], worst[1], worst[2], worst[3]);
}

}  // namespace

TEST_CASE("square-root form keeps its digits on axes that nearly coincide")
{
  const struct {
    const char* name;
    Kind outer, inner;
    double bound = 16;
  } cases[] = {{"revolute on revolute", Kind::revolute, Kind::revolute},
               {"ideal motors", Kind::ideal, Kind::ideal},
               {"revolute on ideal motor", Kind::revolute, Kind::ideal},
               // The moment of a rotor that turns with its carrier is a wrench; that it has no part along the axis is
               // up to roundings.
               {"geared motor on revolute", Kind::geared, Kind::revolute, 512},
               {"geared motors", Kind::geared, Kind::geared, 512},
               {"prismatic on prismatic", Kind::prismatic, Kind::prismatic},
               {"revolute on prismatic", Kind::revolute, Kind::prismatic}};
  for (const auto& c : cases) {
    check<double>(pairs(c.outer, c.inner, apart), c.name, c.bound);
    check<float>(pairs(c.outer, c.inner, apart), c.name, c.bound);
  }
}

}  // namespace test_shared_axis
