// All variants in one Scalar; included by one source file per Scalar.
#pragma once

#include "../../tests/worst.hpp"
#include "accuracy.hpp"
#include "frame_conventions.hpp"

#include <iim/global_inverse.hpp>
#include <iim/recursive_inverse.hpp>
#include <iim/unit_force.hpp>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace bench {

/// A scene in one Scalar, shared by whatever evaluates it.
template <class Scalar>
struct AccuracyRobot {
  explicit AccuracyRobot(const AccuracyScene& scene)
      : tree(scene.parts.template cast<Scalar>()), inputs(accuracy_inputs(scene, tree))
  {
    for (const State<double>& x : scene.states) { states.push_back(x.template cast<Scalar>()); }
  }
  AccuracyRobot(const AccuracyRobot&) = delete;
  AccuracyRobot& operator=(const AccuracyRobot&) = delete;

  const Tree<Scalar> tree;
  iim::Inputs<Tree<Scalar>> inputs;
  std::vector<State<Scalar>> states;
};

/// One method on memory of its own. What it returns is good until it is called again.
template <class Scalar>
struct Variant {
  std::string name;
  std::function<iim::AffineDynamics<Scalar>(const State<Scalar>&)> evaluate;
};

template <class Scalar, class Method, iim::Update update>
class OnWorkspace {
public:
  explicit OnWorkspace(const std::shared_ptr<const AccuracyRobot<Scalar>>& robot)
      : robot_(robot), workspace_(robot_->tree), method_(robot_->tree, robot_->inputs)
  {
  }

  iim::AffineDynamics<Scalar> operator()(const State<Scalar>& x)
  {
    using Vector = const iim::VectorX<Scalar>&;
    if constexpr (std::is_invocable_v<Method&, Vector, Vector, iim::Workspace<Tree<Scalar>, update>&>) {
      return method_(x.q, x.qd, workspace_);
    } else {
      return method_(iim::forward_dynamics(x.q, x.qd, workspace_));
    }
  }

private:
  std::shared_ptr<const AccuracyRobot<Scalar>> robot_;
  iim::Workspace<Tree<Scalar>, update> workspace_;
  Method method_;
};

template <class Scalar, Frames frames, iim::Update update>
class InFrames {
public:
  explicit InFrames(const std::shared_ptr<const AccuracyRobot<Scalar>>& robot)
      : robot_(robot), method_(robot_->tree, robot_->inputs)
  {
  }

  iim::AffineDynamics<Scalar> operator()(const State<Scalar>& x) { return method_(x.q, x.qd); }

private:
  std::shared_ptr<const AccuracyRobot<Scalar>> robot_;
  FrameConvention<Scalar, frames, update> method_;
};

/// Adds what one result is off by at one state.
template <class Scalar>
void measure(const iim::AffineDynamics<Scalar>& result, const Reference& exact, const Yardstick& y, Outcome& outcome)
{
  const double epsilon = std::ldexp(1.0, 1 - std::numeric_limits<Scalar>::digits);
  const double epsilons = epsilon / std::numeric_limits<double>::epsilon();
  const double Bhat_error = relative_error(result.Bhat, exact.Bhat);
  const double qdd0_error = relative_error(result.qdd0, exact.qdd0);
  outcome.Bhat_error = std::max(outcome.Bhat_error, Bhat_error);
  outcome.qdd0_error = std::max(outcome.qdd0_error, qdd0_error);
  outcome.Bhat_excess = std::max(outcome.Bhat_excess, Bhat_error / (epsilons * y.Bhat_sensitivity));
  outcome.qdd0_excess = std::max(outcome.qdd0_excess, qdd0_error / (epsilons * y.qdd0_sensitivity));
  const auto wrong = [&](double error, double sensitivity) {
    return !(error <= 1e-2) && epsilons * sensitivity < 1e-4;
  };
  outcome.silent += wrong(Bhat_error, y.Bhat_sensitivity) || wrong(qdd0_error, y.qdd0_sensitivity) ? 1 : 0;
  for (Index j = 0; j < result.Bhat.cols(); ++j) {
    for (Index i = 0; i < result.Bhat.rows(); ++i) {
      const long double d =
          (static_cast<long double>(result.Bhat(i, j)) - exact.Bhat.high(i, j)) - exact.Bhat.low(i, j);
      const double scaled = static_cast<double>(std::abs(d) / y.row(i) / y.column(j));
      iim::test::keep_worst(outcome.componentwise, scaled);
    }
  }
  // The worst of at most 64 columns.
  const long double size = y.M.cwiseAbs().colwise().sum().maxCoeff();
  const Index step = 1 + (result.Bhat.cols() - 1) / 64;
  for (Index j = 0; j < result.Bhat.cols(); j += step) {
    const Eigen::Matrix<long double, Eigen::Dynamic, 1> x = result.Bhat.col(j).template cast<long double>();
    const long double left = (y.M * x - y.B.col(j)).cwiseAbs().sum();
    const double scaled = static_cast<double>(left / (size * x.cwiseAbs().sum() * epsilon));
    iim::test::keep_worst(outcome.residual, scaled);
  }
}

