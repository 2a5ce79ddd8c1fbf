// What SeveralStates must do: each state gets what the single-state path gives it, to a few ε; statuses exactly.
#pragma once

#include "catch.hpp"
#include "random_tree.hpp"

#include <iim/several_states.hpp>

#include <limits>
#include <type_traits>
#include <vector>

namespace iim::test {

template <class T>
using Tree = decltype(DynamicTree(std::declval<StandardAssembly<T>>()));

/// N states of a robot as matrices.
template <class T>
struct States {
  MatrixX<T> q, qd, u;

  States(const Tree<T>& tree, Index columns, Index count, Random& draw)
      : q(tree.n_q(), count), qd(tree.n_v(), count), u(columns, count)
  {
    for (Index k = 0; k < count; ++k) {
      const RandomState state = random_state(tree, columns, draw);
      q.col(k) = state.q.cast<T>();
      qd.col(k) = state.qd.cast<T>();
      u.col(k) = state.u.cast<T>();
    }
  }
};

/// The single-state path for all of them, and whether `several` says the same: statuses exactly, numbers to `limit` ε.
template <class T>
void check_agreement(const Inputs<Tree<T>>& inputs, SeveralStates<Tree<T>>& several, const States<T>& states,
                     double limit)
{
  const Tree<T>& tree = inputs.tree();
  const Index count = states.q.cols(), n = tree.n_v(), m = inputs.columns();
  const double eps = limit * static_cast<double>(std::numeric_limits<T>::epsilon());
  MatrixX<T> qdd0(n, count), Bhat(n * m, count), qdd(n, count);
  std::vector<Outcome> outcomes(static_cast<std::size_t>(count), {Status::not_finite, 77}), with_u = outcomes;
  const Index failed = several.evaluate(states.q, states.qd, qdd0, Bhat, outcomes);
  const Index failed_with_u = several.accelerations(states.q, states.qd, states.u, qdd, with_u);

  Workspace<Tree<T>> ws(tree);
  ImplicitInversion<Tree<T>> method(tree, inputs);
  Index wrong = 0, wrong_with_u = 0;
  const auto agree = [&](const auto& a, const auto& b) {
    const double size = static_cast<double>(b.norm());
    return static_cast<double>((a - b).norm()) <= eps * size;
  };
  for (Index k = 0; k < count; ++k) {
    INFO("state " << k);
    const VectorX<T> q = states.q.col(k), qd = states.qd.col(k), u = states.u.col(k);
    const AffineDynamics<T> one = method(forward_dynamics(q, qd, ws));
    const std::size_t at = static_cast<std::size_t>(k);
    CHECK(outcomes[at] == Outcome{one.status, one.subsystem});
    const Eigen::Map<const MatrixX<T>> ours(Bhat.col(k).data(), n, m);
    if (one.ok()) {
      CHECK(agree(qdd0.col(k), one.qdd0));
      CHECK(agree(ours, one.Bhat));
    } else {
      ++wrong;
      CHECK(qdd0.col(k).array().isNaN().all());
      CHECK(Bhat.col(k).array().isNaN().all());
    }
    const Acceleration<T> direct = forward_dynamics(q, qd, inputs, u, ws);
    CHECK(with_u[at] == Outcome{direct.status, direct.subsystem});
    if (direct.status == Status::ok) {
      CHECK(agree(qdd.col(k), direct.qdd));
    } else {
      ++wrong_with_u;
      CHECK(qdd.col(k).array().isNaN().all());
    }
  }
  CHECK(failed == wrong);
  CHECK(failed_with_u == wrong_with_u);

  // The two forms with a callable see the same numbers, bit by bit, each state once and in order.
  Index next = 0;
  several.for_each(states.q, states.qd, [&](Index k, const AffineDynamics<T>& dynamics) {
    CHECK(k == next++);
    CHECK(Outcome{dynamics.status, dynamics.subsystem} == outcomes[static_cast<std::size_t>(k)]);
    CHECK((dynamics.ok() ? VectorX<T>(dynamics.qdd0 - qdd0.col(k)).isZero(0) : true));
    CHECK((dynamics.ok() ? VectorX<T>(dynamics.Bhat.reshaped() - Bhat.col(k)).isZero(0) : true));
  });
  CHECK(next == count);
}

/// Condition and length of a robot enter the difference of two orders of rounding: as in test_scalar_float.
inline constexpr double limit = 800;

template <class T>
void check_random_robots(std::uint64_t first, std::uint64_t last)
{
  for (std::uint64_t seed = first; seed <= last; ++seed) {
    INFO("seed " << seed);
    RandomOptions options;
    options.floating_inside = 0.1;
    const RandomRobot random = random_robot(seed, options);
    const StandardAssembly<T> assembly = in<T>(random.assembly);
    const Tree<T> tree(assembly);
    const Inputs<Tree<T>> inputs = make_inputs(tree, random.inputs);
    SeveralStates<Tree<T>> several(assembly, inputs);
    Random draw(seed);
    const Index count = 1 + static_cast<Index>(seed) % (2 * several.lanes + 1);  // 1 … 2N + 1
    check_agreement(inputs, several, States<T>(tree, inputs.columns(), count, draw), limit);
  }
}

}  // namespace iim::test
