// PROGRAM: iim_accuracy
// REQUIRES: boost benchmark
// Error against run time of every method, frame convention, update and scalar; how each of them stands extreme scenes.
#include "accuracy/report.hpp"
#include "accuracy/robots.hpp"
#include "common/machine.hpp"

#include <iim_build_info.hpp>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <string>
#include <vector>

namespace bench {

namespace {

constexpr const char* usage =
    "usage: iim_accuracy --out FOLDER [--quick] [--only PART] [--robots DIR]\n"
    "\n"
    "Runs every method × frame convention × update × scalar on plain and extreme scenes and writes into FOLDER:\n"
    "  accuracy.md, accuracy_*.svg   tables and figures\n"
    "--quick                         fewer states, shorter chains, fewer steps\n"
    "--only PART                     bounds, robots, cost, scenes, known, runs or stiff\n"
    "--match TEXT                    only scenes with it in their group (plain, length, mass ratio, distance, "
    "extreme,\n"
    "                                robot) or name\n"
    "--robots DIR                    with panda.urdf, ur5.urdf, anymal.urdf, solo12.urdf; default ../shared/robots\n";

struct Options {
  std::string out;
  std::string only;
  std::string match;
  std::string robots = IIM_SHARED_DIR "/robots";
  bool quick = false;

