// q̈₀ and B̂ in 50 decimal digits: the reference that errors are measured against.
#pragma once

#include "errors.hpp"
#include "pool.hpp"

#include <vector>

namespace bench {

/// q̈₀ and B̂ of a scene at given states, from the scene's numbers in double. Computed with 50 digits by implicit
/// inversion and, sharing only the kinematics with it, by the global inverse; throws std::runtime_error if they differ.
std::vector<Reference> references(const SceneId& scene, const std::vector<State<double>>& states);

}  // namespace bench
