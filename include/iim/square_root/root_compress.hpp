// Rows of the square-root form to at most six with the same NᵀN: QR with pivoted columns, by the reflections of
// root_rows.hpp.
#pragma once

#include <iim/numerics/registers.hpp>
#include <iim/square_root/root_rows.hpp>
#include <iim/square_root/row_tape.hpp>
#include <iim/square_root/rows_abreast.hpp>

#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cstddef>
#include <tuple>
#include <utility>

namespace iim::detail {

/// Σ n² by column.
template <class Scalar, int most, int columns>
std::array<Scalar, Reflection<Scalar, columns>::padded> squares(const RootRows<Scalar, most, columns>& rows)
{
  constexpr std::size_t padded = Reflection<Scalar, columns>::padded;
  std::array<RowsPart<Scalar>, padded> sum;
  unrolled<static_cast<int>(padded)>([&](auto c) __attribute__((always_inline)) { sum[c] = no_rows<Scalar>(); });
#pragma GCC unroll 1
  for (Eigen::Index r = 0; r < rows.count; r += rows.lanes) {
    unrolled<columns>([&](auto c) __attribute__((always_inline)) {
      const RowsPart<Scalar> n = rows_at(rows.at(c, r));
      sum[c] += n * n;
    });
  }
  std::array<Scalar, padded> result;
  sum_rows_by_eight(sum, result.data());
  return result;
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

/// Takes the rows to at most `rank` ≤ steps with the same NᵀN and Nᵀz: QR with pivoted columns. Row k of the result is
/// zero in the columns pivot[0] … pivot[k − 1]. Returns how many rows. On the tape they are from `out` on.
template <int steps, class Scalar, int most>
int compress(RootRows<Scalar, most>& rows, std::array<RootRow<Scalar>, static_cast<std::size_t>(steps)>& result,
             std::array<int, static_cast<std::size_t>(steps)>& pivot, int rank = steps, RowTape<Scalar>* tape = nullptr,
             Eigen::Index out = 0)
{
  rank = static_cast<int>(std::min<Eigen::Index>(std::min(rank, steps), rows.count));
  // The next column by what Pythagoras leaves of each, which is there before the rows are; by the rows if that is
  // roundings.
  const auto of_rows = [&] { return RootRow<Scalar>(Eigen::Map<const RootRow<Scalar>>(squares(rows).data())); };
  RootRow<Scalar> square = of_rows();
  auto [column, most_left] = largest_of_six(square);
  Scalar doubtful = Scalar(4096) * Eigen::NumTraits<Scalar>::epsilon() * most_left;
  using Sums = ColumnSums<Scalar, most, 8>;
  Reflection<Scalar, 8> reflection;
  const auto keep = [&](int k) {
    pivot[static_cast<std::size_t>(k)] = reflection.x;
    result[static_cast<std::size_t>(k)] = reflection.row();
    square -= reflection.row() * reflection.row();
    square(reflection.x) = Scalar(0);
  };
  if (rank == 0 || !find_reflection<true>(rows, column, reflection, tape, out)) { return 0; }
  keep(0);
  for (int k = 1; k < rank; ++k) {
    std::tie(column, most_left) = largest_of_six(square);
    bool found;
    if (most_left > doubtful) [[likely]] {
      Sums sums;
      reflect(rows, reflection, [&, x = column](const auto& n, Eigen::Index r) __attribute__((always_inline)) {
        sums.add(n, rows_at(rows.at(x, r)), r);
      });
      found = conclude<true>(sums, rows, column, reflection, tape, out + k);
    } else {
      reflect(rows, reflection, [](const auto&, Eigen::Index) {});
      square = of_rows();
      std::tie(column, most_left) = largest_of_six(square);
      doubtful = Scalar(4096) * Eigen::NumTraits<Scalar>::epsilon() * most_left;
      found = find_reflection<true>(rows, column, reflection, tape, out + k);
    }
    if (!found) { return k; }  // what is left is zero
    keep(k);
  }
  return rank;
}

/// The same in one function for all subsystems.
template <int steps, class Scalar, int most>
[[gnu::noinline]] int compress_apart(RootRows<Scalar, most>& rows,
                                     std::array<RootRow<Scalar>, static_cast<std::size_t>(steps)>& result,
                                     std::array<int, static_cast<std::size_t>(steps)>& pivot, int rank,
                                     RowTape<Scalar>* tape, Eigen::Index out)
{
  return in_one_function<Scalar>([&] { return compress<steps>(rows, result, pivot, rank, tape, out); });
}

}  // namespace iim::detail
