// Scenes of the study, and the pool of random states that a benchmark cycles through.
#pragma once

#include <iim/iim.hpp>
#include <iim/models.hpp>

#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace bench {

using iim::Index;

/// A model of the paper's study with its inputs.
struct SceneId {
  std::string model;  ///< "chain", "tree" or "biped"
  Index n;            ///< degrees of freedom
  Index m;            ///< columns of B̂. chain, tree: motors of the last m links; biped: all 14 motors and 8 points

  auto operator<=>(const SceneId&) const = default;
};

/// The tree that a user has who assembles a robot at run time.
template <class Scalar>
using Tree = decltype(iim::DynamicTree(std::declval<const iim::StandardAssembly<Scalar>&>()));

inline iim::StandardAssembly<double> assembly(const SceneId& scene)
{
  if (scene.model == "chain") { return iim::models::chain<double>(scene.n); }
  if (scene.model == "tree") { return iim::models::binary_tree<double>(scene.n); }
  if (scene.model == "biped") { return iim::models::biped<double>(); }
  throw std::invalid_argument("there is no model '" + scene.model + "'");
}

template <class Scalar>
iim::Inputs<Tree<Scalar>> inputs(const SceneId& scene, const Tree<Scalar>& tree)
{
  using Inputs = iim::Inputs<Tree<Scalar>>;
  if (scene.model == "biped") {
    Inputs inputs(tree);
    for (const char* contact : iim::models::biped_contacts) { inputs.add_force(contact); }
    return inputs;
  }
  Inputs inputs(tree, iim::Start::empty);
  for (Index i = scene.n - scene.m; i < scene.n; ++i) { inputs.add_motor("link" + std::to_string(i)); }
  return inputs;
}

template <class Scalar>
struct State {
  iim::VectorX<Scalar> q;
  iim::VectorX<Scalar> qd;
  iim::VectorX<Scalar> u;

  template <class T>
  State<T> cast() const
  {
    return {q.template cast<T>(), qd.template cast<T>(), u.template cast<T>()};
  }
};

/// x rounded to a number that `float` holds. By way of memory: g++ 12 with -O3 and AVX-512 drops the rounding of four
/// at once.
inline double to_float(double x)
{
  const volatile float rounded = static_cast<float>(x);
  return static_cast<double>(rounded);
}

/// The same random numbers with every standard library.
class Random {
public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}
  /// Uniform in (−1, 1), a number that `float` holds: all scalars start from the same state.
  double operator()() { return to_float(std::ldexp(static_cast<double>(engine_() >> 11), -52) - 1); }

private:
  std::mt19937_64 engine_;
};

/// `count` random states: joints in (−π, π), all rates in (−2, 2), bases in (−1, 1) m and any orientation, m inputs in
/// (−1, 1). Every number is one that `float` holds. q and q̇ do not depend on m.
template <class TreeType>
std::vector<State<double>> random_states(const TreeType& tree, Index m, int count, std::uint64_t seed)
{
  Random random(seed);
  Random random_input(seed + 1);
  std::vector<State<double>> states;
  for (int k = 0; k < count; ++k) {
    State<double> x{Eigen::VectorXd(tree.n_q()), Eigen::VectorXd(tree.n_v()), Eigen::VectorXd(m)};
    tree.outward([&]<class N, class S>(const N& node, const S&) {
      auto q = x.q.template segment<S::n_q>(node.q);
      if constexpr (S::n_q == 7 && S::n_i == 6) {
        Eigen::Vector4d quaternion;
        do {
          for (double& c : quaternion) { c = random(); }
        } while (quaternion.norm() < 0.1 || quaternion.norm() > 1);  // uniform on the sphere
        quaternion.normalize();
        for (int d = 0; d < 3; ++d) { q(d) = random(); }
        for (int d = 0; d < 4; ++d) { q(3 + d) = to_float(quaternion(d)); }
      } else {
        for (int d = 0; d < S::n_q; ++d) { q(d) = to_float(std::numbers::pi * random()); }
      }
      for (int d = 0; d < S::n_i; ++d) { x.qd(node.v + d) = 2 * random(); }
    });
    for (double& u : x.u) { u = random_input(); }
    states.push_back(std::move(x));
  }
  return states;
}

/// A tree, its inputs and its pool of states; refers to itself and therefore stays where it is.
template <class Scalar>
struct Scene {
  Scene(const SceneId& scene, const iim::StandardAssembly<Scalar>& parts, int count, std::uint64_t seed)
      : id(scene), tree(parts), inputs(bench::inputs<Scalar>(scene, tree))
  {
    for (const State<double>& x : random_states(tree, inputs.columns(), count, seed)) {
      states.push_back(x.template cast<Scalar>());
    }
  }
  /// The model's numbers are those that `double` holds, whatever the Scalar.
  Scene(const SceneId& scene, int count, std::uint64_t seed)
      : Scene(scene, bench::assembly(scene).template cast<Scalar>(), count, seed)
  {
  }
  Scene(const Scene&) = delete;
  Scene& operator=(const Scene&) = delete;

  SceneId id;
  Tree<Scalar> tree;
  iim::Inputs<Tree<Scalar>> inputs;
  std::vector<State<Scalar>> states;
};

}  // namespace bench
