// PROGRAM: iim_tables
// REQUIRES: benchmark boost
// The paper's study, Sect. 5: Figs. 3 and 4, Tables 1 to 3, for all methods of the library.
#include "common/machine.hpp"
#include "tables/cost.hpp"
#include "tables/methods.hpp"
#include "tables/report.hpp"
#include "tables/study.hpp"

#include <iim_build_info.hpp>

#include <benchmark/benchmark.h>

#include <chrono>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <string>
#include <vector>

namespace {

constexpr const char* usage =
    "usage: iim_tables --out FOLDER [--quick]\n"
    "\n"
    "Measures all methods on the models of the paper's study and writes into FOLDER:\n"
    "  report.md, *.svg   tables and figures\n"
    "  tables.csv         all medians, quartiles and errors\n"
    "  benchmark.json     every repetition, as Google Benchmark writes it\n"
    "--quick              fewer sizes and repetitions, less than a minute\n";

bench::Options read(int argc, char** argv)
{
  bench::Options options;
  for (int k = 1; k < argc; ++k) {
    const std::string argument = argv[k];
    if (argument == "--quick") {
      options.quick = true;
    } else if (argument == "--out" && k + 1 < argc) {
      options.out = argv[++k];
    } else if (argument == "--help" || argument == "-h") {
      std::cout << usage;
      std::exit(0);
    } else {
      throw std::invalid_argument("'" + argument + "' is not understood");
    }
  }
  if (options.out.empty()) { throw std::invalid_argument("--out FOLDER is missing"); }
  return options;
}

void run(const bench::Options& options)
{
  using Clock = std::chrono::steady_clock;
  const auto begin = Clock::now();
  const std::filesystem::path folder = options.out;
  std::filesystem::create_directories(folder);
  std::ofstream json(folder / "benchmark.json");
  if (!json) { throw std::runtime_error("cannot write " + (folder / "benchmark.json").string()); }

  std::vector<std::string> words{"iim_tables", "--benchmark_enable_random_interleaving=true"};
  std::vector<char*> arguments;
  for (std::string& word : words) { arguments.push_back(word.data()); }
  int count = static_cast<int>(arguments.size());
  arguments.push_back(nullptr);
  benchmark::Initialize(&count, arguments.data());
  benchmark::AddCustomContext("iim_commit", iim_build::commit);
  benchmark::AddCustomContext("compiler", iim_build::compiler);
  benchmark::AddCustomContext("flags", iim_build::flags);
  benchmark::AddCustomContext("eigen", iim_build::eigen);
  benchmark::AddCustomContext("processor", bench::processor());

  const double load = bench::load_average();
  const int core = bench::pin_to_one_core();
  const bench::Effort effort = bench::effort(options.quick);
  const std::vector<bench::Method> methods = bench::methods();
  const bench::Records records = bench::measure(methods, effort, std::cerr, json);
  const bench::CostOfGrowth cost = bench::cost_of_growth(options.quick);
  const double seconds = std::chrono::duration<double>(Clock::now() - begin).count();
  bench::write_report(records, methods, effort, cost, {core, load, seconds}, folder, std::cout);
  std::cout << "report: " << (folder / "report.md").string() << std::endl;
}

}  // namespace

int main(int argc, char** argv)
{
  try {
    run(read(argc, argv));
    return 0;
  } catch (const std::invalid_argument& error) {
    std::cerr << "iim_tables: " << error.what() << "\n\n" << usage;
    return 2;
  } catch (const std::exception& error) {
    std::cerr << "iim_tables: " << error.what() << '\n';
    return 1;
  }
}
