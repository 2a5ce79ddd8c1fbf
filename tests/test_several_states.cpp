// PROGRAM: tests_several
// Several states at once in double: random robots, every remainder of a pack.
#include "several_states.hpp"

#include <iim/models.hpp>

#include <string>
#include <vector>

namespace test_several_states {

TEST_CASE("several states in double agree with each by itself", "[several]")
{
  iim::test::check_random_robots<double>(1, 60);
}

TEST_CASE("several states of a robot with a link placed by a quarter turn, computed and not exact", "[several]")
{
  using namespace iim;
  const auto check = []<class T>(T) {
    StandardAssembly<T> assembly;
    assembly.add("a", {}, models::link<T>());
    const Matrix3<T> turn = Eigen::AngleAxis<T>(T(EIGEN_PI / 2), Vector3<T>::UnitX()).toRotationMatrix();
    assembly.add("b", {"a", turn, Vector3<T>::UnitZ()}, models::link<T>());
    const DynamicTree tree(assembly);
    const Inputs inputs(tree);
    SeveralStates several(assembly, inputs);
    const MatrixX<T> q = MatrixX<T>::Constant(2, 3, T(0.3));
    MatrixX<T> qdd(2, 3);
    std::vector<Outcome> outcomes(3);
    CHECK(several.accelerations(q, q, q, qdd, outcomes) == 0);
  };
  check(1.0);
  check(1.0F);
}

TEST_CASE("states by row, by column, as blocks and transposed are the same states", "[several]")
{
  using T = double;
  using RowMajor = Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const auto assembly = iim::models::chain<T>(11);
  const iim::DynamicTree tree(assembly);
  const iim::Inputs inputs(tree);
  iim::SeveralStates several(assembly, inputs);
  constexpr iim::Index count = 19;
  iim::test::Random random(7);
  const iim::test::States<T> states(tree, inputs.columns(), count, random);
  std::vector<iim::Outcome> outcomes(count);
  iim::MatrixX<T> expected(tree.n_v(), count), qdd(tree.n_v(), count);
  REQUIRE(several.accelerations(states.q, states.qd, states.u, expected, outcomes) == 0);
  const auto check = [&](const auto& q, const auto& qd, const auto& u) {
    qdd.setZero();
    CHECK(several.accelerations(q, qd, u, qdd, outcomes) == 0);
    CHECK(qdd == expected);
  };
  // Results go to columns of a matrix of the caller's, too.
  iim::MatrixX<T> into = iim::MatrixX<T>::Zero(tree.n_v() + 3, count + 2);
  auto part = into.block(1, 1, tree.n_v(), count);
  CHECK(several.accelerations(states.q, states.qd, states.u, part, outcomes) == 0);
  CHECK(part == expected);
  CHECK(into.row(0).isZero(0));
  CHECK(into.bottomRows(2).isZero(0));
  check(RowMajor(states.q), RowMajor(states.qd), RowMajor(states.u));
  const iim::MatrixX<T> by_state = states.q.transpose();
  check(by_state.transpose(), states.qd, states.u);
  iim::MatrixX<T> all(3 * 11 + 2, count);
  all << states.q, states.qd, iim::MatrixX<T>::Ones(2, count), states.u;
  check(all.topRows(11), all.middleRows(11, 11), all.bottomRows(11));
  check(states.q + 0 * states.qd, states.qd * 1, states.u);
}

namespace {

/// A free base 10⁻⁶ times as heavy as the links of its limbs, whose first joints turn about one axis but for `off`.
iim::StandardAssembly<double> light_base(double off, iim::test::Random& draw)
{
  using namespace iim;
  StandardAssembly<double> assembly;
  Body<double> light = draw.body();
  light.mass *= 1e-6;
  light.inertia *= 1e-6;
  assembly.add("base", {}, FloatingBase<double>{light});
  const test::Vec3 axis = draw.unit();
  for (const char* limb : {"left", "right"}) {
    const test::Vec3 at_base = draw.uniform(-1, 1) * axis + draw.vector(off);
    assembly.add(limb, {"base", test::Mat3::Identity(), at_base}, RevoluteLink<double>{{axis}, draw.body()});
    const test::Vec3 at = draw.vector(0.5), other = draw.unit();
    assembly.add(std::string(limb) + " hand", {limb, test::Mat3::Identity(), at},
                 RevoluteLink<double>{{other}, draw.body()});
  }
  return assembly;
}

void check_light_base(double off, double limit)
{
  iim::test::Random draw(11);
  const auto assembly = light_base(off, draw);
  const iim::test::Tree<double> tree(assembly);
  const iim::Inputs<iim::test::Tree<double>> inputs(tree);
  iim::SeveralStates several(assembly, inputs);
  const iim::test::States<double> states(tree, inputs.columns(), 3 * several.lanes + 1, draw);
  iim::test::check_agreement(inputs, several, states, limit);
}

}  // namespace

TEST_CASE("a base far lighter than its limbs, two of which turn nearly about one axis, is computed state by state",
          "[several]")
{
  check_light_base(1e-5, 1);  // in lanes B̂ is off by 10⁶ ε
}

TEST_CASE("a base far lighter than its limbs, two of which turn about one axis, has its digits in lanes, too",
          "[several]")
{
  check_light_base(0, 32);
}

}  // namespace test_several_states
