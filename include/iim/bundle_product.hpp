// The product B̂ = L β where a register holds several numbers of one state: squares of B̂, each entry written once.
//
// Rows of L that are neighbours in the tree make a bundle, columns of β that are neighbours another, `lanes` of them each.
// A bundle has one register per velocity on its paths. In depth-first order these are the path of its first velocity v,
// and what stands from v to its end; so it is stored, with zeros in the lanes of those that a velocity is no ancestor of.
// A square of B̂ is the sum of outer products over the velocities that two bundles share: of two that begin at v ≤ w
//
//     the path of w before v       at the same place in both
//     the path of w from v on      one by one in the bundle of v
//     from w to the earlier end    side by side in both
//
// Against the product limb by limb, which adds to rows of B̂ again and again, all that comes after the O(n) pass takes 45 %
// less for a binary tree of 63 links, 25 % less for a chain of 50 and 75 % less for one of 200, all joints driven.
#pragma once

#include <iim/branches.hpp>
#include <iim/registers.hpp>
#include <iim/scalar.hpp>
#include <iim/transpose.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <numeric>
#include <type_traits>
#include <vector>

namespace iim::detail {

template <class Scalar>
class BundleProduct {
  static constexpr int lanes = lane_count<Scalar>;
  static constexpr int side = register_lanes<Scalar>;  ///< of a register
  /// Columns of B̂ that share one load of L. Eight instead of four: 18 % less for a chain of 100, 6 % for the biped.
  static constexpr int tile = side == lanes ? 8 : 4;
  using Register = Lanes<Scalar>;

public:
  static constexpr Index least_rows = lanes;  ///< of L; zeros after the last

  template <class Tree>
  [[gnu::cold]] BundleProduct(const Tree& tree, Index max_columns)
  {
    const Limbs limbs(tree);
    std::vector<Index> limb_paths;
    std::vector<Index> limbs_above;  // and itself
    for (Index k = 0; k < limbs.size(); ++k) {
      limbs_above.push_back(limbs[k].parent < 0 ? 1 : limbs_above[at(limbs[k].parent)] + 1);
      limb_paths.push_back(static_cast<Index>(paths_.size()));
      paths_.resize(paths_.size() + at(limbs[k].end));
      limbs.for_each_run(k, 0, limbs[k].end, [&](Index a, Index v, Index count) {
        std::iota(paths_.begin() + limb_paths.back() + a, paths_.begin() + limb_paths.back() + a + count, v);
      });
    }
    for (const Node& node : tree.nodes()) {
      const Index end = node.index + 1 < tree.size() ? tree.node(node.index + 1).v : tree.n_v();
      subsystems_.push_back({node.v, end, node.path_v, node.subtree_end, limb_paths[at(limbs.limb_of(node.index))]});
      subsystem_of_.insert(subsystem_of_.end(), static_cast<std::size_t>(end - node.v), node.index);
    }
    std::vector<Index> begin_of;
    for (const Subsystem& s : subsystems_) { begin_of.push_back(s.v); }
    begin_of.push_back(tree.n_v());
    const Index n = tree.n_v();
    Index registers = 0;
    for (Index v = 0; v < n; v += lanes) {
      // The last bundle begins earlier instead of having fewer rows: what it shares is written twice.
      RowBundle rows;
      rows.v = n >= lanes ? std::min(v, n - lanes) : v;
      rows.count = std::min<Index>(lanes, n - rows.v);
      rows.end = of(rows.v + rows.count - 1).end;
      for (Index r = rows.v; r < rows.end; ++r) { rows.deepest = std::max(rows.deepest, position(r) + 1); }
      rows.above = position(rows.v);
      rows.path = of(rows.v).path;
      rows.registers = registers;
      add_parts(rows, rows.v, begin_of);
      registers += rows.size() + side;
      row_bundles_.push_back(rows);
    }
    row_parts_ = parts_.size();
    L_.setZero(registers * lanes);
    beta_.setZero((n + side) * lanes);
    // Room for what `plan` finds, whatever is active.
    const std::size_t bundles = at((max_columns + lanes - 1) / lanes), squares = bundles * row_bundles_.size();
    const Index most = limbs_above.empty() ? 0 : *std::max_element(limbs_above.begin(), limbs_above.end());
    column_bundles_.reserve(bundles);
    parts_.reserve(row_parts_ + bundles * at(limbs.depth()) + 2 * at(n));
    squares_.reserve(squares + 1);
    runs_.reserve(squares * at(most + 2));
  }

