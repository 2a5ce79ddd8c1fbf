// PROGRAM: tests_parallel
// Light bodies between joints that turn about one line (roll on roll): q̈ and B̂ have their digits, as what passes
// through the outer joint is not felt by the inner one but for its load.
#include "catch.hpp"
#include "random_tree.hpp"
#include "worst.hpp"

#include <iim/iim.hpp>
#include <iim/several_states.hpp>

#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>

namespace test_coaxial {

using namespace iim;

namespace {

using Links = Assembly<RevoluteLink<double>>;

/// Joints about z, y, z, −z, z and x in placements that turn about z; of the three in line two carry rods of some
/// grams.
Links arm(test::Random& random)
{
  Links assembly;
  Attachment<double> on;
  on.R = random.rotation();
  const int axes[] = {2, 1, 2, 2, 2, 0};
  for (int k = 0; k < 6; ++k) {
    const bool is_light = k == 2 || k == 3;
    const double length = random.uniform(0.1, 0.4), width = is_light ? 0.01 : random.uniform(0.05, 0.1);
    RevoluteLink<double> link;
    link.joint.axis = Vector3<double>::Unit(axes[k]) * (k == 3 ? -1.0 : 1.0);
    link.body.mass = is_light ? random.uniform(0.01, 0.03) : random.uniform(2, 5);
    link.body.com = Vector3<double>(0, 0, length / 2);
    if (!is_light) { link.body.com += random.vector(0.02); }
    const double across = link.body.mass / 12 * (width * width + length * length);
    link.body.inertia.diagonal() << across, across, link.body.mass / 6 * width * width;
    const std::string name = "axis" + std::to_string(k);
    assembly.add(name, on, link);
    on = Attachment<double>{};
    on.parent = name;
    on.p.z() = length;
    on.R = Eigen::AngleAxisd(random.uniform(-3, 3), Vector3<double>::UnitZ()).toRotationMatrix();
  }
  return assembly;
}

}  // namespace

TEST_CASE("a light body between two rolls")
{
  double of_rest = 0, of_Bhat = 0, of_torques = 0, of_force = 0, of_several = 0;
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    test::Random random(seed);
    const Links assembly = arm(random);
    const DynamicTree tree(assembly);
    const DynamicTree exact_tree(assembly.cast<long double>());
    Inputs inputs(tree);
    Inputs exact_inputs(exact_tree);
    inputs.add_force("axis2", Vector3<double>(0, 0, 0.1));
    exact_inputs.add_force("axis2", Vector3<long double>(0, 0, 0.1L));
    Workspace ws(tree);
    Workspace exact_ws(exact_tree);
    ImplicitInversion method(tree, inputs);
    ImplicitInversion exact_method(exact_tree, exact_inputs);
    SeveralStates several(assembly, inputs);
    const Index count = 24, m = inputs.columns();
    MatrixX<double> q(6, count), qd(6, count);
    MatrixX<long double> exact(6, count);
    const auto error = [](const auto& a, const auto& right) {
      return static_cast<double>((a.template cast<long double>() - right).norm() / right.norm()) /
             std::numeric_limits<double>::epsilon();
    };
    for (Index k = 0; k < count; ++k) {
      const test::RandomState state = test::random_state(tree, 0, random);
      q.col(k) = state.q;
      qd.col(k) = state.qd;
      const VectorX<long double> Q = state.q.cast<long double>(), V = state.qd.cast<long double>();
      const auto right = exact_method(Q, V, exact_ws);
      exact.col(k) = right.qdd0;
      const auto result = method(state.q, state.qd, ws);
      REQUIRE(result.ok());
      test::keep_worst(of_rest, error(result.qdd0, exact.col(k)));
      test::keep_worst(of_Bhat, error(result.Bhat, right.Bhat));
      VectorX<double> u = VectorX<double>::Zero(m);
      for (int j = 0; j < 6; ++j) { u(j) = random.uniform(-3, 3); }
      const auto accelerate = [&] {
        const VectorX<long double> U = u.cast<long double>();
        const VectorX<long double> qdd = iim::forward_dynamics(Q, V, exact_inputs, U, exact_ws).qdd;
        const auto ours = iim::forward_dynamics(state.q, state.qd, inputs, u, ws);
        REQUIRE(ours.ok());
        return error(ours.qdd, qdd);
      };
      test::keep_worst(of_torques, accelerate());
      u(m - 1) = 2;  // on the light body: felt by its joint
      test::keep_worst(of_force, accelerate());
    }
    several.for_each(q, qd, [&](Index k, const auto& result) {
      REQUIRE(result.ok());
      test::keep_worst(of_several, error(result.qdd0, exact.col(k)));
    });
  }
  CAPTURE(of_rest, of_Bhat, of_torques, of_force, of_several);
  CHECK(of_Bhat < 16);
  CHECK(of_torques < 128);  // 22 to 60, by compiler
  CHECK(of_force < 128);    // 10 to 49
  // q̈₀ is small against what weight does to the light bodies alone.
  CHECK(of_rest < 256);     // 40 to 110; where the wrench that passes is felt 2·10⁶
  CHECK(of_several < 512);  // 80 to 160; so 1·10⁶
}

}  // namespace test_coaxial
