// PART OF: iim_tables
// REQUIRES: boost
// The multiprecision reference.
#include "../common/reference.hpp"

#include <iim/global_inverse.hpp>

#include <boost/multiprecision/cpp_bin_float.hpp>

#include <stdexcept>

namespace bench {

namespace {

using Digits50 = boost::multiprecision::number<boost::multiprecision::cpp_bin_float<50>, boost::multiprecision::et_off>;

/// Throws if two results differ by more than 50 digits can on a mass matrix of condition 10¹⁰.
void agree(const SceneId& scene, const iim::AffineDynamics<Digits50>& a, const iim::AffineDynamics<Digits50>& b)
{
  const Digits50 tolerance("1e-40");
  const bool same =
      (a.qdd0 - b.qdd0).norm() <= tolerance * b.qdd0.norm() && (a.Bhat - b.Bhat).norm() <= tolerance * b.Bhat.norm();
  if (!b.ok() || !same) { throw std::runtime_error("two methods with 50 digits do not agree on the " + scene.model); }
}

}  // namespace

std::vector<Reference> references(const SceneId& scene, const std::vector<State<double>>& states)
{
  const Tree<Digits50> tree(assembly(scene).cast<Digits50>());
  const auto inputs = bench::inputs<Digits50>(scene, tree);
  iim::Workspace<Tree<Digits50>> workspace(tree);
  iim::ImplicitInversion<Tree<Digits50>> method(tree, inputs);
  iim::Workspace<Tree<Digits50>> second_workspace(tree);
  iim::GlobalInverse<Tree<Digits50>, iim::Factorization::dense> second(tree, inputs);
  std::vector<Reference> all;
  for (const State<double>& state : states) {
    const State<Digits50> x = state.cast<Digits50>();
    const auto result = method(iim::forward_dynamics(x.q, x.qd, workspace));
    if (!result.ok()) {
      throw std::runtime_error("no reference for a state of the " + scene.model + ": " + iim::to_string(result.status));
    }
    agree(scene, result, second(x.q, x.qd, second_workspace));
    all.push_back({Precise(result.qdd0), Precise(result.Bhat)});
  }
  return all;
}

}  // namespace bench