  /// For columns that are others than before. Those on subsystems before i are the first first_column[i].
  void plan(const std::vector<BetaColumn>& columns, const std::vector<Index>& first_column)
  {
    parts_.resize(row_parts_);
    column_bundles_.clear();
    runs_.clear();
    squares_.clear();
    const Index m = first_column.back();
    for (Index j = 0; j < m; j += lanes) {
      ColumnBundle bundle;
      bundle.first = m >= lanes ? std::min(j, m - lanes) : j;
      bundle.count = std::min<Index>(lanes, m - bundle.first);
      const BetaColumn* const column = columns.data() + bundle.first;
      const Subsystem& s = subsystems_[at(column[0].subsystem)];
      bundle.v = s.v;
      bundle.end = subsystems_[at(column[bundle.count - 1].subsystem)].end;
      bundle.above = s.path_v;
      bundle.path = s.path;
      bundle.deepest = is_path(bundle) ? bundle.size() : 0;
      for (Index k = 0; k < bundle.count; ++k) { bundle.deepest = std::max(bundle.deepest, column[k].depth); }
      add_parts(bundle, bundle.first, first_column);
      bundle.same_rows = same_rows(column, bundle.count);
      Index before = 0, common = bundle.above;
      for (const RowBundle& rows : row_bundles_) {
        squares_.push_back(static_cast<std::int32_t>(runs_.size()));
        add_runs(rows, bundle, before, common);
      }
      column_bundles_.push_back(bundle);
    }
    squares_.push_back(static_cast<std::int32_t>(runs_.size()));
  }

