// PROGRAM: tests_parallel
// Heavy loads behind joints of several velocities, screws and free bases, on parallel axes, behind a hand of many
// fingers, and a heavy flywheel, in the projected form: B̂ and q̈₀ keep their digits.
#include "catch.hpp"
#include "random_tree.hpp"
#include "worst.hpp"

#include <iim/iim.hpp>
#include <iim/subsystem/joint_more.hpp>

#include <cstdint>
#include <limits>
#include <string>
#include <type_traits>
#include <vector>

namespace test_loads_on_joints {

using namespace iim;
using iim::test::keep_worst;

namespace {

template <class Scalar>
using Parts = Assembly<RevoluteLink<Scalar>, HelicalLink<Scalar>, CylindricalLink<Scalar>, UniversalLink<Scalar>,
                       PlanarLink<Scalar>, SphericalLink<Scalar>, FloatingBase<Scalar>>;
enum class Kind { revolute, helical, cylindrical, universal, planar, ball, free };

Body<double> times(Body<double> body, double factor)
{
  body.mass *= factor;
  body.inertia *= factor;
  return body;
}

void add(Parts<double>& parts, Kind kind, const std::string& name, const Attachment<double>& on,
         const Body<double>& body, test::Random& random)
{
  const test::Vec3 axis = random.axis(), across = axis.cross(random.unit()).normalized();
  switch (kind) {
    case Kind::revolute: parts.add(name, on, RevoluteLink<double>{{axis}, body}); break;
    case Kind::helical: parts.add(name, on, HelicalLink<double>{{axis, 0.05}, body}); break;
    case Kind::cylindrical: parts.add(name, on, CylindricalLink<double>{{axis}, body}); break;
    case Kind::universal:
      // Axes at 5° or more to each other.
      parts.add(name, on, UniversalLink<double>{{axis, (across + random.uniform(0, 10) * axis).normalized()}, body});
      break;
    case Kind::planar: parts.add(name, on, PlanarLink<double>{{axis, across}, body}); break;
    case Kind::ball: parts.add(name, on, SphericalLink<double>{{}, body}); break;
    case Kind::free: parts.add(name, on, FloatingBase<double>{body}); break;
  }
}

/// Links of 0.4 m, the last `load` times as heavy.
Parts<double> chain(const std::vector<Kind>& kinds, double load, test::Random& random)
{
  Parts<double> parts;
  std::string parent = "world";
  for (std::size_t k = 0; k < kinds.size(); ++k) {
    const Attachment<double> on{parent, random.rotation(), random.vector(0.4)};
    parent = "link" + std::to_string(k);
    add(parts, kinds[k], parent, on, times(random.body(), k + 1 == kinds.size() ? load : 1), random);
  }
  return parts;
}

/// Links of which the first `parallel` turn about one direction, the last `load` times as heavy.
Parts<double> on_parallel_axes(int parallel, int links, double load, test::Random& random)
{
  Parts<double> parts;
  const test::Vec3 axis = random.unit();
  std::string parent = "world";
  for (int k = 0; k < links; ++k) {
    const Attachment<double> on{parent, test::Mat3::Identity(), random.vector(0.4)};
    parent = "link" + std::to_string(k);
    parts.add(
        parent, on,
        RevoluteLink<double>{{k < parallel ? axis : random.axis()}, times(random.body(), k + 1 == links ? load : 1)});
  }
  return parts;
}

/// Of B̂ and q̈₀ [ε].
struct Errors {
  double Bhat = 0, qdd0 = 0;  ///< the largest
  int over = 0, states = 0;   ///< of B̂ over 32 ε
};

/// Adds those of ten states of one robot, against the square-root form in long double.
void add_errors(const Parts<double>& parts, test::Random& random, Errors& errors)
{
  const DynamicTree tree(parts);
  const DynamicTree exact_tree(parts.cast<long double>());
  const Inputs inputs(tree);
  const Inputs exact_inputs(exact_tree);
  Workspace ws(tree);
  Workspace<std::remove_const_t<decltype(exact_tree)>, Update::square_root> exact_ws(exact_tree);
  ImplicitInversion method(tree, inputs);
  ImplicitInversion exact_method(exact_tree, exact_inputs);
  for (int k = 0; k < 10; ++k) {
    test::RandomState state = test::random_state(tree, 0, random);
    tree.outward([&]<class N, class S>(const N& node, const S&) {
      if constexpr (std::is_same_v<S, SphericalLink<double>>) { state.q.segment<4>(node.q) = random.quaternion(); }
    });
    const VectorX<long double> q = state.q.cast<long double>(), qd = state.qd.cast<long double>();
    const auto result = method(state.q, state.qd, ws);
    const auto exact = exact_method(forward_dynamics(q, qd, exact_ws));
    REQUIRE(result.ok());
    REQUIRE(exact.ok());
    const auto error = [](const auto& x, const auto& right) {
      const auto relative = static_cast<double>((x.template cast<long double>() - right).norm() / right.norm());
      return relative / std::numeric_limits<double>::epsilon();
    };
    const double of_Bhat = error(result.Bhat, exact.Bhat);
    keep_worst(errors.Bhat, of_Bhat);
    keep_worst(errors.qdd0, error(result.qdd0, exact.qdd0));
    errors.over += !(of_Bhat <= 32);
    ++errors.states;
  }
}

/// make(random): a robot.
template <class Make>
Errors errors(int robots, Make make)
{
  Errors found;
  for (std::uint64_t seed = 1; seed <= static_cast<std::uint64_t>(robots); ++seed) {
    CAPTURE(seed);
    test::Random random(seed);
    add_errors(make(random), random, found);
  }
  return found;
}

}  // namespace

TEST_CASE("loads to 10⁹ times the links behind joints of several velocities, screws and free bases")
{
  // With M̄_R alone from sums over the bodies most states have a tenth as many ε as the load is times as heavy as a link
  // (screws and free bases fewer).
  using enum Kind;
  const std::vector<Kind> cases[] = {{ball, ball, ball, ball},
                                     {universal, universal, universal, universal},
                                     {cylindrical, cylindrical, cylindrical, cylindrical},
                                     {planar, planar, planar, planar},
                                     {helical, helical, helical, helical},
                                     {ball, ball, ball, revolute},
                                     {revolute, ball, revolute, universal, planar, revolute},
                                     {free, revolute, revolute, revolute, revolute, revolute, revolute},
                                     {free, ball, ball, universal}};
  for (const std::vector<Kind>& kinds : cases) {
    for (const double load : {1e3, 1e6, 1e9}) {
      CAPTURE(static_cast<int>(kinds[0]), static_cast<int>(kinds.back()), kinds.size(), load);
      const Errors found = errors(20, [&](test::Random& random) { return chain(kinds, load, random); });
      CHECK(found.over <= found.states / 4);  // one in ten of universal joints, one in five of free bases, else fewer
      CHECK(found.Bhat < (load < 1e4 ? 512 : 1e5));  // 124, 19000
      CHECK(found.qdd0 < (load < 1e8 ? 512 : 1e4));  // 190, 2800
    }
  }
}

TEST_CASE("a load on parallel axes that lie obliquely in the world")
{
  for (const double load : {1e3, 1e6, 1e9}) {
    CAPTURE(load);
    const Errors found = errors(10, [&](test::Random& random) { return on_parallel_axes(6, 9, load, random); });
    CHECK(found.over <= found.states / 3);
    CHECK(found.Bhat < (load < 1e4   ? 256
                        : load < 1e8 ? 4e3
                                     : 1e5));  // 36, 650, 3 × 10⁴, 9 × 10⁷ with pivots as they are
    CHECK(found.qdd0 < (load < 1e4 ? 1e3 : load < 1e8 ? 4e3 : 1e7));  // 245, 1000, 1.6 × 10⁶
  }
}

TEST_CASE("a load in the plane of seven parallel joints")
{
  for (const double load : {1e2, 1e3, 1e4}) {
    CAPTURE(load);
    const Errors found = errors(10, [&](test::Random& random) { return on_parallel_axes(7, 7, load, random); });
    CHECK(found.over <= found.states / 20);  // 15 of 100 where pivots are mended from 1/256 on
    CHECK(found.Bhat < 300);
    CHECK(found.qdd0 < 64);  // 8, in the world's axes 10³ to 10⁵
  }
}

TEST_CASE("a limb with a load beside forty light fingers")
{
  for (const bool fingers_first : {false, true}) {
    for (const double load : {1e6, 1e9}) {
      CAPTURE(fingers_first, load);
      const Errors found = errors(5, [&](test::Random& random) {
        Parts<double> parts = chain({Kind::revolute, Kind::revolute, Kind::revolute}, 1, random);
        for (const bool fingers : {fingers_first, !fingers_first}) {
          if (fingers) {
            for (int k = 0; k < 40; ++k) {
              add(parts, Kind::revolute, "finger" + std::to_string(k), {"link2", random.rotation(), random.vector(0.4)},
                  times(random.body(), 0.1), random);
            }
            continue;
          }
          std::string parent = "link2";
          for (int k = 0; k < 5; ++k) {
            const Attachment<double> on{parent, random.rotation(), random.vector(0.4)};
            parent = "limb" + std::to_string(k);
            add(parts, Kind::revolute, parent, on, times(random.body(), k == 4 ? load : 1), random);
          }
        }
        return parts;
      });
      CHECK(found.over <= found.states / 5);
      CHECK(found.Bhat <
            512);              // 138; in the order of their numbers, 32 bodies one by one and no more: 5 × 10³, 2 × 10⁶
      CHECK(found.qdd0 < 64);  // 13
    }
  }
}

TEST_CASE("a flywheel whose moments alone are large")
{
  for (const double load : {1e3, 1e6, 1e9}) {
    CAPTURE(load);
    const Errors found = errors(10, [&](test::Random& random) {
      Parts<double> parts = chain(std::vector<Kind>(6, Kind::revolute), 1, random);
      Body<double> wheel = random.body();
      wheel.inertia *= load;
      add(parts, Kind::revolute, "wheel", {"link5", random.rotation(), random.vector(0.4)}, wheel, random);
      return parts;
    });
    CHECK(found.qdd0 < 64);  // 10; up to 10⁶ times that, if q̈₀ were made better for heavy masses alone
  }
}

}  // namespace test_loads_on_joints