/// Worst errors over the scene's states.
template <class Scalar>
Outcome outcome_of(const Variant<Scalar>& variant, const char* scalar, const std::vector<State<Scalar>>& states,
                   const AccuracyReference& reference)
{
  Outcome outcome{variant.name, scalar};
  for (std::size_t k = 0; k < states.size(); ++k) {
    const auto result = variant.evaluate(states[k]);
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
      const bool holds_it = std::numeric_limits<Scalar>::max_exponent > std::numeric_limits<double>::max_exponent;
      outcome.silent += exists && holds_it ? 0 : 1;
    }
  }
  return outcome;
}

/// Every method × frame convention × update.
template <class Scalar>
std::vector<Variant<Scalar>> accuracy_variants(const std::shared_ptr<const AccuracyRobot<Scalar>>& robot)
{
  using iim::Update;
  using TreeType = Tree<Scalar>;
  std::vector<Variant<Scalar>> variants;
  const auto add = [&]<class Memory>(const std::string& name) {
    variants.push_back({name, [own = std::make_shared<Memory>(robot)](const State<Scalar>& x) { return (*own)(x); }});
  };
  const auto on_workspace = [&]<class Method, Update update>(const std::string& name) {
    add.template operator()<OnWorkspace<Scalar, Method, update>>(name);
  };
  const auto every_update = [&]<class Method>(const std::string& name) {
    on_workspace.template operator()<Method, Update::printed>(name + ", printed");
    on_workspace.template operator()<Method, Update::projected>(name + ", projected");
    on_workspace.template operator()<Method, Update::square_root>(name + ", square root");
  };
  const auto in_frames = [&]<Frames frames>(const std::string& name) {
    add.template operator()<InFrames<Scalar, frames, Update::printed>>(name + ", printed");
    add.template operator()<InFrames<Scalar, frames, Update::projected>>(name + ", projected");
    add.template operator()<InFrames<Scalar, frames, Update::square_root>>(name + ", square root");
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
  return variants;
}

template <class Scalar>
std::vector<Outcome> outcomes_in(const char* scalar, const AccuracyScene& scene, const AccuracyReference& reference)
{
  std::vector<Outcome> outcomes;
  try {
    const auto robot = std::make_shared<const AccuracyRobot<Scalar>>(scene);
    for (const Variant<Scalar>& variant : accuracy_variants<Scalar>(robot)) {
      outcomes.push_back(outcome_of<Scalar>(variant, scalar, robot->states, reference));
    }
  } catch (const iim::ModelError&) {
    // A mass of 10³⁰⁰ kg is no float: the tree says so when it is built.
    Outcome outcome{"all", scalar};
    outcome.refused = static_cast<int>(scene.states.size());
    outcome.status = "model refused";
    outcomes.push_back(outcome);
  }
  return outcomes;
}

template <class Scalar>
std::vector<Pass> passes_in(const char* scalar, const AccuracyScene& scene)
{
  std::vector<Pass> passes;
  const auto robot = std::make_shared<const AccuracyRobot<Scalar>>(scene);
  for (const Variant<Scalar>& variant : accuracy_variants<Scalar>(robot)) {
    passes.push_back({variant.name, scalar, scene.states.size(), [variant, robot] {
                        for (const State<Scalar>& x : robot->states) {
                          const auto result = variant.evaluate(x);
                          asm volatile("" : : "r"(result.Bhat.data()), "r"(result.qdd0.data()) : "memory");
                        }
                      }});
  }
  return passes;
}

}  // namespace bench
