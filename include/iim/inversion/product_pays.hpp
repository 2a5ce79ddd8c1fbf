// Which of its two forms implicit inversion takes: what they cost on a tree, for how many inputs.
#pragma once

#include <iim/inputs.hpp>
#include <iim/inversion/branches.hpp>
#include <iim/numerics/array.hpp>
#include <iim/numerics/lane_count.hpp>
#include <iim/numerics/row.hpp>
#include <iim/spatial.hpp>
#include <iim/tree_data.hpp>

#include <cmath>
#include <cstddef>
#include <limits>

namespace iim::detail {

/// The number of active columns from which on the product costs less than the sweep for all that may follow;
/// max_columns + 1 if it never does.
///
/// Costs are loop steps of one vector register each: where a register holds several rows or columns weighted as
/// measured with AVX-512, AVX2 and SSE2, pass and B̂ in one call, on chains to 300 links, trees to 255, the biped and
/// one to six limbs on a free base (slower by more than 10 % than the other form in 19 of 6508 cases, by 0.3 % in the
/// mean), otherwise as counted. Columns are taken to be spread over the inputs of the tree evenly.
template <class Scalar>
[[gnu::cold]] Index product_pays_from(const TreeData<Scalar>& tree, const InputBlocks<Scalar>& inputs)
{
  const Index most = inputs.max_columns_on(tree);
  constexpr double lanes = lane_count<Scalar>,
                   width = register_lanes<Scalar>;  // of a step of the product, of a narrow sweep
  constexpr double registers = lanes / width;
  struct Cost {
    double fixed, per_velocity;
  };
  constexpr bool several = lane_count<Scalar> > 1;
  if constexpr (several) {
    // L decays along a path, by about 0.8 decades per link of a chain of equal ones: where it comes to numbers without
    // a full mantissa, in float, the product takes longer (chain of 63, all joints driven: 2.1, of 100: 7 times as long
    // as by sweeps).
    constexpr int decades = -std::numeric_limits<Scalar>::min_exponent10;
    if (0.8 * static_cast<double>(tree.max_path_v()) > decades) { return most + 1; }
  }
  constexpr double node_cost = 12;
  constexpr Cost column_cost = several ? Cost{0, 17} : Cost{10, 13};
  constexpr Cost outward_cost = several ? Cost{28, 43} : Cost{12, 15};
  constexpr Cost inward_cost = several ? Cost{6, 1} : Cost{28, 15};
  constexpr double wide_cost = 1.3;  // a wide sweep of a narrow one's
  double factors = 0;                // L and H
  double everywhere = 0;             // outward loop of the sweep
  double inward = 0;                 // its inward loop, along the paths of the inputs' columns
  Array<double> path(static_cast<std::size_t>(tree.size()), 0);
  Array<double> rows(static_cast<std::size_t>(tree.size()), 0);  // products of one column of B̂ with L
  for (const Node& node : tree.nodes()) {
    const auto i = static_cast<std::size_t>(node.index);
    const auto moving = static_cast<double>(tree.velocities(node.index));
    const auto parent = static_cast<std::size_t>(node.parent);
    factors += registers * std::ceil(static_cast<double>(node.path_v) / lanes) *
                   (column_cost.fixed + column_cost.per_velocity * moving) +
               node_cost * moving * moving;
    everywhere += outward_cost.fixed + outward_cost.per_velocity * moving;
    path[i] = inward_cost.fixed + inward_cost.per_velocity * moving + (node.parent < 0 ? 0.0 : path[parent]);
    rows[i] = registers * moving * std::ceil(static_cast<double>(node.v_end - node.v) / lanes) +
              (node.parent < 0 ? 0.0 : rows[parent]);
  }
  double product = 0;
  Index rows_of_L = 0;  // columns of β that are such
  for (Index id = 0; id < inputs.blocks(); ++id) {
    const Input<Scalar>& input = inputs.block(id);
    const auto i = static_cast<std::size_t>(input.subsystem);
    product += static_cast<double>(input.size) * rows[i];
    inward += static_cast<double>(input.size) * path[i];
    if (input.kind == InputKind::motor && tree.velocities(input.subsystem) == 1) { rows_of_L += input.size; }
  }
  const double each = most > 0 ? 1 / static_cast<double>(most) : 0.0;
  const double column = product * each;
  const double sweep = everywhere + inward * each;
  // If all rows of B̂ are columns, too, half of the product is computed. The sweep's cost goes in steps of its width:
  // the last step below the product counts.
  const bool symmetric = rows_of_L == tree.n_v() && (several || paths_are_shared(tree));
  Index from = most + 1;
  for (; from > 1; --from) {
    const double count = static_cast<double>(from - 1);
    const double sweeps =
        !several || count <= width ? std::ceil(count / width) : wide_cost * std::ceil(count / (2 * width));
    const double columns = symmetric && from > most ? count / 2 : count;
    if (factors + columns * column >= sweeps * sweep) { break; }
  }
  return from;
}

}  // namespace iim::detail
