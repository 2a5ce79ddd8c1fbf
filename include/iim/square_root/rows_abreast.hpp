// One column's numbers in several rows, in one register (root_rows.hpp).
#pragma once

#include <iim/numerics/registers.hpp>
#include <iim/numerics/row.hpp>

#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <tuple>
#include <type_traits>
#include <utility>

namespace iim::detail {

/// How many rows one register takes.
template <class Scalar>
inline constexpr int rows_abreast = register_lanes<Scalar>;

/// The numbers of one column in so many rows.
template <class Scalar>
using RowsPart = typename PartOf<Scalar, rows_abreast<Scalar>>::Type;

template <class Scalar>
[[gnu::always_inline]] inline RowsPart<Scalar> rows_at(const Scalar* x)
{
  if constexpr (rows_abreast<Scalar> > 1) {
    RowsPart<Scalar> part;
    std::memcpy(&part, x, sizeof part);
    return part;
  } else {
    return *x;
  }
}

template <class Scalar>
[[gnu::always_inline]] inline void put_rows(const RowsPart<Scalar>& part, Scalar* x)
{
  if constexpr (rows_abreast<Scalar> > 1) {
    std::memcpy(x, &part, sizeof part);
  } else {
    *x = part;
  }
}

template <class Scalar>
[[gnu::always_inline]] inline RowsPart<Scalar> no_rows()
{
  if constexpr (rows_abreast<Scalar> > 1) {
    return RowsPart<Scalar>{};
  } else {
    return Scalar(0);
  }
}

template <class Scalar>
[[gnu::always_inline]] inline RowsPart<Scalar> without_signs(const RowsPart<Scalar>& part)
{
  if constexpr (rows_abreast<Scalar> > 1) {
    using Bits = std::conditional_t<sizeof(Scalar) == 8, std::int64_t, std::int32_t>;
    using Integers = typename VectorOf<Bits, rows_abreast<Scalar>>::Type;
    return std::bit_cast<RowsPart<Scalar>>(std::bit_cast<Integers>(part) & std::numeric_limits<Bits>::max());
  } else {
    using std::abs;
    return abs(part);
  }
}

/// Sums over the numbers in each of `count` registers, count a power of two, to sum[0], …: of pairs of registers halves
/// are added until one number of each sum is left.
template <class Scalar, std::size_t count>
[[gnu::always_inline]] inline void sum_rows(const std::array<RowsPart<Scalar>, count>& part, Scalar* sum)
{
  constexpr int lanes = rows_abreast<Scalar>;
  if constexpr (lanes == 1) {
    for (std::size_t k = 0; k < count; ++k) { sum[k] = part[k]; }
  } else {
    // clang-format off
    const auto halved = [&]<int group, class Parts>(auto&& self, std::integral_constant<int, group>, const Parts& parts)
                            __attribute__((always_inline)) {
      if constexpr (group == 1) {
        std::memcpy(sum, &parts, std::min(sizeof parts, count * sizeof(Scalar)));
      } else {
        constexpr std::size_t size = std::tuple_size_v<Parts>, left = size > 1 ? size / 2 : 1;
        constexpr int half = group / 2;
        std::array<RowsPart<Scalar>, left> next;
        [&]<int... i>(std::integer_sequence<int, i...>) __attribute__((always_inline)) {
          unrolled<static_cast<int>(left)>([&](auto k) __attribute__((always_inline)) {
            const RowsPart<Scalar>&a = parts[2 * k < static_cast<int>(size) ? 2 * k : 0],
                  &b = parts[size > 1 ? 2 * k + 1 : 0];
            next[k] = __builtin_shufflevector(a, b, (i / half * group + i % half)...) +
                      __builtin_shufflevector(a, b, (i / half * group + i % half + half)...);
          });
        }(std::make_integer_sequence<int, lanes>{});
        self(self, std::integral_constant<int, half>{}, next);
      }
    };
    // clang-format on
    halved(halved, std::integral_constant<int, lanes>{}, part);
  }
}

/// The same for a multiple of eight.
template <class Part, std::size_t count, class Scalar>
[[gnu::always_inline]] inline void sum_rows_by_eight(const std::array<Part, count>& part, Scalar* sum)
{
  unrolled<static_cast<int>(count) / 8>([&](auto k) __attribute__((always_inline)) {
    std::array<Part, 8> eight;
    unrolled<8>([&](auto c) __attribute__((always_inline)) { eight[c] = part[static_cast<std::size_t>(8 * k + c)]; });
    sum_rows<Scalar, 8>(eight, sum + 8 * k);
  });
}

/// Sum over the numbers in a register.
template <class Scalar>
[[gnu::always_inline]] inline Scalar sum_of_rows(const RowsPart<Scalar>& part)
{
  Scalar sum[1];
  sum_rows<Scalar, 1>({part}, sum);
  return sum[0];
}

}  // namespace iim::detail
