// Small pivots, as in mended_root.hpp, of subsystems with several frames, or with several velocities and rotors. The
// sums are over all of its frames, rotors and springs; A' = ΣA − V Vᵀ, V = U C, as no column S is there that it must be
// zero along.
//
// (Compounds, parallelograms and flexible links in a row, with geared rotors: of 200 random robots, ten states each, B̂
// is off by no more than 200 times what rounding the data makes, without by 2·10⁴. A wrist as one compound, stretched
// out but for 10⁻³ rad, under 1, 10³, 10⁶ times its weight: B̂ 1.5, 1.7, 630 ε in half of 60 states, 13, 6, 3000 at
// most; without 4, 1800, 6·10⁵, and 17, 10⁴, 10⁷.)
#pragma once

#include <iim/pass/mended_root.hpp>

#include <array>
#include <cstddef>

namespace iim::detail {

/// To V = U C and W, and the root C and D⁻¹. scale: of D's diagonal. False, and all as it was, if that cannot be.
template <class Scalar, int n, class Data>
[[gnu::noinline]] bool mend_compound(const Node& node, const Eigen::Matrix<Scalar, n, n>& D,
                                     const Eigen::Matrix<Scalar, n, 1>& scale, bool springs, Data& ws,
                                     bool& all_positive, Eigen::Matrix<Scalar, n, n>& C_of_A,
                                     Eigen::Matrix<Scalar, n, n>& D_inv, SixColumns<Scalar, n>& V,
                                     SixColumns<Scalar, n>& W)
{
  using Lane = EightLanes<Scalar>;
  Eigen::Matrix<Scalar, n, n> C = C_of_A, L;
  if (!all_positive) [[unlikely]] { root_of_inverse<Scalar, n, true>(D, scale, C); }
  std::array<Lane, static_cast<std::size_t>(n)> G;
  for (Lane& column : G) { clear<Scalar>(column); }
  Motions<Lane> wrench;
  ws.bodies_beyond().add_of_velocities(is_enough_for_each<Scalar>(ws), node, C, springs, ws, G, wrench);
  if (!lower_root<Scalar, n>(G, L)) { return false; }
  divide(C, L);
  bool positive;
  if (!stand_out(C, scale, ws, positive)) { return false; }
  divided_columns<Scalar, n>(wrench, L, V);
  times_transposed_root(V, C, W);
  C_of_A = C;
  square_of_root(C, D_inv);
  all_positive = positive;
  return true;
}

}  // namespace iim::detail
