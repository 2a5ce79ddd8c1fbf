// PART OF: iim_tables
// REQUIRES: benchmark
// Measures tables/cost.hpp: scenes and their two paths take turns.
#include "cost.hpp"

#include "../common/methods.hpp"

#include <cmath>
#include <cstdint>
#include <ctime>
#include <functional>
#include <limits>
#include <memory>
#include <vector>

#if defined(__GLIBC__)
#include <malloc.h>
#endif

namespace bench {

namespace {

constexpr std::uint64_t seed = 20;

double thread_seconds()
{
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

/// Bytes that the process has asked for and not given back; NaN if unknown.
double heap_in_use()
{
#if defined(__GLIBC__) && (__GLIBC__ > 2 || __GLIBC_MINOR__ >= 33)
  const auto info = mallinfo2();
  return static_cast<double>(info.uordblks) + static_cast<double>(info.hblkhd);
#else
  return std::numeric_limits<double>::quiet_NaN();
#endif
}

/// Implicit inversion after a pass that is over. In one call with it, part of either runs in the other's waiting, and a
/// difference of times is not what B̂ takes.
class ApartFromPass {
public:
  ApartFromPass(const Tree<double>& tree, const iim::Inputs<Tree<double>>& inputs) : method_(tree, inputs) {}

  template <class Workspace>
  iim::AffineDynamics<double> operator()(const iim::ForwardDynamics<Workspace>& fd)
  {
    return method_(fd);
  }

private:
  iim::ImplicitInversion<Tree<double>> method_;
};

double bytes_of_workspace_and_method()
{
  const Scene<double> scene({"chain", 1000, 1}, 1, seed);
  const double before = heap_in_use();
  const auto workspace = std::make_unique<iim::Workspace<Tree<double>>>(scene.tree);
  const auto method = std::make_unique<iim::ImplicitInversion<Tree<double>>>(scene.tree, scene.inputs);
  return heap_in_use() - before;
}

}  // namespace

CostOfGrowth cost_of_growth(bool quick)
{
  CostOfGrowth cost{};
  cost.bytes = bytes_of_workspace_and_method();
  struct Entry {
    SceneId id;
    CostOfGrowth::Scene* result;
    std::unique_ptr<Scene<double>> scene{};
    std::unique_ptr<Runner> pass{}, full{}, apart{};
    std::int64_t evaluations = 0;
    std::vector<double> pass_samples{}, full_samples{}, apart_samples{};
  };
  std::vector<Entry> entries;
  entries.push_back({{"chain", 50, 1}, &cost.chain_50_one});
  entries.push_back({{"chain", 50, 50}, &cost.chain_50});
  entries.push_back({{"chain", 63, 63}, &cost.chain_63});
  entries.push_back({{"tree", 63, 63}, &cost.tree_63});
  entries.push_back({{"chain", 1000, 1000}, &cost.chain_1000});
  for (Entry& entry : entries) {
    entry.scene = std::make_unique<Scene<double>>(entry.id, entry.id.n > 100 ? 4 : 64, seed);
    entry.pass = make_runner<PassRunner<>>(*entry.scene);
    entry.full = make_runner<MethodRunner<iim::ImplicitInversion<Tree<double>>>>(*entry.scene);
    entry.apart = make_runner<MethodRunner<ApartFromPass>>(*entry.scene);
    entry.full->at(0);  // throws if it fails
    entry.evaluations = evaluations(*entry.full, 1e-3);
  }
  const auto time = [](Runner& runner, std::int64_t count, std::vector<double>& samples) {
    const double start = thread_seconds();
    runner.run(count);
    samples.push_back(1e6 * (thread_seconds() - start) / static_cast<double>(count));
  };
  for (int round = 0; round < (quick ? 9 : 61); ++round) {
    for (Entry& entry : entries) {
      time(*entry.pass, entry.evaluations, entry.pass_samples);
      time(*entry.full, entry.evaluations, entry.full_samples);
      time(*entry.apart, entry.evaluations, entry.apart_samples);
    }
  }
  for (Entry& entry : entries) {
    *entry.result = {spread(entry.pass_samples), spread(entry.full_samples), spread(entry.apart_samples)};
  }
  return cost;
}

Table cost_table(const CostOfGrowth& cost)
{
  Table table({"implicit inversion", "time or size", "of", "ratio"});
  const auto us = [](double x) { return three_digits(x) + " µs"; };
  const auto row = [&](const char* what, double a, double b) { table.add({what, us(a), us(b), three_digits(a / b)}); };
  const auto beyond = [](const CostOfGrowth::Scene& scene) { return scene.apart.median - scene.pass.median; };
  row("chain of 50: 50 inputs / one input", cost.chain_50.full.median, cost.chain_50_one.full.median);
  row("after the O(n) pass, all inputs: tree of 63 / chain of 63", beyond(cost.tree_63), beyond(cost.chain_63));
  const double per_entry = cost.chain_1000.full.median / 1e6;
  const double per_entry_50 = cost.chain_50.full.median / 2500;
  table.add({"per entry of B̂, all inputs: chain of 1000 / chain of 50", text("%.2f ns", 1e3 * per_entry),
             text("%.2f ns", 1e3 * per_entry_50), three_digits(per_entry / per_entry_50)});
  table.add({"memory of workspace and method, chain of 1000, one input",
             std::isfinite(cost.bytes) ? text("%.2f MB", 1e-6 * cost.bytes) : std::string("unknown"), "", ""});
  return table;
}

}  // namespace bench
