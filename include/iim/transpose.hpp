// Rows of numbers to columns, a square of registers at a time.
#pragma once

#include <iim/registers.hpp>

#include <cstring>
#include <type_traits>
#include <utility>

namespace iim::detail {

/// side × side numbers, row r at from(r) and times scale(r), to columns, column c at to(c): bit by bit of the indices, rows
/// r and r + step exchange lanes.
template <class Scalar, int side, class From, class Scale, class To>
[[gnu::always_inline]] inline void transpose(From&& from, Scale&& scale, To&& to)
{
  using Vector [[gnu::vector_size(side * sizeof(Scalar))]] = Scalar;
  Vector rows[side];
  unrolled<side>([&](auto r) __attribute__((always_inline)) {
    std::memcpy(&rows[r], from(r), sizeof(Vector));
    rows[r] *= scale(r);
  });
  const auto exchange = [&]<int step, int... k>(std::integral_constant<int, step>, std::integer_sequence<int, k...>) {
    for (int r = 0; r < side; ++r) {
      if ((r & step) != 0) { continue; }
      const Vector upper = rows[r], lower = rows[r + step];
      rows[r] = __builtin_shufflevector(upper, lower, ((k & step) == 0 ? k : k - step + side)...);
      rows[r + step] = __builtin_shufflevector(upper, lower, ((k & step) == 0 ? k + step : k + side)...);
    }
  };
  constexpr std::make_integer_sequence<int, side> lane;
  if constexpr (side > 1) { exchange(std::integral_constant<int, 1>{}, lane); }
  if constexpr (side > 2) { exchange(std::integral_constant<int, 2>{}, lane); }
  if constexpr (side > 4) { exchange(std::integral_constant<int, 4>{}, lane); }
  unrolled<side>([&](auto r) __attribute__((always_inline)) { std::memcpy(to(r), &rows[r], sizeof(Vector)); });
}

}  // namespace iim::detail
