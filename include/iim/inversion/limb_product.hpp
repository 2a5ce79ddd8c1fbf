// The product B̂ = L β where a register holds one number, or one of several states: limb by limb, the path positions of
// a limb take the inputs on its subtree to the rows of it.
#pragma once

#include <iim/inputs.hpp>
#include <iim/inversion/branches.hpp>
#include <iim/numerics/array.hpp>
#include <iim/numerics/registers.hpp>
#include <iim/scalar.hpp>
#include <iim/spatial.hpp>

#include <algorithm>
#include <array>
#include <cstddef>

namespace iim::detail {

/// Whether a Scalar is a register: then numbers that several products use are held in one.
template <class Scalar>
inline constexpr bool is_register = requires(Scalar& x) { x.hold(); };

/// Up to four columns of the product for one limb: all that does not depend on the state.
struct LimbTile {
  Index v, gap;          ///< rows from v to gap
  Index gap_end, v_end;  ///< and these; those between are columns that come before, and B̂ is symmetric there
  Index begin, end;      ///< path positions: the limb's, as far as one of the columns reaches
  bool first;            ///< of all that reach these rows: B̂ is assigned
  int count;             ///< of columns
  std::array<Index, 4> row, column;  ///< which of the rows each of β is; where each of B̂ begins
};

/// What the product works on. Entry (v, a) of L, a: path position, at rows[v·stride + a].
template <class Scalar>
struct LimbFactors {
  const Scalar* rows;
  Index stride;
  const Index* path_end;  ///< of a row: L is zero from this path position on
  Scalar* Bhat;
};

/// Path positions a … a + depth: β stays in registers while the rows of L pass by. (The sums in registers while L and β
/// pass by: 40 % more time for the biped's product with g++ and AVX-512; this one runs at 85 to 90 % of the processor's
/// peak.)
template <int depth, bool assign, int count, class Scalar>
[[gnu::noinline]] void multiply_chunk(const LimbTile& tile, const LimbFactors<Scalar>& factors, Index a, Scalar& check)
{
  const Index stride = factors.stride;
  std::array<Scalar, depth * count> beta;
  std::array<Scalar*, count> column;
  unrolled<count>([&](auto j) __attribute__((always_inline)) {
    column[j] = factors.Bhat + tile.column[j];
    const Scalar* const numbers = factors.rows + tile.row[j] * stride + a;
    unrolled<depth>([&](auto k) __attribute__((always_inline)) { beta[j * depth + k] = numbers[k]; });
  });
  Scalar all = check;
  Index v = tile.v, end = tile.gap;
  for (int part = 0; part < 2; ++part, v = tile.gap_end, end = tile.v_end) {
    while (v < end && factors.path_end[v] <= a) { ++v; }
    const Scalar* l = factors.rows + v * stride + a;
    for (; v < end; ++v, l += stride) {
      std::array<Scalar, count> sum;
      unrolled<depth>([&](auto k) __attribute__((always_inline)) {
        Scalar L = l[k];
        hold(L);
        unrolled<count>([&](auto j) __attribute__((always_inline)) {
          if constexpr (k == 0) {
            sum[j] = L * beta[j * depth];
          } else {
            sum[j] += L * beta[j * depth + k];
          }
        });
      });
      unrolled<count>([&](auto j) __attribute__((always_inline)) {
        column[j][v] = assign ? sum[j] : Scalar(column[j][v] + sum[j]);
        if constexpr (is_register<Scalar>) { all += sum[j]; }
      });
    }
  }
  check = all;
}

/// multiply_chunk<size>, for size ≤ most.
template <int most, int count, class Scalar>
[[gnu::always_inline]] inline void choose_chunk(const LimbTile& tile, const LimbFactors<Scalar>& factors, Index a,
                                                Index size, Scalar& check)
{
  if (size < most) {
    if constexpr (most > 1) { choose_chunk<most - 1, count>(tile, factors, a, size, check); }
  } else if (tile.first && a == tile.begin) {
    multiply_chunk<most, true, count>(tile, factors, a, check);
  } else {
    multiply_chunk<most, false, count>(tile, factors, a, check);
  }
}

/// B̂ += L β; = L β for a limb on the world. All that is written to B̂ is added to `check`: B̂ is finite if that is.
template <int count, class Scalar>
void multiply(const LimbTile& tile, const LimbFactors<Scalar>& factors, Scalar& check)
{
  constexpr int most = is_register<Scalar> ? 6 : 1;  // 24 registers for β of four columns, of 32
  if (tile.first && tile.end <= tile.begin) {        // inputs on what cannot move
    for (int j = 0; j < count; ++j) {
      Scalar* const column = factors.Bhat + tile.column[static_cast<std::size_t>(j)];
      std::fill(column + tile.v, column + tile.v_end, Scalar(0));
    }
  }
  for (Index a = tile.begin; a < tile.end;) {
    const Index left = tile.end - a;
    const Index chunks = (left + most - 1) / most;
    const Index size = (left + chunks - 1) / chunks;
    choose_chunk<most, count>(tile, factors, a, size, check);
    a += size;
  }
}

template <class Scalar>
class LimbProduct {
public:
  static constexpr Index least_rows = 0;  ///< of L

