// PART OF: iim_accuracy
// Worst errors over many states, of implicit inversion. The reference is the square-root form in long double, B̂ by unit
// forces: 2⁻¹¹ ε of double.
#include "accuracy.hpp"
#include "perturbed.hpp"

#include <iim/unit_force.hpp>

#include <algorithm>
#include <cmath>

namespace bench {

namespace {

template <class Scalar, iim::Update update, class Method>
class Tier {
public:
  Tier(const AccuracyScene& scene, const iim::StandardAssembly<Scalar>& parts)
      : tree_(parts), inputs_(accuracy_inputs(scene, tree_)), workspace_(tree_), method_(tree_, inputs_)
  {
  }
  Tier(const Tier&) = delete;
  Tier& operator=(const Tier&) = delete;

  auto operator()(const State<Scalar>& x) { return method_(iim::forward_dynamics(x.q, x.qd, workspace_)); }

private:
  const Tree<Scalar> tree_;
  iim::Inputs<Tree<Scalar>> inputs_;
  iim::Workspace<Tree<Scalar>, update> workspace_;
  Method method_;
};

using Precision = Tier<long double, iim::Update::square_root, iim::UnitForce<Tree<long double>>>;

struct Pair {
  double Bhat = 0;
  double qdd0 = 0;
};

/// In ε of double; the largest of some random perturbations.
Pair sensitivity(const AccuracyScene& scene, const State<double>& state, const Reference& exact)
{
  const auto parts = scene.parts.cast<long double>();
  const State<long double> x = state.cast<long double>();
  std::mt19937_64 source(2026);
  Pair moved;
  const int samples = state.qd.size() > 100 ? 5 : 40;
  for (int sample = 0; sample < samples; ++sample) {
    Precision other(scene, perturbed(parts, source));
    const auto result = other(perturbed(x, source));
    moved.Bhat = std::max(moved.Bhat, std::ldexp(relative_error(result.Bhat, exact.Bhat), 52));
    moved.qdd0 = std::max(moved.qdd0, std::ldexp(relative_error(result.qdd0, exact.qdd0), 52));
  }
  return moved;
}

template <class Scalar, iim::Update update>
Bound::Tier worst_of(const AccuracyScene& scene, const iim::StandardAssembly<Scalar>& parts,
                     const std::vector<Reference>& exact)
{
  const std::vector<State<double>>& states = scene.states;
  Tier<Scalar, update, iim::ImplicitInversion<Tree<Scalar>>> tier(scene, parts);
  Bound::Tier worst;
  const auto put = [](Bound::Worst& w, double error, int k) {
    if (!(error <= w.error)) {
      w.error = error;
      w.state = k;
    }
  };
  for (std::size_t k = 0; k < states.size(); ++k) {
    const auto result = tier(states[k].template cast<Scalar>());
    if (!result.ok()) {
      ++worst.Bhat.refused;
      ++worst.qdd0.refused;
      continue;
    }
    const int bits = std::numeric_limits<Scalar>::digits - 1;
    put(worst.Bhat, std::ldexp(relative_error(result.Bhat, exact[k].Bhat), bits), static_cast<int>(k));
    put(worst.qdd0, std::ldexp(relative_error(result.qdd0, exact[k].qdd0), bits), static_cast<int>(k));
  }
  for (Bound::Worst* w : {&worst.Bhat, &worst.qdd0}) {
    if (w->state < 0) { continue; }
    const auto at = static_cast<std::size_t>(w->state);
    const Pair moved = sensitivity(scene, states[at], exact[at]);
    w->sensitivity = w == &worst.Bhat ? moved.Bhat : moved.qdd0;
  }
  return worst;
}

template <class Scalar>
std::array<Bound::Tier, 3> tiers(const AccuracyScene& scene, const std::vector<Reference>& exact)
{
  try {
    const auto parts = scene.parts.template cast<Scalar>();
    return {worst_of<Scalar, iim::Update::printed>(scene, parts, exact),
            worst_of<Scalar, iim::Update::projected>(scene, parts, exact),
            worst_of<Scalar, iim::Update::square_root>(scene, parts, exact)};
  } catch (const iim::ModelError&) {
    return {};  // the tree says when it is built that the masses are none in this Scalar
  }
}

}  // namespace

std::vector<Bound> accuracy_bounds(const std::vector<AccuracyScene>& scenes)
{
  std::vector<Bound> bounds;
  for (const AccuracyScene& scene : scenes) {
    const bool repeats = scene.group == "distance" && scene.parameter != 1e6;
    const bool again = scene.group == "length" && (scene.parameter == 20 || scene.parameter == 100);
    if (repeats || again) { continue; }
    Bound bound{scene.name, static_cast<int>(scene.states.size())};
    std::vector<Reference> exact;
    Precision precision(scene, scene.parts.cast<long double>());
    for (const State<double>& x : scene.states) {
      const auto result = precision(x.cast<long double>());
      if (!result.ok()) { break; }
      exact.push_back({Precise(result.qdd0), Precise(result.Bhat)});
    }
    if (exact.size() < scene.states.size()) { continue; }  // without a solution: stands with the extreme scenes
    bound.tiers = {tiers<double>(scene, exact), tiers<float>(scene, exact)};
    bounds.push_back(bound);
  }
  return bounds;
}

}  // namespace bench
