// PROGRAM: tests_mechanisms
// The methods agree on subsystems that the library does not have itself.
#include "mechanism.hpp"

#include <iostream>

namespace test_methods_types {

using namespace iim;
using namespace iim::test;

TEST_CASE("the methods agree on a mechanism of three frames")
{
  std::cout << states << " robots from seed " << first_seed << '\n';
  for (std::uint64_t seed = first_seed; seed < first_seed + states; ++seed) {
    CAPTURE(seed);
    Random random(seed);
    const DynamicTree tree(mechanism_robot(random));
    compare<Update::projected>(tree, random);
  }
}

TEST_CASE("the mechanism's bias is the acceleration that its motion has")
{
  // Twist of the arm at the coupling point, differentiated along q̇: S changes, and the point stays with the body for an
  // instant, so that ω × v of it is added.
  for (std::uint64_t seed = first_seed; seed < first_seed + 20; ++seed) {
    CAPTURE(seed);
    Random random(seed);
    const Mechanism m{};
    const Eigen::Vector3d q = random.vector(1), qd = random.vector(1);
    const Eigen::Matrix3d R = random.rotation();
    const auto at = [&](double t, Eigen::Matrix<double, 6, 1>& bias) {
      std::array<Matrix3<double>, 3> turned;
      std::array<Eigen::Vector3d, 3> r;
      std::array<Eigen::Matrix<double, 6, 3>, 3> S;
      std::array<Eigen::Matrix<double, 6, 1>, 3> biases;
      for (auto& s : S) { s.setZero(); }
      std::array<FrameMotion<double, 3>, 3> frames{
          {{turned[0], r[0], S[0], biases[0]}, {turned[1], r[1], S[1], biases[1]}, {turned[2], r[2], S[2], biases[2]}}};
      m.motion(R, q + t * qd, qd, frames);
      bias = biases[1];
      return Eigen::Matrix<double, 6, 1>(S[1] * qd);
    };
    const double t = 1e-5;
    Eigen::Matrix<double, 6, 1> bias, unused;
    const Eigen::Matrix<double, 6, 1> V = at(0, bias);
    Eigen::Matrix<double, 6, 1> rate = (at(t, unused) - at(-t, unused)) / (2 * t);
    rate.head<3>() += V.tail<3>().cross(V.head<3>());
    CHECK((rate - bias).norm() < 1e-9);  // t² and ε/t, both about 1e-10
  }
}

TEST_CASE("M⁻¹ by recursion at one state after another is what it is at each alone")
{
  Random random(first_seed);
  const DynamicTree tree(mechanism_robot(random));
  using Tree = std::remove_const_t<decltype(tree)>;
  const Inputs<Tree> inputs(tree);
  Workspace<Tree> ws(tree);
  RecursiveInverse<Tree> used(tree, inputs);
  for (int k = 0; k < 5; ++k) {
    CAPTURE(k);
    const RandomState state = random_state(tree, inputs.columns(), random);
    const auto fd = forward_dynamics(state.q, state.qd, ws);
    RecursiveInverse<Tree> fresh(tree, inputs);
    const auto again = used(fd), alone = fresh(fd);
    REQUIRE(again.ok());
    CHECK(used.Minv() == fresh.Minv());
    CHECK(again.Bhat == alone.Bhat);
  }
}

}  // namespace test_methods_types
