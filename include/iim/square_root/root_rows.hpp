// Rows [N | z | v] of the square-root form (square_root.hpp), and their reduction by an orthogonal Q: Householder's
// reflections, each about the row that is largest in the column it takes (which columns: root_compress.hpp). They are
// kept column by column, so that an instruction works on as many rows as a register holds. (With one row in a register
// or two, and rows kept for all frames at once, the pass of the biped of ideal motors took 16 % longer in double and 26
// % in float with AVX-512, 3 and 13 % with AVX2, 41 and 17 % with SSE2.)
#pragma once

#include <iim/numerics/registers.hpp>
#include <iim/numerics/row.hpp>
#include <iim/numerics/triple.hpp>
#include <iim/square_root/row_tape.hpp>
#include <iim/square_root/rows_abreast.hpp>

#include <Eigen/Core>

#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <type_traits>
#include <utility>

namespace iim::detail {

/// One row, where it is worked on by itself.
template <class Scalar>
struct SingleRow {
  TriplePair<Scalar> n;
  Scalar z, v;

  [[gnu::always_inline]] static SingleRow zero()
  {
    const Triple<Scalar> none(Scalar(0), Scalar(0), Scalar(0));
    return {{none, none}, Scalar(0), Scalar(0)};
  }
};

/// Up to `most` rows of [N | z] and further columns. Numbers behind the last row are zero as far as a register goes.
template <class Scalar_, int most_, int columns_ = 8>
struct RootRows {
  using Scalar = Scalar_;
  using Part = RowsPart<Scalar>;
  using Index = Eigen::Index;
  static constexpr int columns = columns_;
  static constexpr int lanes = rows_abreast<Scalar>;
  static constexpr int most = (most_ + lanes - 1) / lanes * lanes;
  static constexpr std::size_t alignment = lanes > 1 ? sizeof(Part) : alignof(Scalar);

  alignas(alignment)
      std::array<std::array<Scalar, static_cast<std::size_t>(most)>, static_cast<std::size_t>(columns)> column;
  Index count = 0;

  Index end() const { return (count + lanes - 1) & -Index(lanes); }  ///< of the last register
  Scalar* at(int c, Index row) { return column[static_cast<std::size_t>(c)].data() + row; }
  const Scalar* at(int c, Index row) const { return column[static_cast<std::size_t>(c)].data() + row; }

