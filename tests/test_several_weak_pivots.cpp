// PROGRAM: tests_several
// Several states of robots whose joints often feel small inertias: chains of boxes and of thin rods, some joints about
// the links. Small pivots are mended for all lanes together, and what comes back agrees with the single-state path.
#include "several_states.hpp"
#include "worst.hpp"

#include <algorithm>
#include <limits>
#include <string>
#include <vector>

using namespace iim;

namespace {

/// A box of uniform density, `length` along z from its joint.
RevoluteLink<double> box(const Vector3<double>& axis, double mass, double width, double length)
{
  RevoluteLink<double> link;
  link.joint.axis = axis;
  link.body.mass = mass;
  link.body.com.z() = length / 2;
  const double across = mass / 12 * (width * width + length * length);
  link.body.inertia.diagonal() << across, across, mass / 6 * width * width;
  return link;
}

StandardAssembly<double> chain_of(const std::vector<RevoluteLink<double>>& links, double length,
                                  const Matrix3<double>& R = Matrix3<double>::Identity())
{
  StandardAssembly<double> assembly;
  for (std::size_t i = 0; i < links.size(); ++i) {
    Attachment<double> on{.R = R};
    if (i > 0) {
      on.R.setIdentity();
      on.parent = "link" + std::to_string(i - 1);
      on.p.z() = length;
    }
    assembly.add("link" + std::to_string(i), on, links[i]);
  }
  return assembly;
}

/// B̂ of each state against the single-state path's, in ε. (q̈₀ of such chains is as uncertain as what holds them up.)
double worst(const StandardAssembly<double>& assembly, test::Random& draw)
{
  const DynamicTree tree(assembly);
  const Inputs inputs(tree);
  SeveralStates several(assembly, inputs);
  Workspace ws(tree);
  ImplicitInversion method(tree, inputs);
  const Index count = 19, n = tree.n_v(), m = inputs.columns();
  const test::States<double> states(tree, m, count, draw);
  MatrixX<double> qdd0(n, count), Bhat(n * m, count);
  std::vector<Outcome> outcomes(static_cast<std::size_t>(count));
  REQUIRE(several.evaluate(states.q, states.qd, qdd0, Bhat, outcomes) == 0);
  double error = 0;
  for (Index k = 0; k < count; ++k) {
    const auto one = method(VectorX<double>(states.q.col(k)), VectorX<double>(states.qd.col(k)), ws);
    REQUIRE(one.ok());
    const Eigen::Map<const MatrixX<double>> ours(Bhat.col(k).data(), n, m);
    test::keep_worst(error, (ours - one.Bhat).norm() / one.Bhat.norm());
  }
  return error / std::numeric_limits<double>::epsilon();
}

}  // namespace

TEST_CASE("several states of chains of boxes and of thin rods", "[several]")
{
  test::Random draw(3);
  for (int robot = 0; robot < 12; ++robot) {
    const double width = robot % 2 == 0 ? 0.1 : 0.01;
    CAPTURE(robot, width);
    std::vector<RevoluteLink<double>> links;
    for (int i = 0; i < 8 + robot; ++i) {
      links.push_back(box(Vector3<double>::Unit(draw.below(3)), draw.uniform(0.5, 3), width, 0.3));
    }
    CHECK(worst(chain_of(links, 0.3), draw) < 32);  // without mending up to 100
  }
}

// Inertias of frames share places, but for those that small pivots need: whether a pass finds them there, does the loop
// again, or has given them up since, its numbers are the same.
TEST_CASE("passes of several states do not depend on those before", "[several]")
{
  std::vector<RevoluteLink<double>> links;
  for (const int axis : {2, 2, 1, 2, 1}) {
    links.push_back(box(Vector3<double>::Unit(axis), links.empty() ? 3 : 1, 0.1, 0.3));
  }
  test::Random draw(8);
  const StandardAssembly<double> assembly = chain_of(links, 0.3, draw.rotation());
  const DynamicTree tree(assembly);
  Inputs inputs(tree);
  inputs.add_force("link4", Vector3<double>(0, 0, 0.3));
  const Index n = tree.n_v(), m = inputs.columns(), count = SeveralStates(assembly, inputs).lanes;
  struct Pack {
    MatrixX<double> q, qdd0, Bhat, qdd;
  };
  const MatrixX<double> qd = MatrixX<double>::Random(n, count), u = MatrixX<double>::Random(m, count);
  std::vector<Outcome> outcomes(static_cast<std::size_t>(count));
  const auto compute = [&](auto& several, const MatrixX<double>& q, bool with_u) {
    Pack pack{q, MatrixX<double>(n, count), MatrixX<double>(n * m, count), MatrixX<double>::Zero(n, count)};
    REQUIRE(several.evaluate(q, qd, pack.qdd0, pack.Bhat, outcomes) == 0);
    if (with_u) { REQUIRE(several.accelerations(q, qd, u, pack.qdd, outcomes) == 0); }
    return pack;
  };
  const auto check_same = [](const Pack& a, const Pack& b) {
    REQUIRE((a.qdd0.array() == b.qdd0.array()).all());
    REQUIRE((a.Bhat.array() == b.Bhat.array()).all());
    REQUIRE((a.qdd.array() == b.qdd.array()).all());
  };
  // Bent, the first joint feels its own link alone, as the second turns freely about the same axis.
  std::vector<Pack> with_u, without;
  for (const double angle : {1.2, 0.01}) {
    const MatrixX<double> q = angle * (MatrixX<double>::Ones(n, count) + 0.1 * MatrixX<double>::Random(n, count));
    SeveralStates fresh(assembly, inputs);
    without.push_back(compute(fresh, q, false));
    check_same(compute(fresh, q, false), without.back());
    SeveralStates other(assembly, inputs);
    with_u.push_back(compute(other, q, true));
    check_same(compute(other, q, true), with_u.back());
  }
  SeveralStates used(assembly, inputs);
  for (int k = 0; k < 400; ++k) {
    CAPTURE(k);
    const bool u_now = k / 100 % 2 == 1;
    const Pack& expected = (u_now ? with_u : without)[k % 90 < 2 ? 0 : 1];
    check_same(compute(used, expected.q, u_now), expected);
  }
}
