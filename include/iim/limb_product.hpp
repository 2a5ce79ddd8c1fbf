// The product B̂ = L β where a register holds one number, or one of several states: limb by limb, the path positions of a
// limb take the inputs on its subtree to the rows of it.
#pragma once

#include <iim/branches.hpp>
#include <iim/registers.hpp>
#include <iim/scalar.hpp>
#include <iim/spatial.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <vector>

namespace iim::detail {

/// Whether a Scalar is a register: then numbers that several products use are held in one.
template <class Scalar>
inline constexpr bool is_register = requires(Scalar& x) { x.hold(); };

/// A few columns. L: entry (v, a) at L[v·L_stride + a], a: path position. β: entry (a, j) at beta[j][a].
template <class Scalar, int count>
struct LimbTile {
  const Limb& limb;
  Index depth;  ///< path positions that one of the columns reaches
  const Scalar* L;
  Index L_stride;
  std::array<const Scalar*, count> beta;
  const Index* path_end;  ///< of a row: L is zero from this path position on
  std::array<Scalar*, count> column;  ///< of B̂
};

/// Path positions a … a + depth: β stays in registers while the rows of L pass by. (The sums in registers while L and β pass by:
/// 40 % more time for the biped's product with g++ and AVX-512; this one runs at 85 to 90 % of the processor's peak.)
template <int depth, bool assign, class Scalar, int count>
[[gnu::noinline]] void multiply_chunk(const LimbTile<Scalar, count>& tile, Index a, Scalar& check)
{
  std::array<Scalar, depth * count> beta;
  unrolled<count>([&](auto j) __attribute__((always_inline)) {
    unrolled<depth>([&](auto k) __attribute__((always_inline)) {
      beta[j * depth + k] = tile.beta[j][a + k];
    });
  });
  Index v = tile.limb.v;
  while (tile.path_end[v] <= a) { ++v; }
  const Index end = tile.limb.v_end, stride = tile.L_stride;
  const Scalar* l = tile.L + v * stride + a;
  const std::array<Scalar*, count> column = tile.column;
  Scalar all = check;
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
  check = all;
}

/// multiply_chunk<size>, for size ≤ most.
template <int most, class Scalar, int count>
[[gnu::always_inline]] inline void choose_chunk(const LimbTile<Scalar, count>& tile, Index a, Index size, Scalar& check)
{
  if (size < most) {
    if constexpr (most > 1) { choose_chunk<most - 1>(tile, a, size, check); }
  } else if (tile.limb.parent < 0 && a == tile.limb.begin) {
    multiply_chunk<most, true>(tile, a, check);
  } else {
    multiply_chunk<most, false>(tile, a, check);
  }
}

/// B̂ += L β; = L β for a limb on the world. All that is written to B̂ is added to `check`: B̂ is finite if that is.
template <class Scalar, int count>
void multiply(const LimbTile<Scalar, count>& tile, Scalar& check)
{
  constexpr int most = is_register<Scalar> ? 6 : 1;  // 24 registers for β of four columns, of 32
  if (tile.limb.parent < 0 && tile.depth <= tile.limb.begin) {  // inputs on what cannot move
    for (Scalar* column : tile.column) { std::fill(column + tile.limb.v, column + tile.limb.v_end, Scalar(0)); }
  }
  for (Index a = tile.limb.begin; a < tile.depth;) {
    const Index left = tile.depth - a;
    const Index chunks = (left + most - 1) / most;
    const Index size = (left + chunks - 1) / chunks;
    choose_chunk<most>(tile, a, size, check);
    a += size;
  }
}

template <class Scalar>
class LimbProduct {
public:
  static constexpr Index least_rows = 0;  ///< of L

  LimbProduct(const TreeData<Scalar>& tree, Index) : limbs_(tree)
  {
    for (const Node& node : tree.nodes()) {
      const Index own = tree.velocities(node.index);
      path_end_.insert(path_end_.end(), at(own), node.path_v + own);
      if (limbs_.limb_of(node.index) == static_cast<Index>(subtrees_.size())) {
        subtrees_.push_back({node.index, node.subtree_end, 0, 0});
      }
      roots_ += node.parent < 0;
    }
  }

  /// For columns that are others than before. Those on subsystems before i are the first first_column[i]; none is a row of L.
  void plan(const std::vector<BetaColumn>&, const std::vector<Index>&, const std::vector<Index>& first_column)
  {
    for (Subtree& subtree : subtrees_) {
      subtree.columns = first_column[at(subtree.begin)];
      subtree.columns_end = first_column[at(subtree.end)];
    }
  }

  /// B̂ = L β of the columns that were planned for. rows: of L by path position, and after these the columns; zero where
  /// they end. Returns true if B̂ is known to be finite.
  template <class Matrix>
  bool operator()(const MatrixX<Scalar>& rows, const std::vector<BetaColumn>& columns, Matrix& Bhat)
  {
    check_ = Scalar(0);
    if (roots_ != 1) { Bhat.setZero(); }
    for (Index k = 0; k < limbs_.size(); ++k) {
      const Index end = subtrees_[at(k)].columns_end;
      Index j = subtrees_[at(k)].columns;
      for (; j + 4 <= end; j += 4) { multiply_tile<4>(limbs_[k], rows, columns.data() + j, Bhat); }
      if constexpr (is_register<Scalar>) {
        for (; j + 2 <= end; j += 2) { multiply_tile<2>(limbs_[k], rows, columns.data() + j, Bhat); }
      }
      for (; j < end; ++j) { multiply_tile<1>(limbs_[k], rows, columns.data() + j, Bhat); }
    }
    return is_register<Scalar> && detail::is_finite(check_);
  }

private:
  /// `count` columns of the product for one limb. Rows of the limb itself are zero beyond their own path position.
  template <int count, class Matrix>
  void multiply_tile(const Limb& limb, const MatrixX<Scalar>& rows, const BetaColumn* columns, Matrix& Bhat)
  {
    LimbTile<Scalar, count> tile{limb, 0, rows.data(), rows.rows(), {}, path_end_.data(), {}};
    for (int j = 0; j < count; ++j) {
      tile.depth = std::max(tile.depth, columns[j].depth);
      tile.beta[at(j)] = rows.data() + columns[j].row * rows.rows();
      tile.column[at(j)] = Bhat.data() + columns[j].begin;
    }
    tile.depth = std::min(tile.depth, limb.end);
    multiply(tile, check_);
  }

  static constexpr std::size_t at(Index i) { return static_cast<std::size_t>(i); }

  struct Subtree {
    Index begin, end;            ///< subsystems
    Index columns, columns_end;  ///< on them
  };

  Limbs limbs_;
  std::vector<Index> path_end_;  // of a row: path positions up to and including its subsystem
  std::vector<Subtree> subtrees_;  // of a limb
  Index roots_ = 0;
  Scalar check_;  // the sum of all that was written to B̂, if Scalar is a register
};

}  // namespace iim::detail
