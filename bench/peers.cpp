// PROGRAM: iim_peers
// q̈₀ and B̂ by this library and by others: same models, same pool of random states, one core, one run.
//
//     iim_peers --out DIR [--quick] [--robots DIR] [--longest N]      leaves DIR/peers.md and DIR/peers.svg
//
// Before any time is taken, every path of every library must agree with iim on q̈₀ and B̂ at the states of the pool (of
// more than 100 velocities: at the first of them); one that does not is a failure of the program. A library that is not
// installed, or that fails at the first state of a model, is named.
#include "peers/peers.hpp"

#include "common/machine.hpp"
#include "peers/compile.hpp"
#include "peers/iim.hpp"
#include "peers/models.hpp"
#include "peers/process.hpp"
#include "peers/report.hpp"
#include "peers/several.hpp"
#include "peers/timing.hpp"
#include "peers/worker.hpp"

#include <iim_build_info.hpp>

#include <algorithm>
#include <csignal>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <iterator>
#include <limits>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace {

using namespace peers;

constexpr std::uint64_t seed = 20240617;

/// How far two right answers may be apart, relative: an error of ε in M comes back κ(M)-fold, every entry of M sums
/// up to n terms, and each term takes some 16 roundings. Long chains have κ of up to 4 n⁴, and lose less: seven digits
/// at 1000 links.
double bound(int n, double condition)
{
  return std::min(1e-6, 16 * n * std::numeric_limits<double>::epsilon() * condition);
}

struct Options {
  std::filesystem::path out;
  std::filesystem::path robots = IIM_SHARED_DIR "/robots";
  bool quick = false;
  int longest = 1000;
};

Options parse(const std::vector<std::string>& arguments)
{
  Options options;
  for (std::size_t k = 0; k < arguments.size(); ++k) {
    const auto value = [&] {
      if (k + 1 == arguments.size()) { throw std::invalid_argument(arguments[k] + " needs a value"); }
      return arguments[++k];
    };
    if (arguments[k] == "--out") {
      options.out = value();
    } else if (arguments[k] == "--robots") {
      options.robots = value();
    } else if (arguments[k] == "--longest") {
      options.longest = std::stoi(value());
    } else if (arguments[k] == "--quick") {
      options.quick = true;
    } else {
      throw std::invalid_argument("unknown argument " + arguments[k]);
    }
  }
  if (options.out.empty()) {
    throw std::invalid_argument("usage: iim_peers --out DIR [--quick] [--robots DIR] [--longest N]");
  }
  if (options.quick) { options.longest = std::min(options.longest, 100); }
  return options;
}

/// On one line.
std::string line(std::string text)
{
  for (char& c : text) { c = c == '\n' ? ' ' : c; }
  while (!text.empty() && text.back() == ' ') { text.pop_back(); }
  return text;
}

/// Times of all libraries on one model. Throws std::runtime_error if two answers differ by more than rounding.
Row compare(const Model& model, const std::vector<std::unique_ptr<Worker>>& workers, bool quick)
{
  const int pool = model.n_v <= 100 ? 64 : model.n_v <= 255 ? 16 : 4;
  const std::size_t compared = static_cast<std::size_t>(model.n_v <= 100 ? pool : 1);
  std::vector<State> states;
  for (const auto& x : bench::random_states(Tree(assembly(model)), 0, pool, seed)) { states.push_back({x.q, x.qd}); }

  Row row{model.name, model.n_v, model.columns(), 0, {}, {}};
  IimPeer ours(model, states);
  const Path path = ours.paths().front();
  std::vector<Runner> runners;
  row.measured.push_back({"iim", path.name, {}, {}});
  runners.push_back({[&](std::size_t k) {
                       path.compute(k);
                       return path.result();
                     },
                     [&](std::size_t evaluations) { return run(path, states.size(), evaluations); }});
  std::unique_ptr<Peer> several;
  if (model.n_v <= 63) {
    several = several_states(model, states);
    const Path at_once = several->paths().front();
    row.measured.push_back({"iim", at_once.name, {}, {}});
    runners.push_back(
        {[at_once](std::size_t k) {
           at_once.compute(k);
           return at_once.result();
         },
         [at_once, &states](std::size_t evaluations) { return run(at_once, states.size(), evaluations); }});
  }
  for (const std::unique_ptr<Worker>& worker : workers) {
    try {
      const std::vector<std::string> names = worker->take(model, states);
      if (!names.empty()) { worker->result(0, 0); }  // a library that fails only now is out, too
      for (std::size_t j = 0; j < names.size(); ++j) {
        row.measured.push_back({worker->name(), names[j], {}, {}});
        runners.push_back(
            {[&library = *worker, j](std::size_t k) { return library.result(j, k); },
             [&library = *worker, j](std::size_t evaluations) { return library.seconds(j, evaluations); }});
      }
    } catch (const std::exception& failure) {
      row.remarks.push_back(worker->name() + ": " + line(failure.what()));
    }
  }

  for (std::size_t k = 0; k < compared; ++k) {
    const double condition = condition_of_inertia_matrix(model, states[k]);
    row.condition = std::max(row.condition, condition);
    const Result expected = runners[0].result(k);
    for (std::size_t j = 1; j < runners.size(); ++j) {
      accumulate(row.measured[j].difference, difference(runners[j].result(k), expected, bound(model.n_v, condition)));
    }
  }
  for (std::size_t j = 1; j < runners.size(); ++j) {
    const Measured& x = row.measured[j];
    if (!(x.difference.in_bounds <= 1)) {
      throw std::runtime_error(x.library + " (" + x.path + ") disagrees with iim on " + model.name + ": q̈₀ by " +
                               bench::magnitude(x.difference.qdd0) + ", B̂ by " + bench::magnitude(x.difference.Bhat) +
                               ", " + bench::three_digits(x.difference.in_bounds) + " times what rounding explains");
    }
  }

  const Effort effort = quick ? Effort{1e-3, 0.3, 15} : Effort{};
  const std::vector<bench::Spread> seconds = measure(runners, states.size(), effort);
  for (std::size_t j = 0; j < runners.size(); ++j) { row.measured[j].seconds = seconds[j]; }
  return row;
}

