// A tile of the product B̂ = L β where a Scalar holds several states: path positions of a limb take a few columns of inputs to
// the rows of its subtree.
#pragma once

#include <iim/branches.hpp>
#include <iim/registers.hpp>
#include <iim/spatial.hpp>

#include <algorithm>
#include <array>
#include <cstddef>

namespace iim::detail {

/// Whether a Scalar is a register: then numbers that several products use are held in one.
template <class Scalar>
inline constexpr bool is_register = requires(Scalar& x) { x.hold(); };

/// L: entry (v, a) at L[v·L_stride + a], a: path position. β: entry (a, j) at beta[j·beta_stride + a].
template <class Scalar, int count>
struct LimbTile {
  const Limb& limb;
  Index depth;  ///< path positions that one of the columns reaches
  const Scalar* L;
  Index L_stride;
  const Scalar* beta;
  Index beta_stride;
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
      beta[j * depth + k] = tile.beta[j * tile.beta_stride + a + k];
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
      L.hold();
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
      all += sum[j];
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
  constexpr int most = 6;  // 24 registers for β of four columns, of 32
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

}  // namespace iim::detail
