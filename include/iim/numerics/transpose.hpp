// Rows of numbers to columns, a square of registers at a time.
#pragma once

#include <iim/numerics/registers.hpp>
#include <iim/numerics/row.hpp>

#include <cstring>
#include <type_traits>
#include <utility>

namespace iim::detail {

/// side × side numbers, row r at from(r), to columns, column c at to(c): bit by bit of the indices, rows r and r + step
/// exchange lanes.
template <class Scalar, int side, class From, class To>
[[gnu::always_inline]] inline void transpose(From&& from, To&& to)
{
  using Vector = typename VectorOf<Scalar, side>::Type;
  Vector rows[side];
  unrolled<side>([&](auto r) __attribute__((always_inline)) { std::memcpy(&rows[r], from(r), sizeof(Vector)); });
  const auto exchange = [&]<int step, int... k>(std::integral_constant<int, step>,
                                                std::integer_sequence<int, k...>) __attribute__((always_inline)) {
    unrolled<side>([&](auto r) __attribute__((always_inline)) {
      if constexpr ((r & step) == 0) {
        const Vector upper = rows[r], lower = rows[r + step];
        rows[r] = __builtin_shufflevector(upper, lower, ((k & step) == 0 ? k : k - step + side)...);
        rows[r + step] = __builtin_shufflevector(upper, lower, ((k & step) == 0 ? k + step : k + side)...);
      }
    });
  };
  constexpr std::make_integer_sequence<int, side> lane;
  if constexpr (side > 1) { exchange(std::integral_constant<int, 1>{}, lane); }
  if constexpr (side > 2) { exchange(std::integral_constant<int, 2>{}, lane); }
  if constexpr (side > 4) { exchange(std::integral_constant<int, 4>{}, lane); }
  if constexpr (side > 8) { exchange(std::integral_constant<int, 8>{}, lane); }
  static_assert(side <= 16);
  unrolled<side>([&](auto c) __attribute__((always_inline)) { std::memcpy(to(c), &rows[c], sizeof(Vector)); });
}

}  // namespace iim::detail
