// PROGRAM: tests_several
// A subsystem that decides by its state: several states at once are right in every lane, whichever way the lanes go.
#include "catch.hpp"
#include "random_tree.hpp"

#include <iim/several_states.hpp>

#include <limits>
#include <type_traits>
#include <vector>

namespace test_several_branches {

using namespace iim;

namespace {

/// A revolute link against a stop: beyond 0.3 rad a stiff spring pushes back.
template <class T>
struct StoppedLink : RevoluteLink<T> {
  Eigen::Matrix<T, 1, 1> internal_force(const Eigen::Matrix<T, 1, 1>& q, const Eigen::Matrix<T, 1, 1>&) const
  {
    ++asked;
    if (q(0) > T(0.3)) { return Eigen::Matrix<T, 1, 1>(T(1000) * (q(0) - T(0.3))); }
    return Eigen::Matrix<T, 1, 1>(T(0));
  }

  template <class Other>
  StoppedLink<Other> cast() const
  {
    return {RevoluteLink<T>::template cast<Other>()};
  }

  static inline long asked = 0;  ///< evaluations with this Scalar
};
static_assert(Subsystem<StoppedLink<double>>);

using Tree = DynamicTree<StoppedLink<double>>;
using Several = SeveralStates<Tree>;

constexpr int links = 3;

Assembly<StoppedLink<double>> chain()
{
  test::Random draw(3);
  Assembly<StoppedLink<double>> assembly;
  Attachment<double> on;
  for (int k = 0; k < links; ++k) {
    const std::string name = "link" + std::to_string(k);
    assembly.add(name, on, StoppedLink<double>{{{draw.unit()}, draw.body()}});
    on.parent = name;
    on.p = draw.vector(0.5);
  }
  return assembly;
}

/// q̈ of all states at once against one by one. Returns how many states were computed by themselves.
long check(Several& several, const MatrixX<double>& q, const MatrixX<double>& qd, const MatrixX<double>& u)
{
  const Index count = q.cols();
  MatrixX<double> qdd(links, count);
  std::vector<Outcome> outcomes(static_cast<std::size_t>(count));
  const long before = StoppedLink<double>::asked;
  CHECK(several.accelerations(q, qd, u, qdd, outcomes) == 0);
  const long alone = (StoppedLink<double>::asked - before) / links;
  Workspace<Tree> ws(several.tree());
  for (Index k = 0; k < count; ++k) {
    INFO("state " << k);
    const VectorX<double> direct = forward_dynamics(q.col(k), qd.col(k), several.inputs(), u.col(k), ws).qdd;
    // Two orders of rounding, as in test_several_states; a lane on the wrong side of the stop is off by 100 %.
    CHECK((qdd.col(k) - direct).norm() <= 800 * std::numeric_limits<double>::epsilon() * direct.norm());
  }
  Index seen = 0;
  several.for_each(q, qd, [&](Index, const AffineDynamics<double>& dynamics) { seen += dynamics.ok(); });
  CHECK(seen == count);
  return alone;
}

}  // namespace

TEST_CASE("a branch by the state is right in every lane", "[several]")
{
  const auto assembly = chain();
  const Tree tree(assembly);
  const Inputs<Tree> inputs(tree);
  Several several(assembly, inputs);
  constexpr Index lanes = Several::lanes;
  constexpr Index count = 4 * lanes;
  test::Random draw(4);
  const auto random = [&](double low, double high) {
    return MatrixX<double>::NullaryExpr(links, count, [&] { return draw.uniform(low, high); }).eval();
  };
  const MatrixX<double> qd = random(-1, 1), u = random(-1, 1);

  // All before the stop, or all beyond it: no state has to be computed by itself.
  CHECK(check(several, random(-1, 0.29), qd, u) == 0);
  CHECK(check(several, random(0.31, 1), qd, u) == 0);

  // One state beyond it, in each place: its pack, and no other, is computed state by state.
  for (Index at = 0; at < count; ++at) {
    MatrixX<double> q = random(-1, 0.29);
    q(1, at) = 0.5;
    CHECK(check(several, q, qd, u) == lanes);
  }
  // Anyhow.
  for (int round = 0; round < 20; ++round) { check(several, random(-1, 1), qd, u); }
  CHECK(check(several, random(-1, 0.29), qd, u) == 0);  // the mark of the round before is gone
}

}  // namespace test_several_branches
