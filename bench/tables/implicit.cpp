// PART OF: iim_tables
// REQUIRES: benchmark
// The O(n) pass alone, and implicit inversion with each way of reducing M̄*.
#include "methods.hpp"

namespace bench {

std::vector<Method> implicit_methods()
{
  using iim::Update;
  using Iim = iim::ImplicitInversion<Tree<double>>;
  return {
      {floor_of_all,
       "O(n) pass alone",
       "q̈₀ only, projected update: the floor of all methods that start from it",
       {"#999999", 2, 1, 1.5},
       make_runner<PassRunner<Update::projected>>,
       false},
      {product,
       "implicit inversion",
       "Algorithm 1 after the O(n) pass, projected update",
       {"#0072B2", 7, 1, 2.5},
       make_runner<MethodRunner<Iim, Update::projected>>},
      {"iim_printed",
       "implicit inversion, printed",
       "the same, M̄* reduced as (14) and (16) have it",
       {"#56B4E9", 6, 1, 1.5},
       make_runner<MethodRunner<Iim, Update::printed>>},
      {"iim_root",
       "implicit inversion, root",
       "the same, on the square root of M̄*",
       {"#009E73", 9, 1, 1.5},
       make_runner<MethodRunner<Iim, Update::square_root>>},
  };
}

}  // namespace bench
