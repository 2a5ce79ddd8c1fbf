// How the cost grows with the number of links and inputs, and what memory it takes: beyond the sizes of the paper's
// study.
#pragma once

#include "../common/statistics.hpp"
#include "../common/table.hpp"

namespace bench {

/// Implicit inversion on scenes of its own, not compared with a reference.
struct CostOfGrowth {
  struct Scene {
    Spread pass;   ///< the O(n) pass alone [µs]
    Spread full;   ///< with B̂ [µs]
    Spread apart;  ///< with B̂ in a call of its own, after the pass [µs]
  };
  Scene chain_50_one, chain_50, chain_63, tree_63, chain_1000;
  double bytes;  ///< of workspace and method, chain of 1000, one input; NaN where the C library does not tell
};

/// Takes the process that it is called in as it is: pinned or not.
CostOfGrowth cost_of_growth(bool quick);

Table cost_table(const CostOfGrowth& cost);

}  // namespace bench
