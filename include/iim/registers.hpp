// What keeps numbers in registers where compilers would not.
#pragma once

#include <type_traits>
#include <utility>

namespace iim::detail {

/// f(0), …, f(n − 1), each with its index as a constant. g++ unrolls an outer loop only after it has looked for arrays that
/// could live in registers: what such a loop indexes stays in memory. In `f`: __attribute__((always_inline)).
template <int n, class F>
[[gnu::always_inline]] inline void unrolled(F&& f)
{
  [&]<int... k>(std::integer_sequence<int, k...>) __attribute__((always_inline)) {
    (f(std::integral_constant<int, k>{}), ...);
  }(std::make_integer_sequence<int, n>{});
}

/// Lanes that several products use: g++ would read them from memory again for each (measured: 30 % of the product for B̂).
template <class T>
[[gnu::always_inline]] inline void hold(T& x)
{
  if constexpr (requires { x.hold(); }) { x.hold(); }
}

}  // namespace iim::detail