  /// B̂ = L β of the columns that were planned for. rows: of L by path position, and after these what else columns stand
  /// in; zero where they end. scale: what a column is times its row; 1 in `lanes` after the last. Returns true if B̂ is
  /// known to be finite.
  template <class Matrix>
  bool operator()(const MatrixX<Scalar>& rows, const std::vector<Scalar>& scale, const std::vector<BetaColumn>& columns,
                  Matrix& Bhat)
  {
    const Index stride = rows.rows();
    for (RowBundle& bundle : row_bundles_) {
      const Scalar* const row = rows.data() + bundle.v * stride;
      gather([&](auto r) __attribute__((always_inline)) { return row + r * stride; },
             [](auto) __attribute__((always_inline)) { return Scalar(1); }, bundle, L_.data() + bundle.registers * lanes);
      bundle.are_inputs = false;
    }
    for (ColumnBundle& bundle : column_bundles_) {
      const Register apart = load(scale.data() + bundle.first) - Scalar(1);
      bundle.same = bundle.same_rows >= 0 && apart.abs().sum() == Scalar(0);
      if (bundle.same) {
        RowBundle& same = row_bundles_[at(bundle.same_rows)];
        same.are_inputs = true;
        same.columns = columns.data() + bundle.first;
      }
    }
    // Of squares of such rows one of two is computed: as long as all rows are such, those from the diagonal on.
    Index mirrored = 0;
    while (mirrored < static_cast<Index>(row_bundles_.size()) && row_bundles_[at(mirrored)].are_inputs) { ++mirrored; }
    check_.setZero();
    const std::int32_t* squares = squares_.data();
    for (const ColumnBundle& bundle : column_bundles_) {
      const BetaColumn* const column = columns.data() + bundle.first;
      const Scalar* beta = beta_.data();
      if (bundle.same) {
        beta = L_.data() + row_bundles_[at(bundle.same_rows)].registers * lanes;
      } else {
        const Scalar* const factor = scale.data() + bundle.first;
        const Index last = bundle.count - 1;  // instead of those that the bundle lacks
        gather([&](auto j) __attribute__((always_inline)) { return rows.data() + column[std::min<Index>(j, last)].row * stride; },
               [&](auto j) __attribute__((always_inline)) { return factor[std::min<Index>(j, last)]; }, bundle, beta_.data());
      }
      const Index from = bundle.same && bundle.same_rows <= mirrored ? bundle.same_rows : 0;
      for (Index j = 0; j < bundle.count; j += tile) {
        const Index count = std::min<Index>(tile, bundle.count - j);
        multiply_tile({bundle, from, squares + from, beta + j, column + j, count, j}, Bhat);
      }
      squares += row_bundles_.size();
    }
    std::array<Scalar, lanes> check;
    store(check.data(), check_);
    return detail::is_finite(std::accumulate(check.begin(), check.end(), Scalar(0)));
  }

private:
  struct Subsystem {
    Index v, end;       ///< its velocities
    Index path_v;       ///< how many there are on its path before them
    Index subtree_end;  ///< subsystem after its subtree
    Index path;         ///< place in paths_ of the velocities on its path
  };
  struct Bundle {
    Index v = 0, end = 0;  ///< where it begins, and the first velocity after it
    Index above = 0;       ///< velocities on v's path before v
    Index count = 0;       ///< of its rows or columns
    Index path = 0;        ///< place in paths_ of v's path
    Index deepest = 0;     ///< path positions of the longest of its paths
    Index parts = 0, parts_end = 0;  ///< places in parts_
    Index size() const { return above + end - v; }
    Index place(Index velocity) const { return above + velocity - v; }  ///< of one from v on
  };
  struct RowBundle : Bundle {
    Index registers = 0;      ///< place in L_
    bool are_inputs = false;  ///< these rows are columns of β, too
    const BetaColumn* columns = nullptr;  ///< if so
  };
  struct ColumnBundle : Bundle {
    Index first = 0;       ///< column
    Index same_rows = -1;  ///< bundle of rows that it is, if its B̄ is 1
    bool same = false;     ///< it is
  };

  const Subsystem& of(Index v) const { return subsystems_[at(subsystem_of_[at(v)])]; }
  Index position(Index v) const { return of(v).path_v + v - of(v).v; }
  bool is_path(const Bundle& bundle) const
  {
    return bundle.end == bundle.v || bundle.size() == position(bundle.end - 1) + 1;
  }

  /// A register that differs from the one that was gathered at its place: lanes of another.
  struct Part {
    std::int32_t to, from;    ///< first numbers, in the bundle
    std::int32_t begin, end;  ///< where in `window` masks begin: of the lanes from its first on, and up to its last
  };
  using Bits = std::conditional_t<sizeof(Scalar) == 8, std::int64_t, std::int32_t>;
  static constexpr std::array<Bits, 3 * lanes> window = [] {
    std::array<Bits, 3 * lanes> bits{};
    for (std::size_t i = lanes; i < 2 * lanes; ++i) { bits[i] = -1; }
    return bits;
  }();

