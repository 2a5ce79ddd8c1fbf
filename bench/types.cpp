// PROGRAM: iim_types
// What a modelling choice costs: operations and time of every type of subsystem; the legged machine by all methods.
#include "types/types.hpp"
#include "common/machine.hpp"
#include "common/report.hpp"

#include <iim_build_info.hpp>

#include <cstdlib>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <stdexcept>
#include <string>

namespace {

constexpr const char* usage =
    "usage: iim_types --out FOLDER [--quick]\n"
    "\n"
    "Measures what every type of subsystem costs, and the legged machine by all methods; writes FOLDER/types.md.\n"
    "--quick   fewer repetitions\n";

struct Options {
  std::string out;
  bool quick = false;
};

Options read(int argc, char** argv)
{
  Options options;
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

std::string whole(double x) { return bench::text("%.0f", x); }

/// "–" where no column goes from one such subsystem to the next, as from a free one.
std::string of_column(const bench::Cost& column, const std::string& text)
{
  return column.operations.products > 0 ? text : "–";
}

bench::Table table_of_types(bool quick)
{
  bench::Table table({"subsystem", "n_i", "q̈₀: products", "sums", "√, sin …", "time [ns]", "column of B̂: products",
                      "sums", "time [ns]"});
  for (auto* costs : {bench::costs_of_joints, bench::costs_of_drives, bench::costs_of_loops}) {
    for (const bench::TypeCost& cost : costs(quick)) {
      std::cerr << cost.name << '\n';
      const bench::Operations &all = cost.qdd0.operations, &column = cost.column.operations;
      table.add({cost.name, std::to_string(cost.n_i), whole(all.products), whole(all.sums), whole(all.functions),
                 whole(cost.qdd0.nanoseconds), of_column(cost.column, whole(column.products)),
                 of_column(cost.column, whole(column.sums)),
                 of_column(cost.column, bench::text("%.1f", cost.column.nanoseconds))});
    }
  }
  return table;
}

void run(const Options& options)
{
  const std::filesystem::path folder = options.out;
  std::filesystem::create_directories(folder);
  std::ofstream markdown(folder / "types.md");
  if (!markdown) { throw std::runtime_error("cannot write " + (folder / "types.md").string()); }
  bench::Report report(std::cout, markdown);

  const double load = bench::load_average();
  const int core = bench::pin_to_one_core();
  report.title("What a modelling choice costs");
  report.paragraph(bench::processor() + (core < 0 ? ", not pinned" : ", pinned to core " + std::to_string(core)) +
                   ", load " + bench::text("%.1f", load) + ", " + bench::date() + "; " + iim_build::compiler + ", " +
                   iim_build::flags + ", Eigen " + iim_build::eigen + "; iim " + iim_build::commit + ".");
  report.section("By type of subsystem");
  report.paragraph(
      "What one more subsystem in a chain of its kind adds, a tenth of the difference between chains of twelve and of "
      "two: "
      "to the O(n) pass with q̈₀, and to each column of B̂ by implicit inversion. Products include divisions; most go "
      "with a sum into a multiply-add. Times are medians over 16 states.");
  report.table(table_of_types(options.quick));

  const bench::LeggedReport legged = bench::legged_report(options.quick);
  report.section("A legged machine");
  report.paragraph(
      "Floating base, elastic hips, four-bar knees, ankles on push-rods: " + std::to_string(legged.subsystems) +
      " subsystems, " + std::to_string(legged.n_v) + " velocities, " + std::to_string(legged.columns) +
      " inputs with eight contacts. Largest error of a row in 64 states, against the same robot in long "
      "double, which is certain to " +
      bench::magnitude(legged.doubt) + "; median time for q̈₀ and B̂.");
  bench::Table methods({"method", "error of q̈₀", "error of B̂", "time [µs]"});
  for (const bench::LeggedResult& r : legged.methods) {
    methods.add({r.method, bench::magnitude(r.qdd0_error), bench::magnitude(r.Bhat_error),
                 bench::three_digits(r.microseconds)});
  }
  report.table(methods);
}

}  // namespace

int main(int argc, char** argv)
{
  try {
    run(read(argc, argv));
    return 0;
  } catch (const std::invalid_argument& error) {
    std::cerr << "iim_types: " << error.what() << "\n\n" << usage;
    return 2;
  } catch (const std::exception& error) {
    std::cerr << "iim_types: " << error.what() << '\n';
    return 1;
  }
}
