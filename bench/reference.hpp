// q̈₀ and B̂ in 50 decimal digits: the reference that errors are measured against.
#pragma once

#include "errors.hpp"
#include "pool.hpp"

#include <vector>

namespace bench {

/// q̈₀ and B̂ of a scene at given states, from the scene's numbers in double. Computed by implicit inversion with
/// 50 digits. Throws std::runtime_error if a state cannot be computed.
std::vector<Reference> references(const SceneId& scene, const std::vector<State<double>>& states);

}  // namespace bench
