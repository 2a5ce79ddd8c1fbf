// What a scene costs as a number, without noise.
#pragma once

#include "../bench/common/counted.hpp"

namespace iim::test {

using bench::Counted;

/// Products that f does; most of them are fused with a sum.
template <class F>
long count_products(F&& f)
{
  Counted::done = {};
  f();
  return static_cast<long>(Counted::done.products);
}

}  // namespace iim::test