  /// Registers by path position to one per velocity, the last first, since none stands before its path position. `first`:
  /// of what is in the lanes, numbered along the tree so that a subsystem's begin at begin_of.
  void add_parts(Bundle& bundle, Index first, const std::vector<Index>& begin_of)
  {
    bundle.parts = bundle.parts_end = static_cast<Index>(parts_.size());
    if (is_path(bundle)) { return; }
    for (Index k = bundle.size() - 1; k >= 0; --k) {
      const Index v = k < bundle.above ? paths_[at(bundle.path + k)] : bundle.v + k - bundle.above;
      const Subsystem& s = of(v);
      const Index begin = std::clamp<Index>(begin_of[at(subsystem_of_[at(v)])] - first, 0, bundle.count);
      const Index end = std::clamp<Index>(begin_of[at(s.subtree_end)] - first, 0, bundle.count);
      if (k < bundle.above && end == bundle.count) { return; }
      parts_.push_back({static_cast<std::int32_t>(k * lanes), static_cast<std::int32_t>((s.path_v + v - s.v) * lanes),
                        static_cast<std::int32_t>(lanes - begin), static_cast<std::int32_t>(2 * lanes - end)});
      ++bundle.parts_end;
    }
  }

  /// The bundle of rows that columns are but for their B̄; −1: none.
  Index same_rows(const BetaColumn* columns, Index count) const
  {
    const Index v = columns[0].row;
    if (v >= static_cast<Index>(subsystem_of_.size())) { return -1; }
    const Index k = v % lanes == 0 ? v / lanes : static_cast<Index>(row_bundles_.size()) - 1;
    bool same = v == row_bundles_[at(k)].v && count == row_bundles_[at(k)].count;
    for (Index j = 0; same && j < count; ++j) { same = columns[j].row == v + j; }
    return same ? k : -1;
  }

  /// Velocities that a bundle of rows and one of columns share, side by side in both.
  struct Run {
    std::int32_t row;     ///< place in L_
    std::int32_t column;  ///< place of the first lane in the registers of the columns
    std::int32_t count;   ///< of numbers: `lanes` per velocity
  };

  /// The runs of one square of B̂. While bundles of rows come one after the other to one of columns, of the velocities on
  /// the columns' path: `before`, how many stand before the rows, `common`, how many are on the path of rows after the
  /// columns, too. Found once, not at each state: 30 % fewer instructions in the squares of a tree of 63 links, 22 % of a
  /// chain.
  void add_runs(const RowBundle& rows, const Bundle& columns, Index& before, Index& common)
  {
    const std::size_t first = runs_.size();
    const auto add = [&](Index place, Index column_place, Index velocities) {
      if (velocities <= 0) { return; }
      const auto row = static_cast<std::int32_t>((rows.registers + place) * lanes);
      const auto column = static_cast<std::int32_t>(column_place * lanes);
      const auto count = static_cast<std::int32_t>(velocities * lanes);
      if (runs_.size() > first && runs_.back().row + runs_.back().count == row &&
          runs_.back().column + runs_.back().count == column) {
        runs_.back().count += count;
      } else {
        runs_.push_back({row, column, count});
      }
    };
    const Index* const column_path = paths_.data() + columns.path;
    const Index* const row_path = paths_.data() + rows.path;
    if (rows.v < columns.v) {
      while (before < columns.above && column_path[before] < rows.v) { ++before; }
      add(0, 0, before);
      for (Index a = before; a < columns.above && column_path[a] < rows.end; ++a) { add(rows.place(column_path[a]), a, 1); }
    } else {
      while (common > 0 && (common > rows.above || row_path[common - 1] != column_path[common - 1])) { --common; }
      add(0, 0, common);
      for (Index a = common; a < rows.above && row_path[a] < columns.end; ++a) { add(a, columns.place(row_path[a]), 1); }
    }
    const Index v = std::max(rows.v, columns.v);
    add(rows.place(v), columns.place(v), std::min(rows.end, columns.end) - v);
  }

