// PROGRAM: iim_accuracy
// REQUIRES: boost benchmark
// Error against run time of every method, update and scalar; and how each of them stands extreme scenes.
#include "accuracy.hpp"
#include "figure.hpp"
#include "machine.hpp"
#include "report.hpp"
#include "table.hpp"

#include <iim_build_info.hpp>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>
#include <string>
#include <vector>

namespace bench {

namespace {

constexpr const char* usage =
    "usage: iim_accuracy --out FOLDER [--quick]\n"
    "\n"
    "Runs every method × update × scalar on plain and extreme scenes and writes into FOLDER:\n"
    "  accuracy.md, accuracy_*.svg   tables and figures\n"
    "--quick                         fewer states and shorter chains\n";

struct Result {
  AccuracyScene scene;
  AccuracyReference reference;
  std::vector<Outcome> outcomes;
};

/// One look per variant, one colour per method; scalars differ by point.
Look look_of(const Outcome& outcome)
{
  static const std::map<std::string, const char*> colours{
      {"implicit inversion, printed", "#E69F00"},   {"implicit inversion, projected", "#0072B2"},
      {"implicit inversion, square root", "#009E73"}, {"unit forces on the workspace, projected", "#CC79A7"},
      {"recursive inverse, projected", "#56B4E9"},  {"global inverse, branch-sparse", "#D55E00"},
      {"global inverse, dense", "#000000"}};
  const int point = outcome.scalar == "double" ? 7 : outcome.scalar == "float" ? 9 : 5;
  return {colours.at(outcome.variant), point, outcome.scalar == "float" ? 2 : 1, 1.5};
}

std::string error_cell(const Outcome& o, double error, std::size_t states)
{
  if (o.refused == static_cast<int>(states)) { return o.status; }
  std::string cell = magnitude(error);
  if (o.refused > 0) { cell += " (" + std::to_string(o.refused) + " refused: " + o.status + ")"; }
  return cell;
}

void write_scene_tables(const std::vector<Result>& results, const std::string& group, Report& report)
{
  for (const char* scalar : {"double", "float"}) {
    for (const bool of_Bhat : {true, false}) {
      std::vector<std::string> head{of_Bhat ? std::string("error of B̂, ") + scalar : std::string("error of q̈₀, ") + scalar};
      bool first = true;
      std::vector<std::vector<std::string>> rows;
      for (const Result& result : results) {
        if (result.scene.group != group) { continue; }
        std::vector<std::string> row{result.scene.name};
        const double epsilons = scalar == std::string("double") ? 1 : std::ldexp(1.0, 29);
        row.push_back(result.reference.failure.empty()
                          ? magnitude(epsilons * (of_Bhat ? result.reference.Bhat_sensitivity : result.reference.qdd0_sensitivity))
                          : result.reference.failure);
        if (first) { head.push_back("one ε in the data"); }
        for (const Outcome& o : result.outcomes) {
          if (o.scalar != scalar) { continue; }
          if (first) { head.push_back(o.variant); }
          row.push_back(error_cell(o, of_Bhat ? o.Bhat_error : o.qdd0_error, result.scene.states.size()));
        }
        first = false;
        rows.push_back(row);
      }
      if (rows.empty()) { continue; }
      Table table(head);
      for (auto& row : rows) { table.add(row); }
      report.table(table);
    }
  }
}

/// Error of B̂ over the scene's parameter, one curve per variant of the scalar.
Figure error_over(const std::vector<Result>& results, const std::string& group, const std::string& title,
                  const std::string& x, const char* scalar)
{
  Figure figure{"accuracy_" + group + "_" + scalar, title + ", " + scalar, x, "relative error of B̂", true, true};
  std::replace(figure.file.begin(), figure.file.end(), ' ', '_');
  std::map<std::string, std::size_t> place;
  for (const Result& result : results) {
    if (result.scene.group != group) { continue; }
    for (const Outcome& o : result.outcomes) {
      if (o.scalar != scalar || o.refused == static_cast<int>(result.scene.states.size())) { continue; }
      const auto [at, added] = place.try_emplace(o.variant, figure.curves.size());
      if (added) { figure.curves.push_back({o.variant, look_of(o), {}}); }
      figure.curves[at->second].points.push_back({result.scene.parameter, std::clamp(o.Bhat_error, 1e-18, 1e3)});
    }
  }
  return figure;
}

Figure error_against_time(const Result& result)
{
  Figure figure{"accuracy_time_" + result.scene.name, "Error against run time: " + result.scene.name,
                "time for q̈₀ and B̂ [µs]", "relative error of B̂, worst state", true, true, true};
  for (char& c : figure.file) {
    if (c == ' ' || c == ',') { c = '_'; }
  }
  for (const Outcome& o : result.outcomes) {
    if (o.time > 0 && o.refused == 0 && o.Bhat_error > 0 && std::isfinite(o.Bhat_error)) {
      figure.curves.push_back({o.variant + ", " + o.scalar, look_of(o), {{o.time, o.Bhat_error}}});
    }
  }
  // The front: nothing is both faster and more accurate.
  std::vector<Point> front;
  for (const Curve& curve : figure.curves) {
    const Point p = curve.points.front();
    const bool beaten = std::any_of(figure.curves.begin(), figure.curves.end(), [&](const Curve& other) {
      return other.points.front().x < p.x && other.points.front().y < p.y;
    });
    if (!beaten) { front.push_back(p); }
  }
  std::sort(front.begin(), front.end(), [](const Point& a, const Point& b) { return a.x < b.x; });
  figure.curves.push_back({"front", {"#888888", 6, 1, 1}, front});
  return figure;
}

void write_time_table(const Result& result, Report& report)
{
  Table table({"variant", "scalar", "time [µs]", "× printed double", "error of B̂", "error of q̈₀"});
  double printed = 0;
  for (const Outcome& o : result.outcomes) {
    if (o.scalar == "double" && o.variant == "implicit inversion, printed") { printed = o.time; }
  }
  for (const Outcome& o : result.outcomes) {
    table.add({o.variant, o.scalar, three_digits(o.time), three_digits(o.time / printed),
               error_cell(o, o.Bhat_error, result.scene.states.size()), error_cell(o, o.qdd0_error, result.scene.states.size())});
  }
  report.table(table);
}

void run(const std::filesystem::path& folder, bool quick)
{
  std::filesystem::create_directories(folder);
  std::ofstream markdown(folder / "accuracy.md");
  if (!markdown) { throw std::runtime_error("cannot write " + (folder / "accuracy.md").string()); }
  const int core = pin_to_one_core();
  std::vector<Result> results;
  const std::vector<AccuracyScene> scenes = accuracy_scenes(quick);
  for (const AccuracyScene& scene : scenes) {
    std::cerr << '[' << results.size() + 1 << '/' << scenes.size() << "] " << scene.group << ": " << scene.name << '\n';
    Result result{scene, accuracy_reference(scene), {}};
    for (auto outcomes : {accuracy_outcomes<float>(scene, result.reference), accuracy_outcomes<double>(scene, result.reference),
                          accuracy_outcomes<long double>(scene, result.reference)}) {
      result.outcomes.insert(result.outcomes.end(), outcomes.begin(), outcomes.end());
    }
    results.push_back(std::move(result));
  }

  Report report(std::cout, markdown);
  report.title("Error against run time");
  report.paragraph(std::string("Built by ") + iim_build::compiler + ", " + iim_build::flags + ", commit " +
                   iim_build::commit + "; " + processor() + ", core " + std::to_string(core) + ", " + date() + ".");
  report.paragraph("Errors are relative, Frobenius, the worst of the scene's random states, against 80 digits. "
                   "«One ε in the data» is how far the exact result moves if every number of the model and of q moves "
                   "by at most one ε of the scalar: no algorithm can be expected to stay below it. A status in place "
                   "of a number is what the variant returned instead of a result.");
  std::vector<Figure> figures;
  for (const Result& result : results) {
    if (!result.scene.timed) { continue; }
    report.section(result.scene.name);
    write_time_table(result, report);
    figures.push_back(error_against_time(result));
    report.image(figures.back().file + ".svg", figures.back().title);
  }
  const std::vector<std::array<std::string, 3>> series{
      {"length", "Error against the length of a chain", "links"},
      {"mass ratio", "Error against the load on seven links of 1 kg", "load [kg]"},
      {"distance", "Error against the distance from the world's origin", "distance [m]"}};
  for (const auto& [group, title, x] : series) {
    report.section(title);
    write_scene_tables(results, group, report);
    for (const char* scalar : {"double", "float"}) {
      figures.push_back(error_over(results, group, title, x, scalar));
      report.image(figures.back().file + ".svg", figures.back().title);
    }
  }
  report.section("Extreme scenes");
  write_scene_tables(results, "extreme", report);
  if (!draw(figures, folder)) { report.paragraph("gnuplot is absent: the figures are left as .gp files."); }
}

}  // namespace

}  // namespace bench

int main(int argc, char** argv)
{
  try {
    std::string out;
    bool quick = false;
    for (int k = 1; k < argc; ++k) {
      const std::string argument = argv[k];
      if (argument == "--out" && k + 1 < argc) {
        out = argv[++k];
      } else if (argument == "--quick") {
        quick = true;
      } else {
        std::cerr << bench::usage;
        return argument == "--help" ? 0 : 2;
      }
    }
    if (out.empty()) { throw std::invalid_argument("--out FOLDER is missing"); }
    bench::run(out, quick);
  } catch (const std::exception& error) {
    std::cerr << "error: " << error.what() << '\n';
    return 1;
  }
}