  LimbProduct(const TreeData<Scalar>& tree, const InputBlocks<Scalar>& inputs) : mirrors_(paths_are_shared(tree))
  {
    const Limbs limbs(tree);
    for (const Node& node : tree.nodes()) {
      const Index own = tree.velocities(node.index);
      path_end_.resize(at(node.v + own), node.path_v + own);
      const Index limb = limbs.limb_of(node.index);
      if (limb == static_cast<Index>(subtrees_.size())) {
        subtrees_.push_back({limbs[limb], node.index, node.subtree_end});
      }
      roots_ += node.parent < 0;
    }
    Index most_tiles = 0;
    for (const Subtree& subtree : subtrees_) {
      Index columns = 0;
      for (Index id = 0; id < inputs.blocks(); ++id) {
        const Input<Scalar>& input = inputs.block(id);
        if (input.subsystem >= subtree.begin && input.subsystem < subtree.end) { columns += input.size; }
      }
      most_tiles += columns / 4 + 3 * 2;  // what fours leave of each of three ranges of columns: two and one
    }
    tiles_.reserve(at(most_tiles));
  }

  /// For columns that are others than before, each kind sorted along the tree: those that are rows of L, and others. Of
  /// a subsystem i the first are first_row[i] and first_other[i].
  void plan(const Array<BetaColumn>& columns, const Array<Index>& first_row, const Array<Index>& first_other)
  {
    mirrored_ = mirrored_end_ = first_row.back();
    first_mirrored_ = static_cast<Index>(path_end_.size());
    while (mirrors_ && mirrored_ > first_row.front() && columns[at(mirrored_ - 1)].row == first_mirrored_ - 1) {
      --mirrored_;
      --first_mirrored_;
    }
    tiles_.clear();
    for (const Subtree& subtree : subtrees_) {
      const Index row = first_row[at(subtree.begin)], row_end = first_row[at(subtree.end)];
      const Index mirrored = std::clamp(mirrored_, row, row_end);
      add_tiles(subtree.limb, columns, row, mirrored);
      add_tiles(subtree.limb, columns, mirrored, row_end);
      add_tiles(subtree.limb, columns, first_other[at(subtree.begin)], first_other[at(subtree.end)]);
    }
  }

  /// B̂ = L β of the columns that were planned for. rows: of L by path position, and after these what else columns stand
  /// in; zero where they end. Returns true if B̂ is known to be finite.
  template <class Matrix>
  bool operator()(const MatrixX<Scalar>& rows, const Array<BetaColumn>& columns, Matrix& Bhat)
  {
    Scalar check(0);
    if (roots_ != 1) { Bhat.setZero(); }
    const LimbFactors<Scalar> factors{rows.data(), rows.rows(), path_end_.data(), Bhat.data()};
    for (const LimbTile& tile : tiles_) {
      switch (tile.count) {
        case 4: multiply<4>(tile, factors, check); break;
        case 2: multiply<2>(tile, factors, check); break;
        default: multiply<1>(tile, factors, check);
      }
    }
    for (Index j = mirrored_; j < mirrored_end_; ++j) {
      const Index row = first_mirrored_ + j - mirrored_;
      const Scalar* const column = Bhat.data() + columns[at(j)].begin;
      for (Index i = j + 1; i < mirrored_end_; ++i) { Bhat.data()[columns[at(i)].begin + row] = column[row + i - j]; }
    }
    return is_register<Scalar> && detail::is_finite(check);
  }

private:
  /// Columns j … j_end of the product for one limb. Rows of the limb itself are zero beyond their own path position.
  void add_tiles(const Limb& limb, const Array<BetaColumn>& columns, Index j, Index j_end)
  {
    while (j < j_end) {
      const Index left = j_end - j;
      const int count = left >= 4 ? 4 : left >= 2 ? 2 : 1;
      LimbTile tile{limb.v, limb.v_end, limb.v_end, limb.v_end, limb.begin, 0, limb.parent < 0, count, {}, {}};
      if (j >= mirrored_ && j < mirrored_end_) {
        tile.gap = std::max(limb.v, first_mirrored_);
        tile.gap_end = first_mirrored_ + j - mirrored_;
      }
      for (int k = 0; k < tile.count; ++k, ++j) {
        const BetaColumn& column = columns[at(j)];
        tile.end = std::max(tile.end, column.depth);
        tile.row[at(k)] = column.row;
        tile.column[at(k)] = column.begin;
      }
      tile.end = std::min(tile.end, limb.end);
      tiles_.push_back(tile);
    }
  }

  struct Subtree {  ///< of a limb
    Limb limb;
    Index begin, end;  ///< subsystems
  };

  bool mirrors_;                           // whether of symmetric columns half is computed
  Index mirrored_ = 0, mirrored_end_ = 0;  // those: rows of L, of all velocities from first_mirrored_ on
  Index first_mirrored_ = 0;
  Array<Index> path_end_;  // of a row: path positions up to and including its subsystem
  Array<Subtree> subtrees_;
  Array<LimbTile> tiles_;
  Index roots_ = 0;
};

}  // namespace iim::detail
