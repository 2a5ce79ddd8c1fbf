// This library with several states at once, as a path beside one state after the other.
#pragma once

#include "peers.hpp"

#include <memory>
#include <vector>

namespace peers {

/// Every state's q̈₀ and B̂ as matrices of its own, a register of states at a time. `compute` of the first state of a
/// register computes all of them, that of the others nothing: the times of a whole pool are right, and no others.
std::unique_ptr<Peer> several_states(const Model& model, const std::vector<State>& states);

}  // namespace peers
