// The methods under test behind one interface, so that a new one is one line in a list.
#pragma once

#include "pool.hpp"

#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <type_traits>

namespace bench {

/// q̈₀ and B̂; B̂ has no columns if the method does not compute it.
struct Result {
  Eigen::VectorXd qdd0;
  Eigen::MatrixXd Bhat;
};

/// One method on one scene, with memory of its own. Refers to the scene.
class Runner {
public:
  virtual ~Runner() = default;

  /// Evaluates `count` times, state after state of the pool.
  virtual void run(std::int64_t count) = 0;

  /// What it computes at state k of the pool. Throws std::runtime_error if it reports a failure.
  virtual Result at(std::size_t k) = 0;
};

/// How many evaluations take `min_time` [s]. The shortest of a few trials counts: an interruption in a single one would
/// leave too few evaluations for all repetitions.
inline std::int64_t evaluations(Runner& runner, double min_time)
{
  using Clock = std::chrono::steady_clock;
  for (std::int64_t count = 1;; count *= 4) {
    double best = std::numeric_limits<double>::infinity();
    for (int trial = 0; trial < 4; ++trial) {
      const auto begin = Clock::now();
      runner.run(count);
      best = std::min(best, std::chrono::duration<double>(Clock::now() - begin).count());
    }
    if (best > min_time / 16) { return 1 + static_cast<std::int64_t>(static_cast<double>(count) * min_time / best); }
  }
}

/// How a method is drawn.
struct Look {
  const char* colour;  ///< #RRGGBB
  int point;           ///< gnuplot's point type
  int dash = 1;        ///< gnuplot's dash type
  double width = 1.5;
};

struct Method {
  std::string id;    ///< in file names and benchmark names
  std::string name;  ///< in tables and legends
  std::string what;  ///< one sentence
  Look look;
  std::function<std::unique_ptr<Runner>(const Scene<double>&)> make;
  bool gives_Bhat = true;
  double most = 1e-12;  ///< error that roundings explain, of q̈₀ and B̂
};

/// A method of the library on a Workspace with the given update.
///
/// Where a method takes (q, q̇, workspace) or (q, q̇) itself, that call is measured.
template <class MethodType, iim::Update update = iim::Update::projected>
class MethodRunner final : public Runner {
public:
  explicit MethodRunner(const Scene<double>& scene)
      : scene_(&scene), workspace_(scene.tree), method_(scene.tree, scene.inputs)
  {
  }

  void run(std::int64_t count) override
  {
    const std::size_t states = scene_->states.size();
    for (std::size_t k = 0; count > 0; --count, k = k + 1 < states ? k + 1 : 0) {
      const auto result = evaluate(scene_->states[k]);
      benchmark::DoNotOptimize(result.Bhat.data());
      benchmark::DoNotOptimize(result.qdd0.data());
      benchmark::ClobberMemory();
    }
  }

  Result at(std::size_t k) override
  {
    const auto result = evaluate(scene_->states[k]);
    if (!result.ok()) { throw std::runtime_error(std::string("a method says: ") + iim::to_string(result.status)); }
    return {result.qdd0, result.Bhat};
  }

private:
  iim::AffineDynamics<double> evaluate(const State<double>& x)
  {
    if constexpr (std::is_invocable_v<MethodType&, decltype(x.q), decltype(x.qd), decltype(workspace_)&>) {
      return method_(x.q, x.qd, workspace_);
    } else if constexpr (std::is_invocable_v<MethodType&, decltype(x.q), decltype(x.qd)>) {
      return method_(x.q, x.qd);
    } else {
      return method_(iim::forward_dynamics(x.q, x.qd, workspace_));
    }
  }

  const Scene<double>* scene_;
  iim::Workspace<Tree<double>, update> workspace_;
  MethodType method_;
};

/// The O(n) pass and nothing after it: the floor below all methods that start from it.
template <iim::Update update = iim::Update::projected>
class PassRunner final : public Runner {
public:
  explicit PassRunner(const Scene<double>& scene) : scene_(&scene), workspace_(scene.tree) {}

  void run(std::int64_t count) override
  {
    const std::size_t states = scene_->states.size();
    for (std::size_t k = 0; count > 0; --count, k = k + 1 < states ? k + 1 : 0) {
      const State<double>& x = scene_->states[k];
      const auto fd = iim::forward_dynamics(x.q, x.qd, workspace_);
      benchmark::DoNotOptimize(fd.qdd0().data());
      benchmark::ClobberMemory();
    }
  }

  Result at(std::size_t k) override
  {
    const auto fd = iim::forward_dynamics(scene_->states[k].q, scene_->states[k].qd, workspace_);
    if (!fd.ok()) { throw std::runtime_error(std::string("the O(n) pass says: ") + iim::to_string(fd.status())); }
    return {fd.qdd0(), Eigen::MatrixXd(fd.qdd0().size(), 0)};
  }

private:
  const Scene<double>* scene_;
  iim::Workspace<Tree<double>, update> workspace_;
};

template <class RunnerType>
std::unique_ptr<Runner> make_runner(const Scene<double>& scene)
{
  return std::make_unique<RunnerType>(scene);
}

}  // namespace bench
