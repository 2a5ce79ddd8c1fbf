// The variants of the library in one Scalar; included by one source file per Scalar.
#pragma once

#include "accuracy.hpp"
#include "statistics.hpp"

#include <iim/global_inverse.hpp>
#include <iim/recursive_inverse.hpp>
#include <iim/unit_force.hpp>

#include <algorithm>
#include <array>
#include <chrono>
#include <limits>
#include <string>
#include <vector>

namespace bench {

/// Worst errors over the pool, and the median time of a pass over it.
template <class Scalar, class Workspace, class Method, class TreeType>
Outcome outcome_of(const char* variant, const char* scalar, const AccuracyScene& scene,
                   const AccuracyReference& reference, const TreeType& tree, Method method)
{
  using Clock = std::chrono::steady_clock;
  Outcome outcome{variant, scalar};
  Workspace workspace(tree);
  std::vector<State<Scalar>> states;
  for (const State<double>& x : scene.states) { states.push_back(x.template cast<Scalar>()); }
  for (std::size_t k = 0; k < states.size(); ++k) {
    const auto result = method(iim::forward_dynamics(states[k].q, states[k].qd, workspace));
    if (!result.ok()) {
      if (outcome.refused++ == 0) { outcome.status = iim::to_string(result.status); }
      continue;
    }
    if (k < reference.values.size()) {
      outcome.Bhat_error = std::max(outcome.Bhat_error, relative_error(result.Bhat, reference.values[k].Bhat));
      outcome.qdd0_error = std::max(outcome.qdd0_error, relative_error(result.qdd0, reference.values[k].qdd0));
    } else {
      outcome.Bhat_error = outcome.qdd0_error = std::numeric_limits<double>::infinity();  // a result that cannot be
    }
  }
  if (scene.timed) {
    std::vector<double> samples;
    for (int repetition = 0; repetition < 31; ++repetition) {
      const auto begin = Clock::now();
      for (const State<Scalar>& x : states) {
        const auto result = method(iim::forward_dynamics(x.q, x.qd, workspace));
        asm volatile("" : : "r"(result.Bhat.data()), "r"(result.qdd0.data()) : "memory");
      }
      samples.push_back(std::chrono::duration<double, std::micro>(Clock::now() - begin).count() /
                        static_cast<double>(states.size()));
    }
    outcome.time = spread(samples).median;
  }
  return outcome;
}

inline constexpr std::array<const char*, 7> variant_names{"implicit inversion, printed",
                                                          "implicit inversion, projected",
                                                          "implicit inversion, square root",
                                                          "unit forces on the workspace, projected",
                                                          "recursive inverse, projected",
                                                          "global inverse, branch-sparse",
                                                          "global inverse, dense"};

template <class Scalar>
std::vector<Outcome> outcomes_on(const Tree<Scalar>& tree, const char* scalar, const AccuracyScene& scene,
                                 const AccuracyReference& reference)
{
  using iim::Update;
  using TreeType = Tree<Scalar>;
  const auto inputs = accuracy_inputs(scene, tree);
  using Printed = iim::Workspace<TreeType, Update::printed>;
  using Projected = iim::Workspace<TreeType, Update::projected>;
  using SquareRoot = iim::Workspace<TreeType, Update::square_root>;
  std::vector<Outcome> outcomes;
  const auto run = [&]<class W, class M>() {
    const char* name = variant_names[outcomes.size()];
    outcomes.push_back(outcome_of<Scalar, W, M>(name, scalar, scene, reference, tree, M(tree, inputs)));
  };
  using Implicit = iim::ImplicitInversion<TreeType>;
  run.template operator()<Printed, Implicit>();
  run.template operator()<Projected, Implicit>();
  run.template operator()<SquareRoot, Implicit>();
  run.template operator()<Projected, iim::UnitForce<TreeType>>();
  run.template operator()<Projected, iim::RecursiveInverse<TreeType>>();
  run.template operator()<Projected, iim::GlobalInverse<TreeType, iim::Factorization::branch_sparse>>();
  run.template operator()<Projected, iim::GlobalInverse<TreeType, iim::Factorization::dense>>();
  return outcomes;
}

template <class Scalar>
std::vector<Outcome> outcomes_in(const char* scalar, const AccuracyScene& scene, const AccuracyReference& reference)
{
  try {
    const Tree<Scalar> tree(scene.parts.template cast<Scalar>());
    return outcomes_on<Scalar>(tree, scalar, scene, reference);
  } catch (const iim::ModelError&) {
    // A mass of 10³⁰⁰ kg is no float: the tree says so when it is built.
    std::vector<Outcome> outcomes;
    for (const char* name : variant_names) {
      outcomes.push_back({name, scalar, 0, 0, static_cast<int>(scene.states.size()), "model refused"});
    }
    return outcomes;
  }
}

}  // namespace bench
