// PROGRAM: iim_several
// Several states at once against one after the other: same states, one core, one run; and against the core's peak.
//
//     iim_several [--quick] [--out DIR]       DIR/several.md
#include "several/several.hpp"

#include "common/machine.hpp"
#include "common/report.hpp"
#include "common/table.hpp"

#include <iim_build_info.hpp>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <string>
#include <vector>

namespace {

using bench::three_digits;

void write(const std::vector<bench::SeveralTimes>& all, double peak_double, double peak_float, bench::Report& report)
{
  report.title("Several states at once");
  report.paragraph(std::string(bench::processor()) + "; " + iim_build::compiler + "; " + iim_build::flags +
                   "; commit " + iim_build::commit + "; " + bench::date() + ".");
  report.paragraph(
      "Medians, µs per state, 512 random states, the paths taking turns, one pinned core. «Lanes»: results stay "
      "one state per lane; «matrices»: each state's B̂ as a matrix of its own. Operations are counted with a "
      "counting Scalar, sin, cos, sqrt and divisions as one. Peak of fused multiply-adds in this run: double " +
      three_digits(peak_double * 1e-9) + ", float " + three_digits(peak_float * 1e-9) + " Gflop/s.");
  bench::Table table({"model", "Scalar", "what", "operations", "one by one", "lanes", "ratio", "of peak", "matrices",
                      "ratio", "apart [ε]"});
  for (const bench::SeveralTimes& t : all) {
    const double peak = t.scalar == "double" ? peak_double : peak_float;
    const auto us = [](const bench::Spread& s) { return three_digits(s.median * 1e6); };
    const auto ratio = [](const bench::Spread& a, const bench::Spread& b) { return three_digits(a.median / b.median); };
    const auto of_peak = [&](double operations, const bench::Spread& s) {
      return three_digits(100 * operations / s.median / peak) + " %";
    };
    table.add({t.model, t.scalar + " × " + std::to_string(t.lanes), "q̈₀ and B̂", three_digits(t.operations),
               us(t.single), us(t.packs), ratio(t.single, t.packs), of_peak(t.operations, t.packs), us(t.matrices),
               ratio(t.single, t.matrices), three_digits(t.worst)});
    table.add({t.model, t.scalar + " × " + std::to_string(t.lanes), "q̈ for u", three_digits(t.operations_with_u),
               us(t.single_with_u), us(t.several_with_u), ratio(t.single_with_u, t.several_with_u),
               of_peak(t.operations_with_u, t.several_with_u), "", "", ""});
  }
  report.table(table);
}

/// States per second with 1, 2, 4 … threads. Before the program keeps to one core.
bench::Table measure_all_cores(int rounds)
{
  bench::Table table({"model", "Scalar", "threads", "10⁶ states/s", "of one thread"});
  const int cores = bench::usable_cores();
  for (const peers::Model& model : bench::several_models()) {
    for (const bool in_double : {true, false}) {
      double one = 0;
      for (int threads = 1; threads <= cores && cores > 1;
           threads = threads < cores ? std::min(2 * threads, cores) : cores + 1) {
        const bench::Spread s = in_double ? bench::measure_cores<double>(model, threads, rounds)
                                          : bench::measure_cores<float>(model, threads, rounds);
        const double rate = threads / s.median;
        if (threads == 1) { one = rate; }
        table.add({model.name, in_double ? "double" : "float", std::to_string(threads), three_digits(rate * 1e-6),
                   three_digits(rate / one)});
      }
    }
  }
  return table;
}

void write_cores(const bench::Table& table, bench::Report& report)
{
  report.section("On several cores");
  if (table.empty()) {
    report.paragraph("Not measured: this run had one core, or was built without OpenMP.");
    return;
  }
  report.paragraph(
      "q̈₀ and B̂, results in lanes, 512 states on every thread; OpenMP, a SeveralStates per thread. Millions of states "
      "per second, and how often as many as with one thread.");
  report.table(table);
}

}  // namespace

int main(int argc, char** argv)
{
  std::string out;
  int rounds = 61;
  for (int k = 1; k < argc; ++k) {
    const std::string option = argv[k];
    if (option == "--quick") {
      rounds = 5;
    } else if (option == "--out" && k + 1 < argc) {
      out = argv[++k];
    } else {
      std::cerr << "usage: iim_several [--quick] [--out DIR]\n";
      return 2;
    }
  }
  const bench::Table on_cores = measure_all_cores(rounds);
  bench::pin_to_one_core();
  std::vector<bench::SeveralTimes> all;
  for (const peers::Model& model : bench::several_models()) {
    all.push_back(bench::measure_several<double>(model, rounds));
    all.push_back(bench::measure_several<float>(model, rounds));
  }
  std::ofstream file;
  if (!out.empty()) {
    std::filesystem::create_directories(out);
    file.open(std::filesystem::path(out) / "several.md");
  }
  bench::Report report(std::cout, file);
  write(all, bench::peak<double>(), bench::peak<float>(), report);
  write_cores(on_cores, report);
  for (const bench::SeveralTimes& t : all) {
    if (!(t.worst < 800)) {
      std::cerr << t.model << ", " << t.scalar << ": several states at once disagree with one by one\n";
      return 1;
    }
  }
  return 0;
}
