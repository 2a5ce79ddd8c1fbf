// PART OF: iim_tables
// REQUIRES: benchmark
// Runs the study through Google Benchmark, one scene after the other.
#include "study.hpp"

#include "../common/reference.hpp"
#include "../common/table.hpp"
#include "methods.hpp"

#include <chrono>
#include <iterator>
#include <map>
#include <numeric>
#include <ostream>
#include <stdexcept>
#include <string>

namespace bench {

namespace {

/// Hands everything to Google Benchmark's own JSON, over all scenes one document, and keeps the repetitions' times.
class Collector final : public benchmark::BenchmarkReporter {
public:
  explicit Collector(std::ostream& json)
  {
    json_.SetOutputStream(&json);
    json_.SetErrorStream(&json);
  }

  bool ReportContext(const Context& context) override
  {
    const bool first = !std::exchange(begun_, true);
    return first ? json_.ReportContext(context) : true;
  }

  void ReportRuns(const std::vector<Run>& runs) override
  {
    json_.ReportRuns(runs);
    for (const Run& run : runs) {
      if (run.run_type == Run::RT_Iteration) { times_[run.run_name.function_name].push_back(run.GetAdjustedCPUTime()); }
    }
  }

  /// After the last scene.
  void close() { json_.Finalize(); }

  std::vector<double> take(const std::string& name) { return std::exchange(times_[name], {}); }

private:
  benchmark::JSONReporter json_;
  bool begun_ = false;
  std::map<std::string, std::vector<double>> times_;
};

std::string text_of(const SceneId& scene)
{
  return scene.model + "/n:" + std::to_string(scene.n) + "/m:" + std::to_string(scene.m);
}

/// A guess of how long a scene takes, to say how much is done.
double weight(const SceneId& scene, const Effort& effort)
{
  const double work = 0.1 * static_cast<double>(scene.n * scene.m) * 1e-6;  // unit forces as published: µs
  return effort.min_time + work;
}

/// Worst error over the states that have a reference. Throws std::runtime_error where roundings do not explain it.
void compare(Runner& runner, const Method& method, const std::vector<Reference>& references, Index m, Record& record)
{
  record.error_qdd0 = 0;
  record.error_Bhat = method.gives_Bhat ? 0 : std::numeric_limits<double>::quiet_NaN();
  for (std::size_t k = 0; k < references.size(); ++k) {
    const Result result = runner.at(k);
    const double error_qdd0 = relative_error(result.qdd0, references[k].qdd0);
    if (!(error_qdd0 <= method.most)) {
      throw std::runtime_error("q̈₀ of '" + method.name + "' is wrong by " + std::to_string(error_qdd0));
    }
    record.error_qdd0 = std::max(record.error_qdd0, error_qdd0);
    if (method.gives_Bhat) {
      const Precise Bhat = references[k].Bhat.right_columns(m);
      const double error = relative_error(result.Bhat, Bhat);
      if (!(error <= method.most)) {
        throw std::runtime_error("B̂ of '" + method.name + "' is wrong by " + std::to_string(error));
      }
      record.error_Bhat = std::max(record.error_Bhat, error);
    }
  }
}

}  // namespace

Effort effort(bool quick)
{
  if (quick) { return {9, 0.001, 32, 2, {1, 2, 4, 6, 8, 10, 14, 18, 22, 30, 40, 50}, {1, 10, 25, 40, 50}}; }
  Effort full{31, 0.003, 64, 16, {}, {1, 2, 5, 10, 15, 20, 25, 30, 35, 40, 45, 50}};
  for (Index n = 1; n <= 24; ++n) { full.chain_n.push_back(n); }
  for (Index n = 26; n <= longest; n += 2) { full.chain_n.push_back(n); }
  return full;
}

std::vector<SceneId> scenes(const Effort& effort)
{
  std::vector<SceneId> all;
  for (const Index n : effort.chain_n) {
    all.push_back({"chain", n, 1});
    if (n > 1) { all.push_back({"chain", n, n}); }
  }
  for (const Index m : effort.inputs) {
    if (m != 1 && m != longest) { all.push_back({"chain", longest, m}); }
  }
  for (const Index m : effort.inputs) { all.push_back({"tree", longest, m}); }
  for (const Index m : {Index(1), full_tree}) { all.push_back({"tree", full_tree, m}); }
  all.push_back({"biped", 20, 38});
  return all;
}

Records measure(const std::vector<Method>& methods, const Effort& effort, std::ostream& progress, std::ostream& json)
{
  using Clock = std::chrono::steady_clock;
  constexpr std::uint64_t seed = 20;
  const std::vector<SceneId> planned = scenes(effort);
  const auto total = std::accumulate(planned.begin(), planned.end(), 0.0,
                                     [&](double sum, const SceneId& scene) { return sum + weight(scene, effort); });
  std::map<std::pair<std::string, Index>, std::vector<Reference>> references;
  Collector collector(json);
  Records records;
  double done = 0;
  const auto begin = Clock::now();
  for (const SceneId& id : planned) {
    const double seconds = std::chrono::duration<double>(Clock::now() - begin).count();
    progress << text("[%3.0f %%] ", 100 * done / total) << id.model << ", n = " << id.n << ", m = " << id.m << ": "
             << methods.size() << " methods, " << effort.repetitions << " repetitions each";
    if (done > 0.02 * total) { progress << text(", %.0f s to go", seconds * (total - done) / done); }
    progress << std::endl;

    const Scene<double> scene(id, effort.states, seed);
    std::vector<Reference>& reference = references[{id.model, id.n}];
    if (reference.empty()) {
      // Fewer inputs are the last columns of all of them.
      const SceneId actuated{id.model, id.n, id.model == "biped" ? id.m : id.n};
      reference = bench::references(actuated, {scene.states.begin(), scene.states.begin() + effort.reference_states});
    }

    benchmark::ClearRegisteredBenchmarks();
    std::vector<std::unique_ptr<Runner>> runners;
    for (const Method& method : methods) {
      runners.push_back(method.make(scene));
      Runner* runner = runners.back().get();
      benchmark::RegisterBenchmark((text_of(id) + "/" + method.id).c_str(),
                                   [runner](benchmark::State& state) {
                                     while (state.KeepRunningBatch(state.max_iterations)) {
                                       runner->run(static_cast<std::int64_t>(state.max_iterations));
                                     }
                                   })
          ->Iterations(evaluations(*runner, effort.min_time))
          ->Repetitions(effort.repetitions)
          ->Unit(benchmark::kMicrosecond);
    }
    benchmark::RunSpecifiedBenchmarks(&collector);

    const std::size_t first = records.all.size();
    for (std::size_t k = 0; k < methods.size(); ++k) {
      Record record{id, methods[k].id, spread(collector.take(text_of(id) + "/" + methods[k].id)), 0, 0, 0};
      compare(*runners[k], methods[k], reference, id.m, record);
      records.all.push_back(record);
    }
    const double unit = records.find(id, product)->time.median;
    for (std::size_t k = first; k < records.all.size(); ++k) {
      records.all[k].ratio = records.all[k].time.median / unit;
    }
    done += weight(id, effort);
  }
  collector.close();
  benchmark::ClearRegisteredBenchmarks();
  progress << "[100 %] measured" << std::endl;
  return records;
}

}  // namespace bench
