// How the O(n) pass reduces inertias: a choice at compile time.
#pragma once

namespace iim {

/// How M̄* is reduced from a subsystem to its parent: the same mathematics, different errors and cost.
enum class Update {
  printed,      ///< A' = A − U W, as (14) and (16) have it: roundings of W count in full
  projected,    ///< A' = Σ P_kᵀ A_k P_k, congruences, P_k = 1 − S_k W: those of W count to second order
  square_root,  ///< N with A = NᵀN in place of A: a few roundings whatever the ratio of masses, seldom above 100 ε
};

}  // namespace iim
