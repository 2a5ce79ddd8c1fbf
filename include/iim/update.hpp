// How the O(n) pass reduces inertias: a choice at compile time.
#pragma once

namespace iim {

/// How M̄* is reduced from a subsystem to its parent: the same mathematics, different errors and cost.
enum class Update {
  printed,      ///< A' = A − U W, as (14) and (16) have it: the error grows with the length of the chain
  projected,    ///< A' as a sum of congruences Σ P_bᵀ I_b P_b: a few roundings whatever the length
  square_root,  ///< N with A = NᵀN in place of A: a few roundings whatever the length and the ratio of masses
};

}  // namespace iim
