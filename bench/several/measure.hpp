// The measurements of several/several.hpp, to be instantiated for one Scalar.
#pragma once

#include "several.hpp"

#include "../common/pool.hpp"

#include <iim/several_states.hpp>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <limits>
#include <memory>
#include <tuple>
#include <utility>
#include <vector>

namespace bench {

/// Keeps x and what led to it.
template <class T>
void keep(const T& x)
{
  __asm__ volatile("" : : "g"(&x) : "memory");
}

template <class Scalar>
double peak()
{
  using Pack = iim::Lanes<Scalar>;
  constexpr int chains = 16;  // latency times throughput of all current cores
  constexpr long steps = 200000;
  std::array<Pack, chains> sum;
  for (int k = 0; k < chains; ++k) { sum[static_cast<std::size_t>(k)] = Scalar(k); }
  double best = std::numeric_limits<double>::infinity();
  for (int round = 0; round < 20; ++round) {
    Pack a = Scalar(0.999), b = Scalar(0.001);
    __asm__ volatile("" : "+m"(a), "+m"(b));
    const auto start = std::chrono::steady_clock::now();
    auto chain = sum;
    for (long step = 0; step < steps; ++step) {
      for (Pack& x : chain) { x = x * a + b; }
    }
    const std::chrono::duration<double> time = std::chrono::steady_clock::now() - start;
    sum = chain;
    keep(sum);
    best = std::min(best, time.count());
  }
  return 2.0 * chains * steps * Pack::size / best;
}

/// A model with its inputs and a pool of random states, a column each; refers to itself and therefore stays where it
/// is.
template <class Scalar>
struct SeveralScene {
  using Tree = bench::Tree<Scalar>;
  static constexpr Index count = 512;

  explicit SeveralScene(const peers::Model& model)
      : in_double(peers::assembly(model)), assembly(in_double.template cast<Scalar>()), tree(assembly),
        inputs(peers::choose_inputs(peers::Tree(in_double), model).on(tree)), q(tree.n_q(), count),
        qd(tree.n_v(), count), u(inputs.columns(), count)
  {
    const auto pool = random_states(tree, inputs.columns(), count, 4711);
    for (Index k = 0; k < count; ++k) {
      states.push_back(pool[static_cast<std::size_t>(k)].template cast<Scalar>());
      q.col(k) = states.back().q;
      qd.col(k) = states.back().qd;
      u.col(k) = states.back().u;
    }
  }
  SeveralScene(const SeveralScene&) = delete;
  SeveralScene& operator=(const SeveralScene&) = delete;

  iim::StandardAssembly<double> in_double;
  iim::StandardAssembly<Scalar> assembly;
  Tree tree;
  iim::Inputs<Tree> inputs;
  iim::MatrixX<Scalar> q, qd, u;
  std::vector<State<Scalar>> states;
};

template <class Scalar>
SeveralTimes measure_several(const peers::Model& model, int rounds)
{
  using Tree = bench::Tree<Scalar>;
  using Several = iim::SeveralStates<Tree>;
  const SeveralScene<Scalar> scene(model);
  const Tree& tree = scene.tree;
  const auto& inputs = scene.inputs;
  const auto& states = scene.states;
  constexpr Index count = SeveralScene<Scalar>::count;
  iim::Workspace<Tree> workspace(tree);
  iim::ImplicitInversion<Tree> method(tree, inputs);
  Several several(scene.assembly, inputs);
  iim::MatrixX<Scalar> qdd(tree.n_v(), count);

  SeveralTimes times{};
  times.model = model.name;
  times.scalar = sizeof(Scalar) == 8 ? "double" : "float";
  times.lanes = Several::lanes;
  std::tie(times.operations, times.operations_with_u) = operations(model);
  several.for_each(scene.q, scene.qd, [&](Index k, const iim::AffineDynamics<Scalar>& ours) {
    const auto& x = states[static_cast<std::size_t>(k)];
    const auto one = method(iim::forward_dynamics(x.q, x.qd, workspace));
    const double apart = static_cast<double>(
        std::max((ours.Bhat - one.Bhat).norm() / one.Bhat.norm(), (ours.qdd0 - one.qdd0).norm() / one.qdd0.norm()));
    times.worst = std::max(times.worst, one.ok() && ours.ok() ? apart : std::numeric_limits<double>::infinity());
  });
  times.worst /= static_cast<double>(std::numeric_limits<Scalar>::epsilon());

  std::vector<iim::Outcome> outcomes(count);
  std::array<std::vector<double>, 5> samples;
  const auto time = [&](std::size_t which, const auto& f) {
    const auto start = std::chrono::steady_clock::now();
    f();
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start;
    samples[which].push_back(seconds.count() / count);
  };
  for (int round = 0; round < rounds; ++round) {  // the paths take turns
    time(0, [&] {
      for (const State<Scalar>& x : states) { keep(method(x.q, x.qd, workspace)); }
    });
    time(1, [&] { several.for_each_pack(scene.q, scene.qd, [](const auto& pack) { keep(pack); }); });
    time(2, [&] { several.for_each(scene.q, scene.qd, [](Index, const auto& dynamics) { keep(dynamics); }); });
    time(3, [&] {
      for (const State<Scalar>& x : states) { keep(iim::forward_dynamics(x.q, x.qd, inputs, x.u, workspace)); }
    });
    time(4, [&] { keep(several.accelerations(scene.q, scene.qd, scene.u, qdd, outcomes)); });
  }
  times.single = spread(samples[0]);
  times.packs = spread(samples[1]);
  times.matrices = spread(samples[2]);
  times.single_with_u = spread(samples[3]);
  times.several_with_u = spread(samples[4]);
  return times;
}

template <class Scalar>
Spread measure_cores(const peers::Model& model, int threads, int rounds)
{
  using Tree = bench::Tree<Scalar>;
  const SeveralScene<Scalar> scene(model);
  constexpr int repeats = 16;  // so that starting the threads (some µs) does not count
  std::vector<std::unique_ptr<iim::SeveralStates<Tree>>> cores(static_cast<std::size_t>(threads));
  const auto on_cores = [&](const auto& f) {
#ifdef _OPENMP
#pragma omp parallel for schedule(static, 1) num_threads(threads)
#endif
    for (int part = 0; part < threads; ++part) { f(cores[static_cast<std::size_t>(part)]); }
  };
  on_cores([&](auto& several) { several = std::make_unique<iim::SeveralStates<Tree>>(scene.assembly, scene.inputs); });
  std::vector<double> samples;
  for (int round = 0; round < rounds; ++round) {
    const auto start = std::chrono::steady_clock::now();
    on_cores([&](auto& several) {
      for (int k = 0; k < repeats; ++k) {
        several->for_each_pack(scene.q, scene.qd, [](const auto& pack) { keep(pack); });
      }
    });
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start;
    samples.push_back(seconds.count() / (scene.count * repeats));
  }
  return spread(samples);
}

}  // namespace bench
