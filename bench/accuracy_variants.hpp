// All variants in one Scalar; included by one source file per Scalar.
#pragma once

#include "accuracy.hpp"
#include "frame_conventions.hpp"
#include "statistics.hpp"

#include <iim/global_inverse.hpp>
#include <iim/recursive_inverse.hpp>
#include <iim/unit_force.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

namespace bench {

/// Adds what one result is off by at state k.
template <class Scalar, class ResultType>
void measure(const ResultType& result, const Reference& exact, const Yardstick& y, Outcome& outcome)
{
  const double epsilon = std::ldexp(1.0, 1 - std::numeric_limits<Scalar>::digits);
  const double epsilons = epsilon / std::numeric_limits<double>::epsilon();
  const double Bhat_error = relative_error(result.Bhat, exact.Bhat);
  const double qdd0_error = relative_error(result.qdd0, exact.qdd0);
  outcome.Bhat_error = std::max(outcome.Bhat_error, Bhat_error);
  outcome.qdd0_error = std::max(outcome.qdd0_error, qdd0_error);
  outcome.Bhat_excess = std::max(outcome.Bhat_excess, Bhat_error / (epsilons * y.Bhat_sensitivity));
  outcome.qdd0_excess = std::max(outcome.qdd0_excess, qdd0_error / (epsilons * y.qdd0_sensitivity));
  for (Index j = 0; j < result.Bhat.cols(); ++j) {
    for (Index i = 0; i < result.Bhat.rows(); ++i) {
      const long double d =
          (static_cast<long double>(result.Bhat(i, j)) - exact.Bhat.high(i, j)) - exact.Bhat.low(i, j);
      const double scaled = static_cast<double>(std::abs(d) / y.row(i) / y.column(j));
      // Not std::max: an entry that is not a number must not be passed over.
      outcome.componentwise = scaled <= outcome.componentwise ? outcome.componentwise : scaled;
    }
  }
  // The worst of at most 64 columns.
  const long double size = y.M.cwiseAbs().colwise().sum().maxCoeff();
  const Index step = 1 + (result.Bhat.cols() - 1) / 64;
  for (Index j = 0; j < result.Bhat.cols(); j += step) {
    const Eigen::Matrix<long double, Eigen::Dynamic, 1> x = result.Bhat.col(j).template cast<long double>();
    const long double left = (y.M * x - y.B.col(j)).cwiseAbs().sum();
    const double scaled = static_cast<double>(left / (size * x.cwiseAbs().sum() * epsilon));
    outcome.residual = scaled <= outcome.residual ? outcome.residual : scaled;
  }
}

/// Worst errors over the pool, and the median time of a pass over it. `evaluate`: (q, q̇) to a result.
template <class Scalar, class Evaluate>
Outcome outcome_of(const std::string& variant, const char* scalar, const AccuracyScene& scene,
                   const AccuracyReference& reference, Evaluate&& evaluate)
{
  using Clock = std::chrono::steady_clock;
  Outcome outcome{variant, scalar};
  std::vector<State<Scalar>> states;
  for (const State<double>& x : scene.states) { states.push_back(x.template cast<Scalar>()); }
  for (std::size_t k = 0; k < states.size(); ++k) {
    const auto result = evaluate(states[k].q, states[k].qd);
    if (!result.ok()) {
      if (outcome.refused++ == 0) { outcome.status = iim::to_string(result.status); }
    } else if (k < reference.values.size()) {
      measure<Scalar>(result, reference.values[k], reference.yardsticks[k], outcome);
    } else {
      // A result where there is none, or one that double cannot hold.
      const bool exists = reference.failure == "beyond double";
      outcome.Bhat_error = outcome.qdd0_error =
          exists ? std::numeric_limits<double>::quiet_NaN() : std::numeric_limits<double>::infinity();
      outcome.Bhat_excess = exists ? 0 : outcome.Bhat_error;
    }
  }
  if (scene.timed) {
    std::vector<double> samples;
    for (int repetition = 0; repetition < 31; ++repetition) {
      const auto begin = Clock::now();
      for (const State<Scalar>& x : states) {
        const auto result = evaluate(x.q, x.qd);
        asm volatile("" : : "r"(result.Bhat.data()), "r"(result.qdd0.data()) : "memory");
      }
      samples.push_back(std::chrono::duration<double, std::micro>(Clock::now() - begin).count() /
                        static_cast<double>(states.size()));
    }
    outcome.time = spread(samples).median;
  }
  return outcome;
}

/// Calls run(name, evaluate) for every variant.
template <class Scalar, class Run>
void for_each_variant(const Tree<Scalar>& tree, const iim::Inputs<Tree<Scalar>>& inputs, Run&& run)
{
  using iim::Update;
  using TreeType = Tree<Scalar>;
  const auto on_workspace = [&]<class Method, Update update>(const std::string& name) {
    iim::Workspace<TreeType, update> workspace(tree);
    Method method(tree, inputs);
    run(name, [&](const auto& q, const auto& qd) { return method(iim::forward_dynamics(q, qd, workspace)); });
  };
  const auto every_update = [&]<class Method>(const std::string& name) {
    on_workspace.template operator()<Method, Update::printed>(name + ", printed");
    on_workspace.template operator()<Method, Update::projected>(name + ", projected");
    on_workspace.template operator()<Method, Update::square_root>(name + ", square root");
  };
  const auto in_frames = [&]<Frames frames>(const std::string& name) {
    FrameConvention<Scalar, frames, Update::printed> printed(tree, inputs);
    run(name + ", printed", [&](const auto& q, const auto& qd) { return printed(q, qd); });
    FrameConvention<Scalar, frames, Update::projected> projected(tree, inputs);
    run(name + ", projected", [&](const auto& q, const auto& qd) { return projected(q, qd); });
  };
  every_update.template operator()<iim::ImplicitInversion<TreeType>>("implicit inversion");
  every_update.template operator()<iim::UnitForce<TreeType>>("unit forces");
  every_update.template operator()<iim::RecursiveInverse<TreeType>>("recursive inverse");
  in_frames.template operator()<Frames::body_fixed>("body-fixed frames");
  in_frames.template operator()<Frames::common_origin>("common origin");
  on_workspace.template operator()<iim::GlobalInverse<TreeType, iim::Factorization::branch_sparse>, Update::projected>(
      "branch-sparse Cholesky");
  on_workspace.template operator()<iim::GlobalInverse<TreeType, iim::Factorization::dense>, Update::projected>(
      "dense Cholesky");
}

template <class Scalar>
std::vector<Outcome> outcomes_in(const char* scalar, const AccuracyScene& scene, const AccuracyReference& reference)
{
  std::vector<Outcome> outcomes;
  try {
    const Tree<Scalar> tree(scene.parts.template cast<Scalar>());
    const auto inputs = accuracy_inputs(scene, tree);
    for_each_variant<Scalar>(tree, inputs, [&](const std::string& name, auto&& evaluate) {
      outcomes.push_back(outcome_of<Scalar>(name, scalar, scene, reference, evaluate));
    });
  } catch (const iim::ModelError&) {
    // A mass of 10³⁰⁰ kg is no float: the tree says so when it is built.
    Outcome outcome{"all", scalar};
    outcome.refused = static_cast<int>(scene.states.size());
    outcome.status = "model refused";
    outcomes.push_back(outcome);
  }
  return outcomes;
}

}  // namespace bench