/// The robots of the study: panda, ur5, anymal, solo12. What is missing goes to `absent`.
std::vector<Model> robots(const std::filesystem::path& folder, const std::filesystem::path& programs,
                          std::vector<std::string>& absent)
{
  const std::filesystem::path reader = programs / "iim_peers_urdf";
  if (!std::filesystem::exists(reader)) {
    absent.push_back("robots: iim_peers_urdf was not built (liburdfdom-dev)");
    return {};
  }
  std::vector<Model> list;
  const std::pair<const char*, const char*> files[] = {
      {"panda", "fixed"}, {"ur5", "fixed"}, {"anymal", "floating"}, {"solo12", "floating"}};
  for (const auto& [name, base] : files) {
    const std::filesystem::path file = folder / (std::string(name) + ".urdf");
    if (!std::filesystem::exists(file)) {
      absent.push_back(std::string("robot ") + name + ": no file in the folder of robots (--robots DIR)");
      continue;
    }
    const Process process(reader, {file.string(), base});
    Channel channel = process.channel();
    const std::string failure = channel.text();
    if (!failure.empty()) { throw std::runtime_error(failure); }
    list.push_back(channel.model());
  }
  return list;
}

/// Every remark once, and the models that it is about.
std::map<std::string, std::string> what_and_where(const std::vector<Row>& rows)
{
  std::map<std::string, std::string> models;
  for (const Row& row : rows) {
    for (const std::string& remark : row.remarks) {
      std::string& list = models[remark];
      list += (list.empty() ? "" : "; ") + row.model;
    }
  }
  return models;
}

void write(const Options& options, const std::vector<Row>& rows, const std::vector<std::unique_ptr<Worker>>& workers,
           const std::vector<std::string>& absent, const std::string& compiled, int core)
{
  std::vector<std::string> names;
  std::string versions = std::string("iim ") + iim_build::version;
  for (const std::unique_ptr<Worker>& worker : workers) {
    names.push_back(worker->name());
    versions += ", " + worker->name() + " " + worker->version();
  }
  const bool drawn = draw(rows, names, options.out);

  std::ofstream out(options.out / "peers.md");
  out << "# q̈₀ and B̂ beside other libraries\n\n"
      << versions << ".\n\n"
      << iim_build::compiler << ", `" << iim_build::flags << "`, Eigen " << iim_build::eigen << ", commit "
      << iim_build::commit << ". " << bench::processor() << ", "
      << (core >= 0 ? "pinned to core " + std::to_string(core) : std::string("not pinned")) << ", load "
      << bench::three_digits(bench::load_average()) << ", " << bench::date() << (options.quick ? ", quick run" : "")
      << ".\n\n"
      << "Same models, same pool of random states (seed " << seed
      << "), double. Every path goes from (q, q̇) to q̈₀ and to all columns of B̂ in memory, in the library's own order "
         "and frames. Processor time per state, medians; the paths take turns. iim: run-time tree, default accuracy "
         "tier. Libraries that come as packages are compiled by their packager, the header-only ones here with the "
         "flags above. Solves with the M of DART and KDL, as their users would write them, are in the adapters, with "
         "Eigen as those packages were compiled with it (no AVX). All of them agree with iim, see Δ below.\n";
  if (!absent.empty()) {
    out << "\nAbsent:\n\n";
    for (const std::string& line : absent) { out << "- " << line << '\n'; }
  }
  out << "\n## Best path of each library / iim\n\n";
  ratios(rows, names).markdown(out);
  if (drawn) { out << "\n![Ratio of times](peers.svg)\n"; }

  const bench::Table lost = losses(rows, names);
  if (lost.empty()) {
    out << "\nNo library is faster than iim on any of these models.\n";
  } else {
    out << "\n## Where others are faster\n\n";
    lost.markdown(out);
  }
  out << "\n## Several states at once\n\nEvery state's q̈₀ and B̂ as matrices of its own; time per state on the one "
         "core.\n\n";
  several_at_once(rows, names).markdown(out);
  const bench::Table generated = generated_code(rows, "Pinocchio");
  out << "\n## Generated code\n\nStraight-line code that was generated for one robot and one scene takes 0.43 µs for "
         "the M⁻¹ of "
         "7 joints and 0.86 µs for 12, where Pinocchio's best path to q̈₀ and M⁻¹ takes 2.4 and 5 µs (published, on "
         "another "
         "machine). ";
  if (generated.empty()) {
    out << "Without Pinocchio in this run there is nothing to carry these times over to this machine.\n";
  } else {
    out << "Carried over by Pinocchio's time in this run, on models with as many joints:\n\n";
    generated.markdown(out);
  }
  out << "\n## Compile time and size\n\nA controller that includes `iim/iim.hpp` with the run-time biped "
         "(`bench/peers/controller.cpp`), by the compiler and flags above, on one core: "
      << compiled << ".\n";

  const std::map<std::string, std::string> remarks = what_and_where(rows);
  if (!remarks.empty()) { out << "\n## What could not be compared\n\n"; }
  for (const auto& [what, where] : remarks) { out << "- " << what << " (" << where << ")\n"; }
  out << "\n## All paths\n\nΔ: largest relative difference from iim over the pool (Frobenius norm; of more than 100 "
         "velocities at its first state). κ(M): condition of "
         "the inertia matrix, by which an error of ε in its entries is magnified.\n\n";
  details(rows).markdown(out);
  if (!drawn) { std::cout << "no picture: gnuplot is missing or failed\n"; }
}

