// Agreement of the paths with each other, and their times.
#pragma once

#include "../common/statistics.hpp"
#include "peers.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <vector>

namespace peers {

/// One path of one library, wherever it runs.
struct Runner {
  std::function<Result(std::size_t state)> result;
  std::function<double(std::size_t evaluations)> seconds;  ///< round and round through the pool
};

/// Largest relative difference from iim over the states that are compared, Frobenius norm.
struct Difference {
  double qdd0 = 0;
  double Bhat = 0;
  double in_bounds = 0;  ///< largest ratio of a difference to its bound
};

inline Difference difference(const Result& result, const Result& ours, double bound)
{
  const auto relative = [](const auto& a, const auto& b) {
    if (a.rows() != b.rows() || a.cols() != b.cols()) { return std::numeric_limits<double>::infinity(); }
    const double size = b.norm();
    const double x = size > 0 ? (a - b).norm() / size : a.norm();
    return std::isfinite(x) ? x : std::numeric_limits<double>::infinity();
  };
  Difference d{relative(result.qdd0, ours.qdd0), relative(result.Bhat, ours.Bhat)};
  d.in_bounds = std::max(d.qdd0, d.Bhat) / bound;
  return d;
}

inline void accumulate(Difference& worst, const Difference& next)
{
  worst.qdd0 = std::max(worst.qdd0, next.qdd0);
  worst.Bhat = std::max(worst.Bhat, next.Bhat);
  worst.in_bounds = std::max(worst.in_bounds, next.in_bounds);
}

struct Effort {
  double sample = 2e-3;  ///< shortest measurement [s]; in less, cold caches count, most for the fastest
  double budget = 2.0;   ///< time for all measurements of one path [s]
  int rounds = 31;
};

/// Seconds per state of every path. The paths take turns, so that what the machine does meets all of them.
inline std::vector<bench::Spread> measure(std::vector<Runner>& runners, std::size_t states, const Effort& effort)
{
  struct Plan {
    std::size_t evaluations;
    int rounds;
    std::vector<double> samples;
  };
  std::vector<Plan> plans;
  for (Runner& runner : runners) {
    double seconds = runner.seconds(1);
    if (seconds * static_cast<double>(states) < effort.budget / 5) {  // the first one met cold caches
      seconds = runner.seconds(states) / static_cast<double>(states);
    }
    const double pools = std::ceil(effort.sample / (seconds * static_cast<double>(states)));
    Plan plan{states * static_cast<std::size_t>(std::clamp(pools, 1.0, 1e4)), 0, {}};
    const double affordable = effort.budget / (seconds * static_cast<double>(plan.evaluations));
    plan.rounds = static_cast<int>(std::clamp(affordable, 3.0, static_cast<double>(effort.rounds)));
    plans.push_back(plan);
  }
  for (int round = 0; round < effort.rounds; ++round) {
    for (std::size_t j = 0; j < runners.size(); ++j) {
      Plan& plan = plans[j];
      if (round >= plan.rounds) { continue; }
      runners[j].seconds(std::min<std::size_t>(2, states));  // its own data back into the caches
      plan.samples.push_back(runners[j].seconds(plan.evaluations) / static_cast<double>(plan.evaluations));
    }
  }
  std::vector<bench::Spread> result;
  for (const Plan& plan : plans) { result.push_back(bench::spread(plan.samples)); }
  return result;
}

}  // namespace peers
