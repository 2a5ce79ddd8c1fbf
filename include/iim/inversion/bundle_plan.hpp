// Which velocities the bundles of rows and columns share in the product B̂ = L β (bundle_product.hpp).
//
// Rows of L that are neighbours in the tree make a bundle, columns of β that are neighbours another, `lanes` of them
// each. A bundle has one register per velocity on its paths. In depth-first order these are the path of its first
// velocity v, and what stands from v to its end; so it is stored, with zeros in the lanes of those that a velocity is
// no ancestor of. A square of B̂ is the sum of outer products over the velocities that two bundles share: of two that
// begin at v ≤ w
//
//     the path of w before v       at the same place in both
//     the path of w from v on      one by one in the bundle of v
//     from w to the earlier end    side by side in both
#pragma once

#include <iim/inversion/branches.hpp>
#include <iim/numerics/array.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <numeric>

namespace iim::detail {

/// Found once for a tree, and by `plan` for the columns that are active. lanes: numbers that a step treats; side: that
/// a register holds.
template <int lanes, int side>
class BundlePlan {
public:
  struct Bundle {
    Index v = 0, end = 0;            ///< where it begins, and the first velocity after it
    Index above = 0;                 ///< velocities on v's path before v
    Index count = 0;                 ///< of its rows or columns
    Index path = 0;                  ///< place of v's in paths_
    Index deepest = 0;               ///< path positions of the longest of its paths
    Index parts = 0, parts_end = 0;  ///< places in `parts`
    Index size() const { return above + end - v; }
    Index place(Index velocity) const { return above + velocity - v; }  ///< of one from v on
  };
  struct RowBundle : Bundle {
    Index registers = 0;      ///< place among those of all bundles of rows
    Index first_column = -1;  ///< if these rows are columns of β, too: the first of them
  };
  struct ColumnBundle : Bundle {
    Index first = 0;       ///< column
    Index same_rows = -1;  ///< bundle of rows that it is
  };

  /// A register that differs from the one that was gathered at its place: lanes of another.
  struct Part {
    std::int32_t to, from;    ///< first numbers, in the bundle
    std::int32_t begin, end;  ///< where masks begin in a window of ones between zeros: of the lanes from its first on,
                              ///< and up to its last
  };

  /// Velocities that a bundle of rows and one of columns share, side by side in both.
  struct Run {
    std::int32_t row;     ///< place in the registers of all bundles of rows
    std::int32_t column;  ///< place of the first lane in the registers of the columns
    std::int32_t count;   ///< of numbers: `lanes` per velocity
  };

  /// Of B̂: a bundle of rows by one of columns.
  enum class Kind : std::int32_t {
    computed,
    mirrored,  ///< what stands in it is that of the square across the diagonal, too
    mirror     ///< that square
  };
  struct Square {
    std::int32_t first_run;  ///< its runs end where those of the next one begin
    Kind kind;
  };

  Array<RowBundle> row_bundles;
  Array<ColumnBundle> column_bundles;
  Array<Part> parts;      ///< of the bundles of rows, and of columns after these
  Array<Square> squares;  ///< a bundle of columns after the other
  Array<Run> runs;

