// PART OF: iim_accuracy
// Times: variants that are compared take turns, so that whatever else the machine does meets all of them alike.
#include "../common/statistics.hpp"
#include "../common/table.hpp"
#include "report.hpp"

#include <iim/models.hpp>

#include <algorithm>
#include <chrono>
#include <stdexcept>

namespace bench {

namespace {

/// Samples per pass in µs per state, in the order of turns. Who has used up `seconds` drops out.
std::vector<std::vector<double>> take_turns(const std::vector<Pass>& passes, int turns, double seconds)
{
  using Clock = std::chrono::steady_clock;
  std::vector<std::vector<double>> samples(passes.size());
  std::vector<double> spent(passes.size());
  for (int turn = 0; turn < turns + 2; ++turn) {
    for (std::size_t k = 0; k < passes.size(); ++k) {
      if (spent[k] > seconds) { continue; }
      passes[k].run();  // its memory back into the caches
      const auto begin = Clock::now();
      passes[k].run();
      const double time = std::chrono::duration<double>(Clock::now() - begin).count();
      spent[k] += 2 * time;
      if (turn > 1 || spent[k] > seconds) { samples[k].push_back(1e6 * time / static_cast<double>(passes[k].states)); }
    }
  }
  return samples;
}

/// Quartiles of a sample by sample of the same turn.
Spread ratio(const std::vector<double>& a, const std::vector<double>& b)
{
  std::vector<double> ratios;
  for (std::size_t k = 0; k < std::min(a.size(), b.size()); ++k) { ratios.push_back(a[k] / b[k]); }
  return spread(ratios);
}

std::string with_quartiles(const Spread& s)
{
  return three_digits(s.median) + " (" + three_digits(s.lower) + " … " + three_digits(s.upper) + ")";
}

}  // namespace

void measure_times(AccuracyResult& result)
{
  std::vector<Pass> passes = accuracy_passes<float>(result.scene);
  for (auto more : {accuracy_passes<double>(result.scene), accuracy_passes<long double>(result.scene)}) {
    passes.insert(passes.end(), more.begin(), more.end());
  }
  const auto samples = take_turns(passes, 31, 0.2);
  for (std::size_t k = 0; k < passes.size(); ++k) {
    for (Outcome& o : result.outcomes) {
      if (o.variant == passes[k].variant && o.scalar == passes[k].scalar) { o.time = spread(samples[k]).median; }
    }
  }
}

void write_costs(bool quick, Report& report)
{
  report.section("What the tiers cost");
  report.paragraph(
      "The biped with 38 inputs, q̈₀ and all of B̂, tree made at run time, 64 random states (seed 4711), on one core; "
      "the "
      "variants take turns. Median and quartiles, of a ratio those of the ratios turn by turn. «Cholesky» is the "
      "faster of the "
      "library's global inverses, kinematics and composites included.");
  const std::vector<std::string> names{"implicit inversion, printed", "implicit inversion, projected",
                                       "implicit inversion, square root", "branch-sparse Cholesky", "dense Cholesky"};
  Table times({"biped, 38 inputs: time [µs]", "printed", "projected", "square root", "branch-sparse Cholesky",
               "dense Cholesky"});
  Table ratios({"biped, 38 inputs: ratio", "measured", "at most", "aim"});
  for (const auto& [motors, name] : {std::pair{iim::models::Motors::ideal, "ideal motors"},
                                     std::pair{iim::models::Motors::geared, "geared motors"}}) {
    AccuracyScene scene{name, "cost", 0, iim::models::biped<double>(motors)};
    scene.points = {iim::models::biped_contacts.begin(), iim::models::biped_contacts.end()};
    scene.states = random_states(Tree<double>(scene.parts), 0, 64, 4711);
    std::vector<Pass> passes;  // float first
    for (auto all : {accuracy_passes<float>(scene), accuracy_passes<double>(scene)}) {
      for (const std::string& wanted : names) {
        const auto at = std::find_if(all.begin(), all.end(), [&](const Pass& p) { return p.variant == wanted; });
        if (at == all.end()) { throw std::logic_error("no variant '" + wanted + "'"); }
        passes.push_back(*at);
      }
    }
    const auto samples = take_turns(passes, quick ? 101 : 1001, 20);
    const std::size_t count = names.size();
    for (const std::size_t first : {count, std::size_t{0}}) {
      std::vector<std::string> row{std::string(name) + (first == 0 ? ", float" : ", double")};
      for (std::size_t k = 0; k < count; ++k) { row.push_back(with_quartiles(spread(samples[first + k]))); }
      times.add(row);
    }
    const auto& in_float = samples[2];
    const auto& printed = samples[count];
    const bool sparse = spread(samples[count + 3]).median < spread(samples[count + 4]).median;
    const auto& cholesky = samples[count + (sparse ? 3 : 4)];
    ratios.add({std::string(name) + ": projected / printed", with_quartiles(ratio(samples[count + 1], printed)), "1.15",
                "1.05"});
    ratios.add({std::string(name) + ": square root / printed", with_quartiles(ratio(samples[count + 2], printed)),
                "2.5", "1.7"});
    ratios.add({std::string(name) + ": square root in float / Cholesky in double",
                with_quartiles(ratio(in_float, cholesky)), "0.6", "0.35"});
    ratios.add({std::string(name) + ": printed in float / Cholesky in double",
                with_quartiles(ratio(samples[0], cholesky)), "–", "–"});
  }
  report.table(times);
  report.table(ratios);
}

}  // namespace bench
