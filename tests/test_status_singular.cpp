// PROGRAM: tests_extreme
// Machines without a mass matrix to invert: in whatever direction they point, roundings must not pass for an inertia.
#include "catch.hpp"
#include "random_tree.hpp"

#include <iim/iim.hpp>
#include <iim/subsystem/joint_more.hpp>

#include <cstdint>
#include <string>
#include <type_traits>

namespace test_status_singular {

using namespace iim;

namespace {

using Parts = StandardAssembly<double>;

const Body<double> massless = Body<double>::massless();

/// Whether the O(n) pass takes the machine for a regular one.
template <class Scalar, Update update>
bool passes(const Parts& parts, std::uint64_t seed)
{
  const auto assembly = test::in<Scalar>(parts);
  const DynamicTree tree(assembly);
  Workspace<decltype(tree), update> ws(tree);
  test::Random random(seed);
  const test::RandomState x = test::random_state(tree, 0, random);
  return forward_dynamics(x.q.cast<Scalar>().eval(), x.qd.cast<Scalar>().eval(), ws).ok();
}

template <class Make>
void all_are_refused(const char* machine, Make&& make)
{
  int passed = 0;
  for (std::uint64_t seed = 0; seed < 300; ++seed) {
    test::Random random(seed);
    const Parts parts = make(random);
    const std::uint64_t state = seed + 1000;
    passed += passes<double, Update::projected>(parts, state) + passes<float, Update::projected>(parts, state) +
              passes<double, Update::square_root>(parts, state) + passes<float, Update::square_root>(parts, state);
  }
  INFO(machine);
  CHECK(passed == 0);
}

Attachment<double> somewhere(const char* parent, test::Random& random)
{
  return {parent, random.rotation(), random.vector(0.5)};
}

RevoluteLink<double> link(test::Random& random) { return {{random.axis()}, random.body()}; }

}  // namespace

TEST_CASE("free bases without mass")
{
  all_are_refused("one link", [](test::Random& random) {
    Parts parts;
    parts.add("base", {}, FloatingBase<double>{massless});
    parts.add("link", somewhere("base", random), link(random));
    return parts;
  });
  all_are_refused("a limb", [](test::Random& random) {
    Parts parts;
    parts.add("base", {}, FloatingBase<double>{massless});
    parts.add("a", somewhere("base", random), link(random));
    parts.add("b", somewhere("a", random), link(random));
    parts.add("c", somewhere("b", random), link(random));
    return parts;
  });
  all_are_refused("two points", [](test::Random& random) {
    Parts parts;
    Body<double> point;
    point.mass = 1;
    point.com = random.vector(0.5);
    parts.add("base", {}, FloatingBase<double>{point});
    point.com = random.vector(0.5);
    parts.add("other", somewhere("base", random), FixedLink<double>{{}, point});
    return parts;
  });
}

TEST_CASE("coaxial joints with nothing between")
{
  all_are_refused("on the world", [](test::Random& random) {
    Parts parts;
    parts.add("cross", somewhere("world", random), RevoluteLink<double>{{Vector3<double>::UnitZ()}, massless});
    parts.add("link", {"cross", Matrix3<double>::Identity(), random.uniform(-1, 1) * Vector3<double>::UnitZ()},
              RevoluteLink<double>{{Vector3<double>::UnitZ()}, random.body()});
    return parts;
  });
  all_are_refused("on a link", [](test::Random& random) {
    Parts parts;
    const Vector3<double> axis = random.unit();
    parts.add("arm", somewhere("world", random), link(random));
    parts.add("cross", somewhere("arm", random), RevoluteLink<double>{{axis}, massless});
    parts.add("link", {"cross", Matrix3<double>::Identity(), random.uniform(-1, 1) * axis},
              RevoluteLink<double>{{axis}, random.body()});
    return parts;
  });
  all_are_refused("a rod along them, on a free base", [](test::Random& random) {
    Parts parts;
    Body<double> rod;
    rod.mass = 0.36;
    rod.inertia.diagonal() << 0.02, 0.02, 0;
    parts.add("base", {}, FloatingBase<double>{random.body()});
    parts.add("rod", somewhere("base", random), RevoluteLink<double>{{Vector3<double>::UnitZ()}, rod});
    parts.add("link", {"rod", Matrix3<double>::Identity(), random.uniform(-1, 1) * Vector3<double>::UnitZ()},
              RevoluteLink<double>{{Vector3<double>::UnitZ()}, random.body()});
    return parts;
  });
}

TEST_CASE("four joints about one point or along one direction, with nothing between")
{
  for (const bool parallel : {false, true}) {
    all_are_refused(parallel ? "one direction" : "one point", [&](test::Random& random) {
      Parts parts;
      parts.add("arm", somewhere("world", random), link(random));
      const Vector3<double> axis = random.unit();
      for (int k = 0; k < 4; ++k) {
        Attachment<double> on = somewhere(k == 0 ? "arm" : ("link" + std::to_string(k - 1)).c_str(), random);
        if (parallel) { on.R.setIdentity(); }
        if (!parallel && k > 0) { on.p.setZero(); }
        parts.add("link" + std::to_string(k), on,
                  RevoluteLink<double>{{parallel ? axis : random.axis()}, k < 3 ? massless : random.body()});
      }
      return parts;
    });
  }
}

TEST_CASE("a rotor that its own joint holds")
{
  all_are_refused("", [](test::Random& random) {
    Parts parts;
    parts.add("cross", somewhere("world", random), RevoluteLink<double>{{random.axis()}, massless});
    MotorArm<double> arm{{random.axis()}, massless, random.motor(0)};
    arm.motor.mass = arm.motor.transverse_inertia = 0;
    parts.add("arm", somewhere("cross", random), arm);
    return parts;
  });
}

TEST_CASE("coaxial joints with nothing between, in a row of parallel ones under a load")
{
  all_are_refused("", [](test::Random& random) {
    Parts parts;
    const Vector3<double> axis = random.unit();
    const int light = 1 + random.below(4);
    std::string on = "world";
    for (int k = 0; k < 7; ++k) {
      Vector3<double> p = random.vector(0.5);
      if (k == light + 1) { p = random.uniform(-0.5, 0.5) * axis; }
      Body<double> body = k == light ? massless : random.body();
      if (k == 6) {
        body.mass *= 1e5;
        body.inertia *= 1e5;
      }
      const std::string name = "link" + std::to_string(k);
      parts.add(name, {on, Matrix3<double>::Identity(), p},
                RevoluteLink<double>{{random.chance(0.5) ? axis : Vector3<double>(-axis)}, body});
      on = name;
    }
    return parts;
  });
}

TEST_CASE("a ball on a universal joint about the same point, with nothing between")
{
  using Crossed = Assembly<RevoluteLink<double>, PlanarLink<double>, UniversalLink<double>, SphericalLink<double>>;
  int passed = 0;
  for (std::uint64_t seed = 0; seed < 300; ++seed) {
    test::Random random(seed);
    Crossed parts;
    parts.add("arm", somewhere("world", random), link(random));
    parts.add("plane", somewhere("arm", random), PlanarLink<double>{{}, random.body()});
    parts.add("forearm", somewhere("plane", random), link(random));
    parts.add("cross", somewhere("forearm", random), UniversalLink<double>{{}, massless});
    parts.add("ball", {"cross"}, SphericalLink<double>{{}, random.body()});
    parts.add("hand", somewhere("ball", random), SphericalLink<double>{{}, random.body()});
    const DynamicTree tree(parts);
    test::RandomState x = test::random_state(tree, 0, random);
    normalize(tree, x.q);
    const auto takes = [&]<Update update>(std::integral_constant<Update, update>) {
      Workspace<std::remove_const_t<decltype(tree)>, update> ws(tree);
      return forward_dynamics(x.q, x.qd, ws).ok();
    };
    passed += takes(std::integral_constant<Update, Update::projected>{}) +
              takes(std::integral_constant<Update, Update::square_root>{});
  }
  CHECK(passed == 0);
}

}  // namespace test_status_singular