  template <class Scalar>
  [[gnu::cold]] BundlePlan(const TreeData<Scalar>& tree, Index max_columns)
  {
    const Limbs limbs(tree);
    Array<Index> limb_paths;
    Array<Index> limbs_above;  // and itself
    for (Index k = 0; k < limbs.size(); ++k) {
      limbs_above.push_back(limbs[k].parent < 0 ? 1 : limbs_above[at(limbs[k].parent)] + 1);
      limb_paths.push_back(static_cast<Index>(paths_.size()));
      paths_.resize(paths_.size() + at(limbs[k].end));
      limbs.for_each_run(k, 0, limbs[k].end, [&](Index a, Index v, Index count) {
        std::iota(paths_.begin() + limb_paths.back() + a, paths_.begin() + limb_paths.back() + a + count, v);
      });
    }
    for (const Node& node : tree.nodes()) {
      const Index end = node.v + tree.velocities(node.index);
      subsystems_.push_back({node.v, end, node.path_v, node.subtree_end, limb_paths[at(limbs.limb_of(node.index))]});
      subsystem_of_.resize(at(end), node.index);
    }
    Array<Index> begin_of;
    for (const Subsystem& s : subsystems_) { begin_of.push_back(s.v); }
    begin_of.push_back(tree.n_v());
    const Index n = tree.n_v();
    // If it makes no bundle more, the velocities before the first motor, as a base's, have one to themselves: those
    // after them are bundles of columns, too.
    Index lead = 0;
    for (Index i = 0; i < tree.size() && !(tree.motors(i) > 0 && tree.velocities(i) == 1); ++i) {
      lead += tree.velocities(i);
    }
    if (lead >= lanes || n - lead < lanes || bundles(n - lead) + 1 > bundles(n)) { lead = 0; }
    for (Index v = 0; v < n; v = v == 0 && lead > 0 ? lead : v + lanes) {
      // The last bundle begins earlier instead of having fewer rows: what it shares is written twice.
      RowBundle rows;
      rows.v = n >= lanes ? std::min(v, n - lanes) : v;
      rows.count = std::min<Index>(lanes, n - rows.v);
      rows.end = of(rows.v + rows.count - 1).end;
      for (Index r = rows.v; r < rows.end; ++r) { rows.deepest = std::max(rows.deepest, position(r) + 1); }
      rows.above = position(rows.v);
      rows.path = of(rows.v).path;
      rows.registers = registers_;
      add_parts(rows, rows.v, begin_of);
      registers_ += rows.size() + side;
      row_bundles.push_back(rows);
    }
    row_parts_ = parts.size();
    // Room for what `plan` finds, whatever is active.
    const std::size_t most_bundles = at(bundles(max_columns)), most_squares = most_bundles * row_bundles.size();
    const Index most = limbs_above.empty() ? 0 : *std::max_element(limbs_above.begin(), limbs_above.end());
    column_bundles.reserve(most_bundles);
    parts.reserve(row_parts_ + most_bundles * at(limbs.depth()) + 4 * at(n));
    squares.reserve(most_squares + 1);
    runs.reserve(most_squares * at(most + 2));
  }

  /// Bundles for so many rows or columns.
  static Index bundles(Index count) { return (count + lanes - 1) / lanes; }

  /// For columns that are others than before: rows of L and, after these, others, each sorted along the tree. Those on
  /// subsystems before i end at first_row[i], first_other[i].
  void plan(const Array<BetaColumn>& columns, const Array<Index>& first_row, const Array<Index>& first_other)
  {
    parts.resize(row_parts_);
    column_bundles.clear();
    runs.clear();
    squares.clear();
    for (RowBundle& rows : row_bundles) { rows.first_column = -1; }
    add_columns(columns, first_row);
    add_columns(columns, first_other);
    squares.push_back({static_cast<std::int32_t>(runs.size()), Kind::computed});
    mirror_squares();
  }

  Index registers() const { return registers_; }  ///< of all bundles of rows

private:
  struct Subsystem {
    Index v, end;       ///< its velocities
    Index path_v;       ///< how many there are on its path before them
    Index subtree_end;  ///< subsystem after its subtree
    Index path;         ///< place in paths_ of the velocities on its path
  };

  [[gnu::noinline]] void add_columns(const Array<BetaColumn>& columns, const Array<Index>& first_column)
  {
    const Index begin = first_column.front(), end = first_column.back();
    for (Index j = begin; j < end; j += lanes) {
      ColumnBundle bundle;
      bundle.first = end - begin >= lanes ? std::min(j, end - lanes) : j;
      bundle.count = std::min<Index>(lanes, end - bundle.first);
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
      if (bundle.same_rows >= 0) { row_bundles[at(bundle.same_rows)].first_column = bundle.first; }
      Index before = 0, common = bundle.above;
      for (const RowBundle& rows : row_bundles) {
        const auto first = static_cast<std::int32_t>(runs.size());
        add_runs(rows, bundle, before, common);
        squares.push_back({first, Kind::computed});
      }
      column_bundles.push_back(bundle);
    }
  }

  /// Where columns are rows of L, B̂ is symmetric: of two squares one is computed, unless `few` velocities are shared:
  /// to turn a square takes as long (after the O(n) pass a tree of 63 links takes 7 % less so, with clang 21 %).
  void mirror_squares()
  {
    constexpr std::int32_t few = 5 * lanes;
    const std::size_t rows_count = row_bundles.size();
    for (std::size_t c = 0; c < column_bundles.size(); ++c) {
      const Index same = column_bundles[c].same_rows;
      if (same < 0) { continue; }
      for (std::size_t r = 0; r < rows_count; ++r) {
        if (row_bundles[r].first_column < 0 || r == at(same)) { continue; }
        const std::size_t square = c * rows_count + r;
        std::int32_t shared = 0;
        for (Index k = squares[square].first_run; k < squares[square + 1].first_run; ++k) {
          shared += runs[at(k)].count;
        }
        if (shared > few) { squares[square].kind = r > at(same) ? Kind::mirrored : Kind::mirror; }
      }
    }
  }

