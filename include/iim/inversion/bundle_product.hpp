// The product B̂ = L β where a register holds several numbers of one state: squares of B̂, each entry written once, by
// bundles of rows and of columns (bundle_plan.hpp).
//
// Against the product limb by limb, which adds to rows of B̂ again and again, all that comes after the O(n) pass takes
// 45 % less for a binary tree of 63 links, 25 % less for a chain of 50 and 75 % less for one of 200, all joints driven.
#pragma once

#include <iim/inputs.hpp>
#include <iim/inversion/branches.hpp>
#include <iim/inversion/bundle_plan.hpp>
#include <iim/numerics/array.hpp>
#include <iim/numerics/registers.hpp>
#include <iim/numerics/transpose.hpp>
#include <iim/scalar.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <numeric>
#include <type_traits>

namespace iim::detail {

template <class Scalar>
class BundleProduct {
  static constexpr int lanes = lane_count<Scalar>;
  static constexpr int side = register_lanes<Scalar>;  ///< of a register
  /// Columns of B̂ that share one load of L. Eight instead of four: 18 % less for a chain of 100, 6 % for the biped.
  static constexpr int tile = side == lanes ? 8 : 4;
  using Register = Strip<Scalar>;
  using Plan = BundlePlan<lanes, side>;
  using Bundle = typename Plan::Bundle;
  using RowBundle = typename Plan::RowBundle;
  using ColumnBundle = typename Plan::ColumnBundle;
  using Part = typename Plan::Part;
  using Run = typename Plan::Run;
  using Square = typename Plan::Square;
  using Kind = typename Plan::Kind;

public:
  static constexpr Index least_rows = lanes;  ///< of L; zeros after the last

  [[gnu::cold]] BundleProduct(const TreeData<Scalar>& tree, const InputBlocks<Scalar>& inputs)
      : plan_(tree, inputs.max_columns())
  {
    L_.setZero(plan_.registers() * lanes);
    beta_.setZero((tree.n_v() + side) * lanes);
  }

  /// For columns that are others than before; as of the plan.
  void plan(const Array<BetaColumn>& columns, const Array<Index>& first_row, const Array<Index>& first_other)
  {
    plan_.plan(columns, first_row, first_other);
  }

  /// B̂ = L β of the columns that were planned for. rows: of L by path position, and after these what else columns stand
  /// in; zero where they end. Returns true if B̂ is known to be finite.
  template <class Matrix>
  bool operator()(const MatrixX<Scalar>& rows, const Array<BetaColumn>& columns, Matrix& Bhat)
  {
    const Index stride = rows.rows();
    for (const RowBundle& bundle : plan_.row_bundles) {
      const Scalar* const row = rows.data() + bundle.v * stride;
      gather([&](auto r) __attribute__((always_inline)) { return row + r * stride; }, bundle,
             L_.data() + bundle.registers * lanes);
    }
    check_.setZero();
    const Square* squares = plan_.squares.data();
    for (const ColumnBundle& bundle : plan_.column_bundles) {
      const BetaColumn* const column = columns.data() + bundle.first;
      const Scalar* beta = beta_.data();
      if (bundle.same_rows >= 0) {
        beta = L_.data() + plan_.row_bundles[at(bundle.same_rows)].registers * lanes;
      } else {
        const Index last = bundle.count - 1;  // instead of those that the bundle lacks
        gather(
            [&](auto j)
                __attribute__((always_inline)) { return rows.data() + column[std::min<Index>(j, last)].row * stride; },
            bundle, beta_.data());
      }
      for (Index j = 0; j < bundle.count; j += tile) {
        const Index count = std::min<Index>(tile, bundle.count - j);
        multiply_tile({bundle, squares, beta + j, columns.data(), column + j, count, j}, Bhat);
      }
      squares += plan_.row_bundles.size();
    }
    std::array<Scalar, lanes> check;
    store(check.data(), check_);
    return detail::is_finite(std::accumulate(check.begin(), check.end(), Scalar(0)));
  }

private:
  using Bits = std::conditional_t<sizeof(Scalar) == 8, std::int64_t, std::int32_t>;
  static constexpr std::array<Bits, 3 * lanes> window = [] {
    std::array<Bits, 3 * lanes> bits{};
    for (std::size_t i = lanes; i < 2 * lanes; ++i) { bits[i] = -1; }
    return bits;
  }();

  /// A bundle's rows to one register per velocity: first by path position, then part by part.
  template <class Row>
  [[gnu::always_inline]] void gather(Row&& row, const Bundle& bundle, Scalar* to) const
  {
    for (Index a = 0; a < bundle.deepest; a += side) {
      unrolled<lanes / side>([&](auto part) __attribute__((always_inline)) {
        transpose<Scalar, side>([&](auto r) __attribute__((always_inline)) { return row(part * side + r) + a; },
                                [&](auto r)
                                    __attribute__((always_inline)) { return to + (a + r) * lanes + part * side; });
      });
    }
    const Part* const end = plan_.parts.data() + bundle.parts_end;
    for (const Part* part = plan_.parts.data() + bundle.parts; part != end; ++part) { take(to, *part); }
  }