  /// Room for more rows, of zeros where a new register begins.
  void open(Index more)
  {
    for (Index row = end(); row < count + more; row += lanes) {
      for (int c = 0; c < columns; ++c) { put_rows<Scalar>(no_rows<Scalar>(), at(c, row)); }
    }
    count += more;
  }
  /// Number by number: loads of registers wait until these have left the core.
  void put_row(Index row, const RootRow<Scalar>& n)
  {
    for (int c = 0; c < 8; ++c) { *at(c, row) = n(c); }
  }
  [[gnu::always_inline]] void put_row(Index row, const SingleRow<Scalar>& n)
  {
#pragma GCC unroll 8
    for (int c = 0; c < 6; ++c) { *at(c, row) = n.n(c); }
    *at(rhs, row) = n.z;
    *at(along_S, row) = n.v;
  }
};

/// The first columns of the rows from row r on that one register takes.
template <std::size_t n, class Scalar, int most, int columns>
[[gnu::always_inline]] inline std::array<RowsPart<Scalar>, n> columns_at(const RootRows<Scalar, most, columns>& rows,
                                                                         Eigen::Index r)
{
  std::array<RowsPart<Scalar>, n> part;
  unrolled<static_cast<int>(n)>([&](auto c) __attribute__((always_inline)) { part[c] = rows_at(rows.at(c, r)); });
  return part;
}

/// Σ |n| over the rows, column by column.
template <class Scalar, int most>
RootRow<Scalar> size_of_columns(const RootRows<Scalar, most>& rows)
{
  RootRow<Scalar> size;
  for (int c = 0; c < 8; ++c) {
    RowsPart<Scalar> sum = no_rows<Scalar>();
    for (Eigen::Index r = 0; r < rows.end(); r += rows.lanes) { sum += without_signs<Scalar>(rows_at(rows.at(c, r))); }
    size(c) = sum_of_rows<Scalar>(sum);
  }
  return size;
}

/// The row in which a column is largest. In a register each number's size and row are one number, the row in the last
/// bits, so that no two are alike.
template <class Scalar, int most>
class LargestRow {
  static constexpr int lanes = rows_abreast<Scalar>;
  static constexpr bool is_numbered = lanes > 1;
  using Bits = std::conditional_t<sizeof(Scalar) == 8, std::int64_t, std::int32_t>;
  using Part = RowsPart<Scalar>;
  static constexpr Bits row_bits = static_cast<Bits>(std::bit_ceil(static_cast<unsigned>(most)) - 1);

public:
  /// Of the rows from `first` on, in their order.
  [[gnu::always_inline]] void add(const Part& x, Eigen::Index first)
  {
    if constexpr (is_numbered) {
      using Integers = typename VectorOf<Bits, lanes>::Type;
      constexpr Bits of_size = static_cast<Bits>(~row_bits & std::numeric_limits<Bits>::max());
      const Integers row = number(std::make_integer_sequence<int, lanes>{}) + static_cast<Bits>(first);
      const Part key = std::bit_cast<Part>((std::bit_cast<Integers>(x) & of_size) | row);
      size_ = size_ > key ? size_ : key;
    } else {
      using std::abs;
      const Scalar size = abs(x);
      row_ = size > size_ ? first : row_;
      size_ = size > size_ ? size : size_;
    }
  }

  [[gnu::always_inline]] Eigen::Index row() const
  {
    if constexpr (is_numbered) {
      Part size = size_;
      const auto halve = [&]<int... i>(std::integer_sequence<int, i...>, auto step) __attribute__((always_inline)) {
        const Part other = __builtin_shufflevector(size, size, (i ^ step)...);
        size = size > other ? size : other;
      };
      constexpr std::make_integer_sequence<int, lanes> lane;
      if constexpr (lanes > 4) { halve(lane, std::integral_constant<int, 4>{}); }
      if constexpr (lanes > 2) { halve(lane, std::integral_constant<int, 2>{}); }
      halve(lane, std::integral_constant<int, 1>{});
      return static_cast<Eigen::Index>(std::bit_cast<Bits>(Scalar(size[0])) & row_bits);
    } else {
      return row_;
    }
  }

private:
  template <int... i>
  [[gnu::always_inline]] static typename VectorOf<Bits, lanes>::Type number(std::integer_sequence<int, i...>)
  {
    return typename VectorOf<Bits, lanes>::Type{Bits(i)...};
  }

  Part size_ = no_rows<Scalar>();
  Eigen::Index row_ = 0;
};

/// I − factor (x − α e)(x − α e)ᵀ, e the unit vector of row `pivot`, which takes column x to α e.
template <class Scalar, int columns>
struct Reflection {
  static constexpr std::size_t padded = (columns + 7) / 8 * 8;
  int x = 0;
  Eigen::Index pivot = 0;
  alignas(RootRows<Scalar, 8>::alignment) std::array<Scalar, padded> top;  ///< row `pivot` after it: Xᵀx/α
  /// What x(r) times is taken from the other rows.
  alignas(RootRows<Scalar, 8>::alignment) std::array<Scalar, padded> w;

  RootRow<Scalar> row() const { return Eigen::Map<const RootRow<Scalar>>(top.data()); }
};

/// Σ_r n_r x_r over rows n with column x, before it is known what the reflection is.
template <class Scalar, int most, int columns>
struct ColumnSums {
  static constexpr std::size_t padded = Reflection<Scalar, columns>::padded;
  std::array<RowsPart<Scalar>, padded> sum;
  LargestRow<Scalar, RootRows<Scalar, most, columns>::most> largest;