/// In words.
std::string compile_cost(const Options& options, const std::filesystem::path& programs)
{
  try {
    const CompileCost cost = compile_controller(programs, options.out, options.quick ? 1 : 3);
    return bench::three_digits(cost.seconds.median) + " s to compile, program " +
           bench::three_digits(static_cast<double>(cost.bytes) / 1024) + " KiB";
  } catch (const std::exception& failure) {
    return std::string("not measured: ") + failure.what();
  }
}

int compare_all(const Options& options, const std::filesystem::path& programs)
{
  std::filesystem::create_directories(options.out);
  std::signal(SIGPIPE, SIG_IGN);
  const int core = bench::pin_to_one_core();  // the adapters' processes inherit it

  std::vector<std::unique_ptr<Worker>> workers;
  std::vector<std::string> absent;
  const std::pair<const char*, const char*> libraries[] = {{"pinocchio", "Pinocchio 3: find_package(pinocchio)"},
                                                           {"mujoco", "MuJoCo: libmujoco-dev"},
                                                           {"dart", "DART: libdart-dev"},
                                                           {"simbody", "Simbody: libsimbody-dev"},
                                                           {"kdl", "Orocos KDL: liborocos-kdl-dev"}};
  for (const auto& [name, packaging] : libraries) {
    const std::filesystem::path program = programs / (std::string("iim_peers_") + name);
    if (std::filesystem::exists(program)) {
      workers.push_back(std::make_unique<Worker>(program));
    } else {
      absent.push_back(packaging);
    }
  }
  std::vector<Model> list = models(options.longest);
  for (Model& robot : robots(options.robots, programs, absent)) { list.push_back(std::move(robot)); }
  for (const std::string& line : absent) { std::cout << "absent: " << line << '\n'; }
  std::cout << "seed " << seed << std::endl;

  std::vector<std::string> names;
  for (const std::unique_ptr<Worker>& worker : workers) { names.push_back(worker->name()); }
  std::vector<Row> rows;
  for (const Model& model : list) {
    rows.push_back(compare(model, workers, options.quick));
    const Row& row = rows.back();
    std::cout << row.model << ": iim " << microseconds(row.ours()) << " µs";
    for (const std::string& name : names) {
      const Measured* best = row.best(name);
      if (best != nullptr) {
        std::cout << ", " << name << " ×" << bench::three_digits(best->seconds.median / row.ours());
      }
    }
    std::cout << std::endl;
    for (const std::string& remark : row.remarks) { std::cout << "  " << remark << '\n'; }
  }
  const std::string compiled = compile_cost(options, programs);
  std::cout << "a controller: " << compiled << '\n';
  write(options, rows, workers, absent, compiled, core);
  std::cout << '\n';
  ratios(rows, names).print(std::cout);
  return 0;
}

}  // namespace

int main(int argc, char** argv)
{
  try {
    return compare_all(parse({argv + 1, argv + argc}), std::filesystem::weakly_canonical(argv[0]).parent_path());
  } catch (const std::exception& failure) {
    std::cerr << "iim_peers: " << failure.what() << '\n';
    return 1;
  }
}