  [[gnu::always_inline]] static void take(Scalar* registers, const Part& part)
  {
    using Mask [[gnu::vector_size(lanes * sizeof(Scalar))]] = Bits;
    Mask after, before, number;
    std::memcpy(&after, window.data() + part.begin, sizeof(Mask));
    std::memcpy(&before, window.data() + part.end, sizeof(Mask));
    std::memcpy(&number, registers + part.from, sizeof(Mask));
    number &= after & before;
    std::memcpy(registers + part.to, &number, sizeof(Mask));
  }

  struct Tile {
    const ColumnBundle& columns;
    const Square* squares;
    const Scalar* beta;     ///< its registers, from the tile's first lane on
    const BetaColumn* all;  ///< columns
    const BetaColumn* column;
    Index count;  ///< of columns, at most `tile`
    Index lane;   ///< of the first of them in the bundle
  };

  /// Where columns are rows of L, B̂ is symmetric; of two squares of such rows the lower one becomes the upper one, too.
  template <class Matrix>
  [[gnu::noinline]] void multiply_tile(const Tile& t, Matrix& Bhat)
  {
    const Index v = t.columns.v;
    const Scalar* const beta = t.beta;
    const Scalar* const L = L_.data();
    const Run* const runs = plan_.runs.data();
    const BetaColumn* const column = t.column;
    const Index count = t.count;
    Scalar* const to = Bhat.data();
    Scalar* const to_mirrored = to + v + t.lane;
    Register check = check_;
    const Square* square = t.squares;
    const RowBundle* const rows_end = plan_.row_bundles.data() + plan_.row_bundles.size();
    for (const RowBundle* bundle = plan_.row_bundles.data(); bundle != rows_end; ++bundle, ++square) {
      if (square->kind == Kind::mirror) { continue; }
      const RowBundle& rows = *bundle;
      const Run* run = runs + square->first_run;
      const Run* const end = runs + square[1].first_run;
      const bool mirrored = square->kind == Kind::mirrored;
      std::array<Register, tile> sum;
      unrolled<tile>([&](auto j) __attribute__((always_inline)) { sum[j].setZero(); });
      for (; run != end; ++run) {
        const Scalar* l = L + run->row;
        const Scalar* b = beta + run->column;
        const Scalar* const l_end = l + run->count;
        for (; l != l_end; l += lanes, b += lanes) {
          Register numbers = load(l);
          hold(numbers);  // g++ -march=znver3: a chain of 50 10 % less, the biped 6 %
          unrolled<tile>([&](auto j) __attribute__((always_inline)) { sum[j] += numbers * b[j]; });
        }
      }
      check += total<0, tile>(sum);
      const bool whole = rows.count == lanes && count == tile;
      Scalar* const to_rows = to + rows.v;
      if (whole) {
        unrolled<tile>([&](auto j) __attribute__((always_inline)) { store(to_rows + column[j].begin, sum[j]); });
      }
      if (whole && !mirrored) { continue; }
      // A copy: what is addressed here would not stay in registers above.
      alignas(64) std::array<Scalar, tile * lanes> copy;
      unrolled<tile>([&](auto j) __attribute__((always_inline)) { store(copy.data() + j * lanes, sum[j]); });
      if (!whole) {
        for (Index j = 0; j < count; ++j) {
          store(to_rows + column[j].begin, Register(load(copy.data() + j * lanes)), rows.count);
        }
      }
      if (mirrored) {
        const BetaColumn* const row = t.all + rows.first_column;
        unrolled<tile / side>([&](auto j) __attribute__((always_inline)) {
          unrolled<lanes / side>([&](auto r) __attribute__((always_inline)) {
            transpose<Scalar, side>(
                [&](auto k) __attribute__((always_inline)) { return copy.data() + (j * side + k) * lanes + r * side; },
                [&](auto k)
                    __attribute__((always_inline)) { return to_mirrored + row[r * side + k].begin + j * side; });
          });
        });
      }
    }
    check_ = check;
  }

  /// The sum of registers, pair by pair: each waits for few others.
  template <int first, int count>
  [[gnu::always_inline]] static Register total(const std::array<Register, tile>& x)
  {
    if constexpr (count == 1) {
      return x[first];
    } else {
      return total<first, count / 2>(x) + total<first + count / 2, count / 2>(x);
    }
  }

  Plan plan_;
  VectorX<Scalar> L_;     // registers of the bundles of rows
  VectorX<Scalar> beta_;  // and of one bundle of columns
  Register check_;        // the sum of all that was written to B̂, as the lanes come
};

}  // namespace iim::detail