  [[gnu::always_inline]] ColumnSums()
  {
    unrolled<static_cast<int>(padded)>([&](auto c) __attribute__((always_inline)) { sum[c] = no_rows<Scalar>(); });
  }
  template <class Rows>
  [[gnu::always_inline]] void add(const Rows& n, const RowsPart<Scalar>& x, Eigen::Index r)
  {
    unrolled<columns>([&](auto c) __attribute__((always_inline)) { sum[c] += n[c] * x; });
    largest.add(x, r);
  }
};

/// Columns begin + i of w = (s − row α) factor, and of s/α in place of s = `top`. (A function, as of a lambda's vectors
/// within a lambda g++ 13 does not know the size.)
template <int begin, class Rows, class Scalar, int columns, int... i>
[[gnu::always_inline]] inline void reflect_part(const Rows& rows, Eigen::Index pivot, Scalar alpha, Scalar factor,
                                                Scalar inverse, Reflection<Scalar, columns>& reflection,
                                                std::integer_sequence<int, i...>)
{
  using Part = typename PartOf<Scalar, static_cast<int>(sizeof...(i))>::Type;
  const auto number = [&](int c) __attribute__((always_inline)) {
    return c < columns ? *rows.at(c < columns ? c : 0, pivot) : Scalar(0);
  };
  const Part above{number(begin + i)...};
  if constexpr (sizeof...(i) > 1) {
    Part of_s;
    std::memcpy(&of_s, reflection.top.data() + begin, sizeof of_s);
    const Part w = (of_s - above * alpha) * factor, row = of_s * inverse;
    std::memcpy(reflection.w.data() + begin, &w, sizeof w);
    std::memcpy(reflection.top.data() + begin, &row, sizeof row);
  } else {
    reflection.w[begin] = (reflection.top[begin] - above * alpha) * factor;
    reflection.top[begin] *= inverse;
  }
}

/// The reflection of column x whose sums these are. False if the column is zero. `out`: tape's place for the pivot's
/// row. `take`: that row is zero then.
template <bool take, class Scalar, int most, int columns, class Rows>
[[gnu::always_inline]] inline bool conclude(const ColumnSums<Scalar, most, columns>& sums, Rows& rows, int x,
                                            Reflection<Scalar, columns>& reflection, RowTape<Scalar>* tape,
                                            Eigen::Index out)
{
  using std::sqrt;
  constexpr std::size_t padded = Reflection<Scalar, columns>::padded;
  auto& s = reflection.top;
  sum_rows_by_eight(sums.sum, s.data());
  const Scalar square = s[static_cast<std::size_t>(x)];
  if (!(square > Scalar(0))) { return false; }
  const Eigen::Index pivot = sums.largest.row();
  const Scalar top = *rows.at(x, pivot), norm = sqrt(square);
  const Scalar alpha = top > Scalar(0) ? Scalar(-norm) : norm;
  const Scalar factor = Scalar(-1) / (alpha * (top - alpha)), inverse = Scalar(1) / alpha;
  // w = (s − row α) factor; s/α = row − w top, without its cancellation. The row goes from memory to registers number
  // by number: put into an array first, its load would wait until all of them have left the core.
  constexpr int side = register_lanes<Scalar>;
  if (tape != nullptr) [[unlikely]] {
    tape->reflect(
        rows.count, pivot, out, [&](Eigen::Index r) -> const Scalar& { return *rows.at(x, r); }, alpha, factor);
  }
  unrolled<static_cast<int>(padded) / side>([&](auto part) __attribute__((always_inline)) {
    reflect_part<part * side>(rows, pivot, alpha, factor, inverse, reflection, std::make_integer_sequence<int, side>{});
  });
  reflection.w[static_cast<std::size_t>(x)] = Scalar(1);  // x − 1·x is an exact zero
  reflection.x = x;
  reflection.pivot = pivot;
  if constexpr (take) {
#pragma GCC unroll 16
    for (int c = 0; c < columns; ++c) { *rows.at(c, pivot) = Scalar(0); }
  }
  return true;
}

/// The reflection that takes column x to one row.
template <bool take, class Rows, class Scalar, int columns>
[[gnu::always_inline]] inline bool find_reflection(Rows& rows, int x, Reflection<Scalar, columns>& reflection,
                                                   RowTape<Scalar>* tape = nullptr, Eigen::Index out = 0)
{
  if (rows.count == 0) { return false; }
  ColumnSums<Scalar, std::remove_const_t<Rows>::most, columns> sums;
#pragma GCC unroll 1
  for (Eigen::Index r = 0; r < rows.count; r += rows.lanes) {
    sums.add(columns_at<static_cast<std::size_t>(columns)>(rows, r), rows_at(rows.at(x, r)), r);
  }
  return conclude<take>(sums, rows, x, reflection, tape, out);
}

/// Rows after a reflection, from row r on.
template <class Scalar, int most, int columns>
[[gnu::always_inline]] inline std::array<RowsPart<Scalar>, static_cast<std::size_t>(columns)> reflected(
    const RootRows<Scalar, most, columns>& rows, const Reflection<Scalar, columns>& reflection, Eigen::Index r)
{
  std::array<RowsPart<Scalar>, static_cast<std::size_t>(columns)> n;
  const RowsPart<Scalar> part = rows_at(rows.at(reflection.x, r));
  unrolled<columns>([&](auto c)
                        __attribute__((always_inline)) { n[c] = rows_at(rows.at(c, r)) - part * reflection.w[c]; });
  return n;
}

/// All rows after a reflection, whose column is zero then. then(n, r): what else is done with them.
template <class Scalar, int most, int columns, class Then>
[[gnu::always_inline]] inline void reflect(RootRows<Scalar, most, columns>& rows,
                                           const Reflection<Scalar, columns>& reflection, Then&& then)
{
#pragma GCC unroll 1
  for (Eigen::Index r = 0; r < rows.count; r += rows.lanes) {
    const auto n = reflected(rows, reflection, r);
    unrolled<columns>([&](auto c) __attribute__((always_inline)) { put_rows<Scalar>(n[c], rows.at(c, r)); });
    then(n, r);
  }
}

/// Σ_k a(k) b(k), k < 6.
template <class Scalar>
[[gnu::always_inline]] inline Scalar dot_of_six(const RootRow<Scalar>& a, const RootRow<Scalar>& b)
{
  return ((a(0) * b(0) + a(1) * b(1)) + (a(2) * b(2) + a(3) * b(3))) + (a(4) * b(4) + a(5) * b(5));
}

/// Two rows by a rotation that takes v of the second to zero: rows of any two sizes, v = 0 in both left out.
template <class Scalar>
[[gnu::always_inline]] inline void rotate_along(SingleRow<Scalar>& above, SingleRow<Scalar>& below,
                                                RowTape<Scalar>* tape, Eigen::Index at, Eigen::Index other)
{
  using std::sqrt;
  const Scalar square = above.v * above.v + below.v * below.v;
  if (!(square > Scalar(0))) { return; }
  const Scalar T = sqrt(square), inverse = Scalar(1) / T;
  const Scalar cosine = above.v * inverse, sine = below.v * inverse;
  const SingleRow<Scalar> row = above;
  above.n = row.n * cosine, above.n += below.n * sine;
  below.n = below.n * cosine, below.n -= row.n * sine;
  above.z = row.z * cosine + below.z * sine;
  below.z = below.z * cosine - row.z * sine;
  above.v = T;
  below.v = Scalar(0);
  if (tape != nullptr) [[unlikely]] { tape->rotate(at, other, cosine, sine); }
}

}  // namespace iim::detail
