// Which robots hold loads that q̈ is made better for, or have free bodies too light for it: second_look.hpp.
#pragma once

#include <iim/body.hpp>
#include <iim/numerics/array.hpp>
#include <iim/pass/free_axis.hpp>
#include <iim/scalar.hpp>
#include <iim/spatial.hpp>
#include <iim/tree_data.hpp>

#include <cstddef>

namespace iim::detail {

/// Whether a body weighs `times` as much as one further inward: its mass at the longest lever within the robot, and
/// its moments. (By the mass alone a flywheel on light links has q̈₀ of as many ε as it is heavier than they are.)
/// of_free: of a free body its moments alone, by which it takes what passes at a lever. (Square root: a free base as
/// heavy as its limb's links, small as a fist, a link's centre 3 m away: q̈₀ 600 ε without. Not in the default form: a
/// UR5 on such a base would take 36 % longer, and lost nothing.)
template <class Scalar>
[[gnu::cold]] bool is_heavier(const TreeData<Scalar>& tree, int times, bool of_free)
{
  const auto at = [](Index i) { return static_cast<std::size_t>(i); };
  const auto is_positive = [](const Scalar& x) { return ScalarTraits<Scalar>::is_positive(x); };
  Scalar lever(0);  // squared
  for (const Node& node : tree.nodes()) {
    if (node.parent >= 0) { lever = larger(lever, tree.placement(node.index).p.squaredNorm()); }
  }
  for (Index f = 0; f < tree.n_frames(); ++f) { lever = larger(lever, tree.frame_mass(f).com.squaredNorm()); }
  if (!is_positive(lever)) { lever = Scalar(1); }
  Array<Scalar> lightest(at(tree.size()), Scalar(0));  // of those inward of a subsystem, and its own; 0: none
  bool has = false;
  for (const Node& node : tree.nodes()) {
    Scalar& light = lightest[at(node.index)];
    if (node.parent >= 0) { light = lightest[at(node.parent)]; }
    const Scalar inward = light;
    const bool turns_freely = of_free && node.inlet < 0 && tree.velocities(node.index) == 6;
    for (Index f = node.frame; f < tree.end_of_frames(node.index); ++f) {
      const FrameMass<Scalar>& body = tree.frame_mass(f);
      const Scalar weight = body.mass * lever + sum_of_moments(body.central_inertia);
      if (!body.present || !is_positive(weight)) { continue; }
      has |= is_positive(inward) && is_positive(weight - Scalar(times) * inward);
      const Scalar held = turns_freely ? sum_of_moments(body.central_inertia) : weight;
      if (is_positive(held) && (!is_positive(light) || is_positive(light - held))) { light = held; }
    }
  }
  return has;
}

/// Whether limbs on a free body, but for the heaviest, weigh 64 times as much as it, or one body 1/(64 ε) times: of
/// what passes from one to the other, sums have roundings along a motion that it makes alone (common_motion.hpp).
template <class Scalar>
[[gnu::cold]] bool outweigh_free(const Array<FreeAxis<Scalar>>& free, const TreeData<Scalar>& tree)
{
  const auto at = [](Index i) { return static_cast<std::size_t>(i); };
  Array<Scalar> carried(at(tree.size()), Scalar(0));
  Scalar load(0);
  for (Index f = 0; f < tree.n_frames(); ++f) { load = larger(load, tree.frame_mass(f).mass); }
  for (Index i = tree.size(); i-- > 0;) {
    for (Index f = tree.node(i).frame; f < tree.end_of_frames(i); ++f) { carried[at(i)] += tree.frame_mass(f).mass; }
    if (tree.node(i).parent >= 0) { carried[at(tree.node(i).parent)] += carried[at(i)]; }
  }
  for (const FreeAxis<Scalar>& axis : free) {
    Scalar heaviest(0), all(0);
    for (const Node& node : tree.nodes()) {
      if (node.inlet != axis.frame) { continue; }
      heaviest = larger(heaviest, carried[at(node.index)]);
      all += carried[at(node.index)];
    }
    const Scalar own = Scalar(64) * tree.frame_mass(axis.frame).mass;
    const Scalar most =
        larger(Scalar(all - heaviest), Scalar(load * (Scalar(4096) * Eigen::NumTraits<Scalar>::epsilon())));
    if (ScalarTraits<Scalar>::is_positive(most - own)) { return true; }
  }
  return false;
}

}  // namespace iim::detail
