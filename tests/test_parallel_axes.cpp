// PROGRAM: tests_parallel
// Chains about one direction oblique to the world's axes: as accurate as along a world axis.
#include "catch.hpp"
#include "random_tree.hpp"

#include <iim/iim.hpp>

#include <cstdint>
#include <limits>
#include <string>
#include <utility>

namespace test_parallel_axes {

using namespace iim;

namespace {

template <class Scalar>
using Links = Assembly<RevoluteLink<Scalar>>;
template <class Scalar>
using Chain = decltype(DynamicTree(std::declval<const Links<Scalar>&>()));

/// The paper's chain, its first joint mounted in the orientation R.
Links<double> mounted_chain(Index n, const Matrix3<double>& R)
{
  Links<double> chain;
  chain.set_gravity({0, 0, -9.81});
  for (Index k = 0; k < n; ++k) {
    RevoluteLink<double> link{{Vector3<double>::UnitY()}, {}};
    link.body.mass = 1;
    link.body.com = {0, 0, -0.5};
    link.body.inertia = Vector3<double>(0.1, 0.1, 0.01).asDiagonal();
    Attachment<double> on;
    if (k == 0) {
      on.R = R;
    } else {
      on.parent = "link" + std::to_string(k - 1);
      on.p = {0, 0, -1};
    }
    chain.add("link" + std::to_string(k), on, link);
  }
  return chain;
}

constexpr double float_epsilon = std::numeric_limits<float>::epsilon();

}  // namespace

TEST_CASE("a chain about an oblique axis has all digits of float")
{
  // 16 ε: what a chain about a world axis holds with some room (measured ≤ 14; 2000 without turned axes at 100 links).
  test::Random random(1);
  for (const Index n : {6, 20, 100}) {
    for (int mounting = 0; mounting < 3; ++mounting) {
      CAPTURE(n, mounting);
      const auto parts = mounted_chain(n, random.rotation()).cast<float>();
      const Chain<float> tree(parts);
      const Chain<double> exact(parts.cast<double>());
      Workspace<Chain<float>> ws(tree);
      Workspace<Chain<double>, Update::square_root> exact_ws(exact);
      const Inputs inputs(tree);
      const Inputs exact_inputs(exact);
      ImplicitInversion method(tree, inputs);
      ImplicitInversion exact_method(exact, exact_inputs);
      for (int k = 0; k < 5; ++k) {
        const test::RandomState x = test::random_state(exact, 0, random);
        const VectorX<float> q = x.q.cast<float>(), qd = x.qd.cast<float>();
        const auto reference =
            exact_method(forward_dynamics(q.cast<double>().eval(), qd.cast<double>().eval(), exact_ws));
        const auto dynamics = method(forward_dynamics(q, qd, ws));
        REQUIRE(reference.ok());
        REQUIRE(dynamics.ok());
        CHECK(ws.axes().turned());
        CHECK((dynamics.Bhat.cast<double>() - reference.Bhat).norm() < 16 * float_epsilon * reference.Bhat.norm());
      }
    }
  }
}

TEST_CASE("axes turn only where they must")
{
  const auto turned = [](Index n, const Matrix3<double>& R) {
    const Chain<double> tree(mounted_chain(n, R));
    Workspace<Chain<double>> ws(tree);
    test::Random random(2);
    const test::RandomState x = test::random_state(tree, 0, random);
    REQUIRE(forward_dynamics(x.q, x.qd, ws).ok());
    return ws.axes().turned();
  };
  const Matrix3<double> oblique = Eigen::AngleAxisd(0.5, Vector3<double>(1, 2, 3).normalized()).toRotationMatrix();
  const Matrix3<double> upright = Eigen::AngleAxisd(EIGEN_PI / 2, Vector3<double>::UnitX()).toRotationMatrix();
  CHECK(turned(50, oblique));
  CHECK_FALSE(turned(50, upright));
  CHECK_FALSE(turned(3, oblique));
}

}  // namespace test_parallel_axes
