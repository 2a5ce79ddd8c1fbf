// Rows [N | z | v] of the square-root form (square_root.hpp), and their reduction by an orthogonal Q: Householder's
// reflections, rows sorted by size and columns pivoted.
#pragma once

#include <iim/row_tape.hpp>

#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <tuple>
#include <type_traits>
#include <utility>

namespace iim::detail {

/// Householder's reflection that takes x, ‖x‖² = square > 0, to (α, 0, …); its largest entry should stand first.
/// Turns x[0] into the first entry of the reflection's vector; the others stay. Returns α and 2/‖vector‖².
template <class Scalar>
[[gnu::always_inline]] inline std::pair<Scalar, Scalar> reflector(Scalar* x, const Scalar& square)
{
  using std::sqrt;
  const Scalar norm = sqrt(square);
  const Scalar alpha = x[0] > Scalar(0) ? Scalar(-norm) : norm;
  x[0] -= alpha;
  return {alpha, Scalar(-1) / (alpha * x[0])};
}

/// Place of the largest entry, its sign left aside.
template <class Scalar>
[[gnu::always_inline]] inline int largest(const Scalar* x, int count)
{
  using std::abs;
  int at = 0, next = 1;  // two races, so that no comparison waits for the one before
  Scalar size = abs(x[0]), other = count > 1 ? abs(x[1]) : Scalar(-1);
  for (int r = 2; r < count; r += 2) {
    const Scalar a = abs(x[r]);
    at = a > size ? r : at;
    size = a > size ? a : size;
    const Scalar b = r + 1 < count ? abs(x[r + 1]) : Scalar(-1);
    next = b > other ? r + 1 : next;
    other = b > other ? b : other;
  }
  return other > size ? next : at;
}

/// Rows are worked on four at a time, so that no sum waits for another: rows behind `count` are zero up to the next four.
inline constexpr int abreast = 4;

/// Σ_r rows[r] f(r).
template <class Scalar, class Factor>
[[gnu::always_inline]] inline RootRow<Scalar> weighted_sum(const RootRow<Scalar>* rows, int count, Factor&& factor)
{
  RootRow<Scalar> a = rows[0] * factor(0), b = rows[1] * factor(1), c = rows[2] * factor(2), d = rows[3] * factor(3);
  for (int r = abreast; r < count; r += abreast) {
    a += rows[r] * factor(r);
    b += rows[r + 1] * factor(r + 1);
    c += rows[r + 2] * factor(r + 2);
    d += rows[r + 3] * factor(r + 3);
  }
  return (a + b) + (c + d);
}

/// rows −= w xᵀ. Returns the squares, summed by column.
template <class Scalar, class Factor>
[[gnu::always_inline]] inline RootRow<Scalar> subtract(RootRow<Scalar>* rows, int count, const RootRow<Scalar>& w, Factor&& x)
{
  RootRow<Scalar> a = RootRow<Scalar>::Zero(), b = a, c = a, d = a;
  const auto step = [&](int r, RootRow<Scalar>& sum) __attribute__((always_inline)) {
    const RootRow<Scalar> n = rows[r] - w * x(r);
    rows[r] = n;
    sum += n * n;
  };
  for (int r = 0; r < count; r += abreast) {
    step(r, a);
    step(r + 1, b);
    step(r + 2, c);
    step(r + 3, d);
  }
  return (a + b) + (c + d);
}

/// 1 in one lane. Eight loads from one table of 15, not eight comparisons.
template <class Scalar>
[[gnu::always_inline]] inline RootRow<Scalar> unit_row(int lane)
{
  if constexpr (std::is_floating_point_v<Scalar>) {
    static constexpr std::array<Scalar, 16> table{0, 0, 0, 0, 0, 0, 0, 0, 1};
    return Eigen::Map<const RootRow<Scalar>>(table.data() + 8 - lane);
  } else {
    RootRow<Scalar> unit;
    for (int l = 0; l < 8; ++l) { unit(l) = Scalar(l == lane ? 1 : 0); }
    return unit;
  }
}

/// Σ_k a(k) b(k), k < 6.
template <class Scalar>
[[gnu::always_inline]] inline Scalar dot_of_six(const RootRow<Scalar>& a, const RootRow<Scalar>& b)
{
  return ((a(0) * b(0) + a(1) * b(1)) + (a(2) * b(2) + a(3) * b(3))) + (a(4) * b(4) + a(5) * b(5));
}

/// Size of a row to sort by: ‖n‖₁, a finite number also where n is not, and less than the largest.
template <class Scalar>
[[gnu::always_inline]] inline Scalar size_of(const RootRow<Scalar>& n)
{
  using std::abs;
  const Scalar sum = ((abs(n(0)) + abs(n(1))) + (abs(n(2)) + abs(n(3)))) + (abs(n(4)) + abs(n(5)));
  const Scalar most = Eigen::NumTraits<Scalar>::highest() / Scalar(2);
  return sum < most ? sum : most;
}

/// The largest of the first six lanes: its place and itself, by knock-out.
template <class Scalar>
[[gnu::always_inline]] inline std::pair<int, Scalar> largest_of_six(const RootRow<Scalar>& x)
{
  const int a = x(1) > x(0) ? 1 : 0;
  const int b = x(3) > x(2) ? 3 : 2;
  const int c = x(5) > x(4) ? 5 : 4;
  const Scalar xa = x(1) > x(0) ? x(1) : x(0);
  const Scalar xb = x(3) > x(2) ? x(3) : x(2);
  const Scalar xc = x(5) > x(4) ? x(5) : x(4);
  const int d = xb > xa ? b : a;
  const Scalar xd = xb > xa ? xb : xa;
  return {xc > xd ? c : d, xc > xd ? xc : xd};
}

/// A row's size and its number r < most in one, so that no two are alike: the number stands in the last bits, and of rows
/// whose sizes agree in all others, the first counts as the larger. Normal numbers, since -ffast-math takes others for zero.
template <std::size_t most, class Scalar>
[[gnu::always_inline]] inline Scalar numbered(const Scalar& size, std::size_t r)
{
  if constexpr (std::is_same_v<Scalar, double> || std::is_same_v<Scalar, float>) {
    using Bits = std::conditional_t<sizeof(Scalar) == 8, std::uint64_t, std::uint32_t>;
    const Bits bits = std::bit_cast<Bits>(size + std::numeric_limits<Scalar>::min());
    return std::bit_cast<Scalar>((bits | Bits(std::bit_ceil(most) - 1)) ^ static_cast<Bits>(r));
  } else {
    return size;
  }
}

/// Order of the rows by size, largest first. Counts instead of swapping: no branch to guess.
template <std::size_t most, class Scalar>
[[gnu::always_inline]] inline void sort_rows(const RootRow<Scalar>* stack, int count, RootRow<Scalar>* sorted,
                                             RowTape<Scalar>* tape)
{
  constexpr std::size_t padded = (most + 7) / 8 * 8;
  constexpr bool is_numbered = std::is_same_v<Scalar, double> || std::is_same_v<Scalar, float>;
  std::array<Scalar, padded> size;
  using Count = std::conditional_t<sizeof(Scalar) == 8, std::int64_t, std::int32_t>;
  std::array<Count, padded> place;
  const auto rows = static_cast<std::size_t>(count);
  const std::size_t end = (rows + 7) / 8 * 8;
  for (std::size_t r = 0; r < rows; ++r) { size[r] = numbered<padded>(size_of(stack[r]), r); }
  for (std::size_t r = rows; r < end; ++r) { size[r] = Scalar(-1); }
  for (std::size_t l = 0; l < end; ++l) { place[l] = 0; }
  for (std::size_t r = 0; r < rows; ++r) {
    const Scalar other = size[r];
    for (std::size_t l = 0; l < end; ++l) {
      if constexpr (is_numbered) {
        place[l] -= other > size[l] ? Count(-1) : Count(0);
      } else {
        place[l] += static_cast<int>(other > size[l]) | (static_cast<int>(other == size[l]) & static_cast<int>(r < l));
      }
    }
  }
  for (std::size_t r = 0; r < rows; ++r) { sorted[place[r]] = stack[r]; }
  if (tape != nullptr) [[unlikely]] { tape->sort(place.data(), count); }
}

/// Q of square_root.hpp where v is one column, in the last lane of the rows: rows[0] becomes [N₁ | z₁ | T], the others
/// [N' | z' | 0]. Changes up to `abreast` rows behind them.
template <class Scalar>
[[gnu::always_inline]] inline void eliminate_along(RootRow<Scalar>* rows, int count, RowTape<Scalar>* tape = nullptr)
{
  using std::abs;
  for (int r = count; r < count + abreast; ++r) { rows[r].setZero(); }
  const auto v = [&](int r) -> const Scalar& { return rows[r](along_S); };
  int even = 0, odd = 1;  // two races, so that no comparison waits for the one before
  Scalar of_even(-1), of_odd(-1);
  const auto race = [&](int r, int& first, Scalar& most) __attribute__((always_inline)) {
    const Scalar size = abs(v(r));
    first = size > most ? r : first;
    most = size > most ? size : most;
  };
#pragma GCC unroll 2
  for (int r = 0; r < count; r += 2) {
    race(r, even, of_even);
    race(r + 1, odd, of_odd);
  }
  const int largest = of_odd > of_even ? odd : even;
  const RootRow<Scalar> sum = weighted_sum(rows, count, v);
  if (!(sum(along_S) > Scalar(0))) { return; }  // v = 0
  const RootRow<Scalar> above = rows[largest];
  rows[largest] = rows[0];
  Scalar top = above(along_S);
  const auto [alpha, factor] = reflector(&top, sum(along_S));
  RootRow<Scalar> w = (sum - above * alpha) * factor;
  w(along_S) = Scalar(1);  // v − 1·v is an exact zero
  if (tape != nullptr) [[unlikely]] {
    tape->reflect(0, count, largest, [&](int r) -> const Scalar& { return r == 0 ? above(along_S) : v(r); }, alpha, factor);
  }
  rows[0] = sum * (Scalar(1) / alpha);  // = above − w top, without its cancellation
  subtract(rows + 1, count - 1, w, [&](int r) -> const Scalar& { return v(r + 1); });
}

/// The same for two rows, the first and another, by a rotation: rows of any two sizes, v = 0 in both left out.
template <class Scalar>
[[gnu::always_inline]] inline void rotate_along(RootRow<Scalar>* rows, int other, RowTape<Scalar>* tape)
{
  RootRow<Scalar>&above = rows[0], &below = rows[other];
  using std::sqrt;
  const Scalar a = above(along_S), b = below(along_S);
  const Scalar square = a * a + b * b;
  if (!(square > Scalar(0))) { return; }
  const Scalar T = sqrt(square), inverse = Scalar(1) / T;
  const Scalar cosine = a * inverse, sine = b * inverse;
  const RootRow<Scalar> n = above;
  above = n * cosine + below * sine;
  below = below * cosine - n * sine;
  above(along_S) = T;
  below(along_S) = Scalar(0);
  if (tape != nullptr) [[unlikely]] { tape->rotate(0, other, cosine, sine); }
}

/// Replaces `count` ≤ most rows by at most `rank` ≤ steps with the same NᵀN and Nᵀz: QR with pivoted columns, rows sorted by size.
/// Row k of the result is zero in the columns pivot[0] … pivot[k − 1]. Returns how many rows.
template <int steps, std::size_t most, class Scalar>
int compress(const RootRow<Scalar>* stack, int count, RootRow<Scalar>* result,
             std::array<int, static_cast<std::size_t>(steps)>& pivot, int rank = steps, RowTape<Scalar>* tape = nullptr)
{
  count = std::min(count, static_cast<int>(most));
  rank = std::min(std::min(rank, steps), count);
  std::array<RootRow<Scalar>, most + abreast> sorted;
  sort_rows<most>(stack, count, sorted.data(), tape);
  for (int r = count; r < count + abreast; ++r) { sorted[static_cast<std::size_t>(r)].setZero(); }
  RootRow<Scalar> square =
      weighted_sum(sorted.data(), count, [&](int r) -> const RootRow<Scalar>& { return sorted[static_cast<std::size_t>(r)]; });
  auto [column, most_left] = largest_of_six(square);
  for (int k = 0; k < rank; ++k) {
    RootRow<Scalar>* rows = sorted.data() + k;
    const int active = count - k;
    const Scalar best = square(column);
    if (!(best > Scalar(0))) { return k; }  // what is left is zero
    pivot[static_cast<std::size_t>(k)] = column;
    const RootRow<Scalar> unit = unit_row<Scalar>(column);
    const auto x = [&, c = column](int r) -> const Scalar& { return rows[r](c); };
    Scalar top = x(0);
    const RootRow<Scalar> above = rows[0];
    const RootRow<Scalar> sum = weighted_sum(rows, active, x);
    const auto [alpha, factor] = reflector(&top, best);
    result[k] = sum * (Scalar(1) / alpha);  // = above − w top, without its cancellation; alpha in its column
    if (tape != nullptr) [[unlikely]] { tape->reflect(k, active, 0, x, alpha, factor); }
    if (k + 1 == rank) { break; }
    // top − above(column) = −alpha. w is 1 in the column, so that x − 1·x leaves an exact zero there.
    const RootRow<Scalar> w = (sum - above * alpha) * factor * (Scalar(1) - unit) + unit;
    // The next column by what Pythagoras leaves of it, which is there before the rows are; by themselves if that is roundings.
    const RootRow<Scalar> left = (square - result[k] * result[k]) * (Scalar(1) - unit);
    const Scalar doubtful = Scalar(64) * Eigen::NumTraits<Scalar>::epsilon() * most_left;
    square = subtract(rows + 1, active - 1, w, [&](int r) -> const Scalar& { return x(r + 1); });
    std::tie(column, most_left) = largest_of_six(left);
    if (!(most_left > doubtful)) { std::tie(column, most_left) = largest_of_six(square); }
  }
  return rank;
}

}  // namespace iim::detail
