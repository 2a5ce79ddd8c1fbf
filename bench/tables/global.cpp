// PART OF: iim_tables
// REQUIRES: benchmark
// The global mass matrix inverted: by Cholesky, dense and branch-sparse, and recursively.
#include "methods.hpp"

#include <iim/global_inverse.hpp>
#include <iim/recursive_inverse.hpp>

namespace bench {

std::vector<Method> global_methods()
{
  using iim::Factorization;
  return {
      // the factors lose digits with the chain's length: seven at 1000 links
      {"global_dense",
       "global inverse, dense",
       "M by composites, h by recursion, dense Cholesky; no O(n) pass",
       {"#000000", 1, 1, 1.5},
       make_runner<MethodRunner<iim::GlobalInverse<Tree<double>, Factorization::dense>>>,
       true,
       1e-8},
      {"global_sparse",
       "global inverse, branch-sparse",
       "the same with a Cholesky that skips the zeros of branching",
       {"#000000", 8, 2, 1.5},
       make_runner<MethodRunner<iim::GlobalInverse<Tree<double>, Factorization::branch_sparse>>>,
       true,
       1e-8},
      {"recursive",
       "recursive inverse",
       "M⁻¹ recursively on the workspace of the O(n) pass (the paper's [15]), times B",
       {"#CC79A7", 13, 1, 1.5},
       make_runner<MethodRunner<iim::RecursiveInverse<Tree<double>>>>},
  };
}

}  // namespace bench
