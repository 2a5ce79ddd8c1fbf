// What keeps numbers in registers where compilers would not.
#pragma once

#include <array>
#include <type_traits>
#include <utility>

namespace iim::detail {

/// f(0), …, f(n − 1), each with its index as a constant. g++ unrolls an outer loop only after it has looked for arrays
/// that could live in registers: what such a loop indexes stays in memory. In `f`: __attribute__((always_inline)).
template <int n, class F>
[[gnu::always_inline]] inline void unrolled(F&& f)
{
  [&]<int... k>(std::integer_sequence<int, k...>) __attribute__((always_inline)) {
    (f(std::integral_constant<int, k>{}), ...);
  }(std::make_integer_sequence<int, n>{});
}

/// f(0), …, f(n − 1), for velocities of a subsystem: six in a loop, which runs as fast and is less to compile (15 kB of
/// a controller), but for lanes (3 % of several states).
template <int n, class Scalar, class F>
[[gnu::always_inline]] inline void for_each_velocity(F&& f)
{
  if constexpr (n > 3 && std::is_floating_point_v<Scalar>) {
#pragma GCC unroll 1
    for (int d = 0; d < n; ++d) { f(d); }
  } else {
    unrolled<n>(f);
  }
}

/// f() as a function of its own with all that it calls inlined, for built-in numbers: g++ stops inlining operations on
/// rows in functions of a certain size. Of multiprecision numbers such a function would take the compiler minutes.
template <class F>
[[gnu::noinline, gnu::flatten]] auto flattened(F&& f)
{
  return f();
}
template <class Scalar, class F>
[[gnu::always_inline]] inline auto in_one_function(F&& f)
{
  if constexpr (std::is_floating_point_v<Scalar>) {
    return flattened(f);
  } else {
    return f();
  }
}

/// Lanes that several products use: g++ would read them from memory again for each (measured: 30 % of the product for
/// B̂).
template <class T>
[[gnu::always_inline]] inline void hold(T& x)
{
  if constexpr (requires { x.hold(); }) { x.hold(); }
}

/// Six components about a point x + r, where they are given about x: of a twist. One product after the other, six
/// multiply-adds instead of nine operations (3 % of the product form's time).
template <class Vector, class Lane>
[[gnu::always_inline]] inline void move_twist(const Vector& r, std::array<Lane, 6>& V)
{
  V[0] += V[4] * r(2);
  V[1] += V[5] * r(0);
  V[2] += V[3] * r(1);
  V[0] -= V[5] * r(1);
  V[1] -= V[3] * r(2);
  V[2] -= V[4] * r(0);
}

/// Its transpose: about x of a wrench that is given about x + r.
template <class Vector, class Lane>
[[gnu::always_inline]] inline void move_wrench(const Vector& r, std::array<Lane, 6>& w)
{
  w[3] += w[2] * r(1);
  w[4] += w[0] * r(2);
  w[5] += w[1] * r(0);
  w[3] -= w[1] * r(2);
  w[4] -= w[2] * r(0);
  w[5] -= w[0] * r(1);
}

}  // namespace iim::detail
