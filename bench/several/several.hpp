// Measurements of several states at once, a Scalar per translation unit.
#pragma once

#include "../common/statistics.hpp"
#include "../peers/iim.hpp"
#include "../peers/models.hpp"

#include <iim/numerics/lanes.hpp>

#include <string>
#include <utility>
#include <vector>

namespace bench {

/// The models of the comparison: those of iim_peers, in the same numbers.
inline std::vector<peers::Model> several_models()
{
  std::vector<peers::Model> chosen;
  for (const peers::Model& model : peers::models(1)) {
    if (model.name == "biped, both feet" || model.name == "seven-axis arm") { chosen.push_back(model); }
  }
  return chosen;
}

/// Times of one model in one Scalar [s per state].
struct SeveralTimes {
  std::string model;
  std::string scalar;
  int lanes;
  double operations;         ///< of q̈₀ and B̂, per state
  double operations_with_u;  ///< of q̈ under inputs
  Spread single;             ///< q̈₀ and B̂, one state after the other
  Spread packs;              ///< the same, several at once, results in lanes
  Spread matrices;           ///< the same, results as a matrix per state
  Spread single_with_u;      ///< q̈ under inputs, one state after the other
  Spread several_with_u;     ///< the same, several at once
  double worst;              ///< largest relative difference between the two, in ε
};

/// Counted operations per state: q̈₀ and B̂; q̈ under inputs.
std::pair<double, double> operations(const peers::Model& model);

template <class Scalar>
SeveralTimes measure_several(const peers::Model& model, int rounds);

/// Seconds per state and core that `threads` threads, one per core, take for q̈₀ and B̂ of the same states each, results
/// in lanes. A SeveralStates per thread, made by it. With one thread: what the others are compared with.
template <class Scalar>
Spread measure_cores(const peers::Model& model, int threads, int rounds);

/// Cores that this program may use; 1 without an OpenMP.
int usable_cores();

/// Fused multiply-adds per second that the core reaches, times two, on vectors of `Scalar`.
template <class Scalar>
double peak();

}  // namespace bench