  const Subsystem& of(Index v) const { return subsystems_[at(subsystem_of_[at(v)])]; }
  Index position(Index v) const { return of(v).path_v + v - of(v).v; }
  bool is_path(const Bundle& bundle) const
  {
    return bundle.end == bundle.v || bundle.size() == position(bundle.end - 1) + 1;
  }

  /// Registers by path position to one per velocity, the last first, since none stands before its path position.
  /// `first`: of what is in the lanes, numbered along the tree so that a subsystem's begin at begin_of.
  void add_parts(Bundle& bundle, Index first, const Array<Index>& begin_of)
  {
    bundle.parts = bundle.parts_end = static_cast<Index>(parts.size());
    if (is_path(bundle)) { return; }
    for (Index k = bundle.size() - 1; k >= 0; --k) {
      const Index v = k < bundle.above ? paths_[at(bundle.path + k)] : bundle.v + k - bundle.above;
      const Subsystem& s = of(v);
      const Index begin = std::clamp<Index>(begin_of[at(subsystem_of_[at(v)])] - first, 0, bundle.count);
      const Index end = std::clamp<Index>(begin_of[at(s.subtree_end)] - first, 0, bundle.count);
      if (k < bundle.above && end == bundle.count) { return; }
      parts.push_back({static_cast<std::int32_t>(k * lanes), static_cast<std::int32_t>((s.path_v + v - s.v) * lanes),
                       static_cast<std::int32_t>(lanes - begin), static_cast<std::int32_t>(2 * lanes - end)});
      ++bundle.parts_end;
    }
  }

  /// The bundle of rows that columns are; −1: none.
  Index same_rows(const BetaColumn* columns, Index count) const
  {
    const Index v = columns[0].row;
    if (v >= static_cast<Index>(subsystem_of_.size())) { return -1; }
    const auto rows =
        std::find_if(row_bundles.begin(), row_bundles.end(), [&](const RowBundle& bundle) { return bundle.v == v; });
    bool same = rows != row_bundles.end() && count == rows->count;
    for (Index j = 0; same && j < count; ++j) { same = columns[j].row == v + j; }
    return same ? static_cast<Index>(rows - row_bundles.begin()) : -1;
  }

  /// The runs of one square of B̂. While bundles of rows come one after the other to one of columns, of the velocities
  /// on the columns' path: `before`, how many stand before the rows, `common`, how many are on the path of rows after
  /// the columns, too. Found once, not at each state: 30 % fewer instructions in the squares of a tree of 63 links, 22
  /// % of a chain.
  void add_runs(const RowBundle& rows, const Bundle& columns, Index& before, Index& common)
  {
    const std::size_t first = runs.size();
    const auto add = [&](Index place, Index column_place, Index velocities) {
      if (velocities <= 0) { return; }
      const auto row = static_cast<std::int32_t>((rows.registers + place) * lanes);
      const auto column = static_cast<std::int32_t>(column_place * lanes);
      const auto count = static_cast<std::int32_t>(velocities * lanes);
      if (runs.size() > first && runs.back().row + runs.back().count == row &&
          runs.back().column + runs.back().count == column) {
        runs.back().count += count;
      } else {
        runs.push_back({row, column, count});
      }
    };
    const Index* const column_path = paths_.data() + columns.path;
    const Index* const row_path = paths_.data() + rows.path;
    if (rows.v < columns.v) {
      while (before < columns.above && column_path[before] < rows.v) { ++before; }
      add(0, 0, before);
      for (Index a = before; a < columns.above && column_path[a] < rows.end; ++a) {
        add(rows.place(column_path[a]), a, 1);
      }
    } else {
      while (common > 0 && (common > rows.above || row_path[common - 1] != column_path[common - 1])) { --common; }
      add(0, 0, common);
      for (Index a = common; a < rows.above && row_path[a] < columns.end; ++a) {
        add(a, columns.place(row_path[a]), 1);
      }
    }
    const Index v = std::max(rows.v, columns.v);
    add(rows.place(v), columns.place(v), std::min(rows.end, columns.end) - v);
  }

  Array<Subsystem> subsystems_;
  Array<Index> subsystem_of_;  // of a velocity
  Array<Index> paths_;         // of every limb, one after the other
  std::size_t row_parts_ = 0;
  Index registers_ = 0;
};

}  // namespace iim::detail
