// PART OF: iim_tables
// REQUIRES: benchmark
// Unit forces: as published, and on the workspace of the O(n) pass.
#include "methods.hpp"

#include <iim/unit_force.hpp>

namespace bench {

std::vector<Method> unit_force_methods()
{
  return {
      {"unit_published",
       "unit forces, published",
       "m+1 complete O(n) passes, (21)",
       {"#D55E00", 4, 1, 1.5},
       make_runner<MethodRunner<iim::UnitForcePublished<Tree<double>>>>},
      {"unit",
       "unit forces, on workspace",
       "on the workspace of one O(n) pass; per input a bias and an acceleration pass, several inputs at once",
       {"#E69F00", 5, 1, 1.5},
       make_runner<MethodRunner<iim::UnitForce<Tree<double>>>>},
  };
}

}  // namespace bench