  /// A bundle's rows, each times its scale, to one register per velocity: first by path position, then part by part.
  template <class Row, class Scale>
  [[gnu::always_inline]] void gather(Row&& row, Scale&& scale, const Bundle& bundle, Scalar* to) const
  {
    for (Index a = 0; a < bundle.deepest; a += side) {
      unrolled<lanes / side>([&](auto part) __attribute__((always_inline)) {
        transpose<Scalar, side>([&](auto r) __attribute__((always_inline)) { return row(part * side + r) + a; },
                                [&](auto r) __attribute__((always_inline)) { return scale(part * side + r); },
                                [&](auto r) __attribute__((always_inline)) { return to + (a + r) * lanes + part * side; });
      });
    }
    const Part* const end = parts_.data() + bundle.parts_end;
    for (const Part* part = parts_.data() + bundle.parts; part != end; ++part) { take(to, *part); }
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
    Index from;                   ///< first bundle of rows
    const std::int32_t* squares;  ///< of the bundle from there on: where the runs of each begin
    const Scalar* beta;           ///< its registers, from the tile's first lane on
    const BetaColumn* column;
    Index count;                  ///< of columns, at most `tile`
    Index lane;                   ///< of the first of them in the bundle
  };

  /// Where columns are rows of L, B̂ is symmetric; of two squares of such rows the lower one becomes the upper one, too.
  template <class Matrix>
  [[gnu::noinline]] void multiply_tile(const Tile& t, Matrix& Bhat)
  {
    const Index v = t.columns.v;
    const bool same = t.columns.same;
    const Scalar* const beta = t.beta;
    const Scalar* const L = L_.data();
    const Run* const runs = runs_.data();
    const BetaColumn* const column = t.column;
    const Index count = t.count;
    Scalar* const to = Bhat.data();
    Scalar* const to_mirrored = to + v + t.lane;
    Register check = check_;
    const std::int32_t* square_runs = t.squares;
    const RowBundle* const rows_end = row_bundles_.data() + row_bundles_.size();
    for (const RowBundle* bundle = row_bundles_.data() + t.from; bundle != rows_end; ++bundle) {
      const RowBundle& rows = *bundle;
      const Run* run = runs + square_runs[0];
      const Run* const end = runs + square_runs[1];
      ++square_runs;
      const bool mirrored = same && rows.are_inputs && rows.v != v;
      if (mirrored && rows.v < v) { continue; }
      std::array<Register, tile> sum;
      unrolled<tile>([&](auto j) __attribute__((always_inline)) { sum[j].setZero(); });
      for (; run != end; ++run) {
        const Scalar* l = L + run->row;
        const Scalar* b = beta + run->column;
        const Scalar* const l_end = l + run->count;
        for (; l != l_end; l += lanes, b += lanes) {
          const Register numbers = load(l);
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
        const BetaColumn* const row = rows.columns;
        unrolled<tile / side>([&](auto j) __attribute__((always_inline)) {
          unrolled<lanes / side>([&](auto r) __attribute__((always_inline)) {
            transpose<Scalar, side>(
                [&](auto k) __attribute__((always_inline)) { return copy.data() + (j * side + k) * lanes + r * side; },
                [&](auto) __attribute__((always_inline)) { return Scalar(1); },
                [&](auto k) __attribute__((always_inline)) {
                  return to_mirrored + row[r * side + k].begin + j * side;
                });
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

  static constexpr std::size_t at(Index i) { return static_cast<std::size_t>(i); }

  std::vector<Subsystem> subsystems_;
  std::vector<Index> subsystem_of_;    // of a velocity
  std::vector<RowBundle> row_bundles_;
  std::vector<ColumnBundle> column_bundles_;
  std::vector<Part> parts_;       // of the bundles of rows, and of columns after these
  std::size_t row_parts_ = 0;
  std::vector<std::int32_t> squares_;  // of B̂, a bundle of columns after the other: first run
  std::vector<Run> runs_;
  std::vector<Index> paths_;      // of every limb, one after the other
  VectorX<Scalar> L_;             // registers of the bundles of rows
  VectorX<Scalar> beta_;          // and of one bundle of columns
  Register check_;                // the sum of all that was written to B̂, as the lanes come
};

}  // namespace iim::detail