  bool wants(const char* part) const { return only.empty() || only == part; }
};

std::vector<AccuracyScene> matching(std::vector<AccuracyScene> scenes, const Options& options)
{
  std::erase_if(scenes, [&](const AccuracyScene& scene) {
    return (scene.group + ": " + scene.name).find(options.match) == std::string::npos;
  });
  return scenes;
}

std::vector<AccuracyScene> robots(const Options& options, int states, Report& report)
{
  std::vector<std::string> absent;
  std::vector<AccuracyScene> scenes = accuracy_robots(options.robots, states, absent);
  for (const std::string& line : absent) { report.paragraph("Robots left out. " + line + "."); }
  return matching(std::move(scenes), options);
}

void write_scene_part(const Options& options, Report& report, std::vector<Figure>& figures, bool& drawn)
{
  std::vector<AccuracyResult> results;
  std::vector<AccuracyScene> scenes = matching(accuracy_scenes(options.quick), options);
  for (AccuracyScene& robot : robots(options, 32, report)) { scenes.push_back(std::move(robot)); }
  for (const AccuracyScene& scene : scenes) {
    std::cerr << '[' << results.size() + 1 << '/' << scenes.size() << "] " << scene.group << ": " << scene.name << '\n';
    AccuracyResult result{scene, accuracy_reference(scene), {}};
    for (auto outcomes :
         {accuracy_outcomes<float>(scene, result.reference), accuracy_outcomes<double>(scene, result.reference),
          accuracy_outcomes<long double>(scene, result.reference)}) {
      result.outcomes.insert(result.outcomes.end(), outcomes.begin(), outcomes.end());
    }
    if (scene.timed) { measure_times(result); }
    // The matrices of long chains are no longer needed.
    for (Yardstick& y : result.reference.yardsticks) { y.M = y.B = {}; }
    results.push_back(std::move(result));
  }
  report.paragraph(
      "Errors are relative, Frobenius norm, the worst of the scene's random states (seed 4711), against 80 digits by "
      "the "
      "library's headers; up to 64 velocities these agree, at the first state of each scene, with the paper's global "
      "matrices as printed, solved by Gaussian elimination, to 50 digits. «Componentwise» is max |ΔB̂_ij| / √(M⁻¹_ii "
      "(BᵀM⁻¹B)_jj). «Residual» is "
      "‖M b̂ − b‖₁ / (‖M‖₁ ‖b̂‖₁ ε) as LAPACK's tests scale it (there 30 passes), the worst column. «One ε in the data» "
      "is how far the "
      "exact result moves if every number of the model, of q and of q̇ moves by at most one ε of the scalar (random): "
      "no "
      "algorithm can be expected to stay below it. A status in place of a number is what the variant returned instead "
      "of a result. Body-fixed and common frames are bench/accuracy/frame_conventions.hpp, B̂ by unit forces; they are "
      "written plainly, so that their errors can be compared with the library's, their times only with each other.");
  for (const AccuracyResult& result : results) {
    if (!result.scene.timed) { continue; }
    report.section(result.scene.name);
    write_time_table(result, report);
    report.image(draw_error_against_time(result, options.out, drawn) + ".svg",
                 "Error against run time: " + result.scene.name);
  }
  const auto has = [&](const std::string& group) {
    return std::any_of(results.begin(), results.end(), [&](const auto& r) { return r.scene.group == group; });
  };
  const std::vector<std::array<std::string, 3>> series{
      {"length", "Error against the length of a chain", "links"},
      {"mass ratio", "Error against the load on seven links of 1 kg", "load [kg]"},
      {"distance", "Error against the distance from the world's origin", "distance [m]"}};
  for (const auto& [group, title, x] : series) {
    if (!has(group)) { continue; }
    report.section(title);
    write_overview(results, group, report);
    for (const char* scalar : {"double", "float"}) {
      figures.push_back(error_over(results, group, title, x, scalar));
      report.image(figures.back().file + ".svg", figures.back().title);
    }
  }
  if (!has("extreme")) { return; }
  report.section("Extreme scenes");
  write_overview(results, "extreme", report);
  write_failures(results, report);
  report.section("Extreme scenes: every variant");
  write_details(results, "extreme", report);
}

void run(const Options& options)
{
  const std::filesystem::path folder = options.out;
  std::filesystem::create_directories(folder);
  std::ofstream markdown(folder / "accuracy.md");
  if (!markdown) { throw std::runtime_error("cannot write " + (folder / "accuracy.md").string()); }
  const int core = pin_to_one_core();
  Report report(std::cout, markdown);
  report.title("Error against run time");
  report.paragraph(std::string("Built by ") + iim_build::compiler + ", " + iim_build::flags + ", commit " +
                   iim_build::commit + "; " + processor() + ", core " + std::to_string(core) + ", " + date() + ".");
  std::vector<Figure> figures;
  bool drawn = true;
  if (options.wants("cost")) { write_costs(options.quick, report); }
  if (options.wants("scenes")) { write_scene_part(options, report, figures, drawn); }
  if (options.only == "robots") { write_bounds(accuracy_bounds(robots(options, 100, report)), report); }
  if (options.wants("bounds")) {
    std::vector<Bound> bounds = accuracy_bounds(matching(accuracy_scenes(options.quick, 100), options));
    for (Bound& bound : accuracy_bounds(robots(options, 100, report))) { bounds.push_back(std::move(bound)); }
    write_bounds(bounds, report);
  }
  const auto append = [&](std::vector<Figure> more) { figures.insert(figures.end(), more.begin(), more.end()); };
  if (options.wants("known")) { append(known_experiments(options.quick, report)); }
  if (options.wants("runs")) { append(long_runs(options.quick, report)); }
  if (options.wants("stiff")) { append(stiff_scenes(options.quick, report)); }
  drawn = draw_in_powers(figures, options.out) && drawn;
  if (!drawn) { report.paragraph("gnuplot is absent: the figures are left as .gp files."); }
}

}  // namespace

}  // namespace bench

int main(int argc, char** argv)
{
  try {
    bench::Options options;
    for (int k = 1; k < argc; ++k) {
      const std::string argument = argv[k];
      if (argument == "--out" && k + 1 < argc) {
        options.out = argv[++k];
      } else if (argument == "--only" && k + 1 < argc) {
        options.only = argv[++k];
        const std::vector<std::string> parts{"bounds", "robots", "cost", "scenes", "known", "runs", "stiff"};
        if (std::find(parts.begin(), parts.end(), options.only) == parts.end()) {
          throw std::invalid_argument("--only " + options.only + " is no part of the report");
        }
      } else if (argument == "--match" && k + 1 < argc) {
        options.match = argv[++k];
      } else if (argument == "--robots" && k + 1 < argc) {
        options.robots = argv[++k];
      } else if (argument == "--quick") {
        options.quick = true;
      } else {
        std::cerr << bench::usage;
        return argument == "--help" ? 0 : 2;
      }
    }
    if (options.out.empty()) { throw std::invalid_argument("--out FOLDER is missing"); }
    bench::run(options);
  } catch (const std::exception& error) {
    std::cerr << "error: " << error.what() << '\n';
    return 1;
  }
}
