// What the comparison found, as Markdown and as a picture.
#pragma once

#include "../common/statistics.hpp"
#include "../common/table.hpp"
#include "peers.hpp"
#include "timing.hpp"

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

namespace peers {

/// One path on one model.
struct Measured {
  std::string library;
  std::string path;
  Difference difference;
  bench::Spread seconds;
};

/// One model.
struct Row {
  std::string model;
  int n = 0;
  int m = 0;
  double condition = 0;            ///< of M, the worst of the states that were compared
  std::vector<Measured> measured;  ///< the first is iim
  std::vector<std::string> remarks;

  double ours() const { return measured.front().seconds.median; }

  /// The library's fastest path; null if it has none here.
  const Measured* best(const std::string& library) const
  {
    const Measured* best = nullptr;
    for (const Measured& candidate : measured) {
      if (candidate.library == library && (best == nullptr || candidate.seconds.median < best->seconds.median)) {
        best = &candidate;
      }
    }
    return best;
  }
};

inline std::string microseconds(double seconds) { return bench::three_digits(1e6 * seconds); }

/// One row per model: our time, and the ratio of each library's best path to it.
inline bench::Table ratios(const std::vector<Row>& rows, const std::vector<std::string>& libraries)
{
  std::vector<std::string> head{"model", "n", "m", "iim [µs]"};
  for (const std::string& library : libraries) { head.push_back(library + " / iim"); }
  bench::Table table(head);
  for (const Row& row : rows) {
    std::vector<std::string> cells{row.model, std::to_string(row.n), std::to_string(row.m), microseconds(row.ours())};
    for (const std::string& library : libraries) {
      const Measured* best = row.best(library);
      cells.push_back(best == nullptr ? "–" : bench::three_digits(best->seconds.median / row.ours()));
    }
    table.add(cells);
  }
  return table;
}

/// Our path with this name, if it was measured.
inline const Measured* own_path(const Row& row, const std::string& ending)
{
  for (const Measured& x : row.measured) {
    if (x.library == "iim" && x.path.ends_with(ending)) { return &x; }
  }
  return nullptr;
}

/// One row per model with several states at once: our times per state, and the ratio of each library's best path.
inline bench::Table several_at_once(const std::vector<Row>& rows, const std::vector<std::string>& libraries)
{
  std::vector<std::string> head{"model", "one by one [µs]", "at once [µs]", "one by one / at once"};
  for (const std::string& library : libraries) { head.push_back(library + " / at once"); }
  bench::Table table(head);
  for (const Row& row : rows) {
    const Measured* several = own_path(row, "at once");
    if (several == nullptr) { continue; }
    const double unit = several->seconds.median;
    std::vector<std::string> cells{row.model, microseconds(row.ours()), microseconds(unit),
                                   bench::three_digits(row.ours() / unit)};
    for (const std::string& library : libraries) {
      const Measured* best = row.best(library);
      cells.push_back(best == nullptr ? "–" : bench::three_digits(best->seconds.median / unit));
    }
    table.add(cells);
  }
  return table;
}

/// Published times of straight-line code that was generated for one robot, M⁻¹ alone, carried over to this machine by
/// what `measure`'s best path took there and takes here. Empty without `measure`.
inline bench::Table generated_code(const std::vector<Row>& rows, const std::string& measure)
{
  struct Published {
    const char* model;     // of ours, with as many joints
    double code, library;  // [s]
  };
  bench::Table table({"model", "published [µs]", measure + " there [µs]", measure + " here [µs]", "code here [µs]",
                      "iim, q̈₀ and M⁻¹ [µs]", "code / iim"});
  for (const Published& x : {Published{"seven-axis arm", 0.43e-6, 2.4e-6}, Published{"chain 12", 0.86e-6, 5e-6}}) {
    for (const Row& row : rows) {
      const Measured* best = row.best(measure);
      if (row.model != x.model || best == nullptr) { continue; }
      const double code = x.code * best->seconds.median / x.library;
      table.add({row.model, microseconds(x.code), microseconds(x.library), microseconds(best->seconds.median),
                 microseconds(code), microseconds(row.ours()), bench::three_digits(code / row.ours())});
    }
  }
  return table;
}

/// One row per model and path.
inline bench::Table details(const std::vector<Row>& rows)
{
  bench::Table table({"model", "library", "path", "median [µs]", "quartiles [µs]", "/ iim", "Δq̈₀", "ΔB̂", "κ(M)"});
  for (const Row& row : rows) {
    for (const Measured& x : row.measured) {
      const bool ours = &x == &row.measured.front();
      table.add({ours ? row.model : "", x.library, x.path, microseconds(x.seconds.median),
                 microseconds(x.seconds.lower) + " … " + microseconds(x.seconds.upper),
                 bench::three_digits(x.seconds.median / row.ours()), ours ? "" : bench::magnitude(x.difference.qdd0),
                 ours ? "" : bench::magnitude(x.difference.Bhat), ours ? bench::magnitude(row.condition) : ""});
    }
  }
  return table;
}

/// Models where a library's best path takes less time than ours.
inline bench::Table losses(const std::vector<Row>& rows, const std::vector<std::string>& libraries)
{
  bench::Table table({"model", "library", "path", "/ iim"});
  for (const Row& row : rows) {
    for (const std::string& library : libraries) {
      const Measured* best = row.best(library);
      if (best != nullptr && best->seconds.median < row.ours()) {
        table.add({row.model, library, best->path, bench::three_digits(best->seconds.median / row.ours())});
      }
    }
  }
  return table;
}

/// Ratios as bars, FOLDER/peers.svg by gnuplot. False if gnuplot is missing or fails; its script then stays.
inline bool draw(const std::vector<Row>& rows, const std::vector<std::string>& libraries,
                 const std::filesystem::path& folder)
{
  if (libraries.empty()) { return false; }
  const std::filesystem::path script = folder / "peers.gp";
  {
    std::ofstream out(script);
    out << "set terminal svg size 1500,640 font 'sans,13' background 'white'\n"
        << "set title 'q̈₀ and B̂: time of other libraries in times of iim (logarithmic)'\n"
        << "set output '" << (folder / "peers.svg").string() << "'\n"
        << "set style data histograms\nset style histogram clustered gap 1.5\nset style fill solid 0.9 noborder\n"
        << "set logscale y 2\nset xrange [-0.8:*]\nset yrange [0.5:*]\nset grid ytics\nset xtics rotate by -40 "
           "nomirror scale 0 font 'sans,11'\n"
        << "set ylabel 'time of the best path / time of iim'\nset key outside top center horizontal\n"
        << "$ratios << END\n\"model\"";
    for (const std::string& library : libraries) { out << " \"" << library << '"'; }
    out << '\n';
    for (const Row& row : rows) {
      out << '"' << row.model << '"';
      for (const std::string& library : libraries) {
        const Measured* best = row.best(library);
        out << ' ' << (best == nullptr ? "?" : bench::text("%.6g", best->seconds.median / row.ours()));
      }
      out << '\n';
    }
    out << "END\nset datafile missing '?'\nplot 1 notitle with lines lc 'black'";
    for (std::size_t k = 0; k < libraries.size(); ++k) {
      out << ", $ratios using " << k + 2 << (k == 0 ? ":xtic(1)" : "") << " title columnheader";
    }
    out << '\n';
  }
  std::string quoted = "'";
  for (const char c : script.string()) { quoted += c == '\'' ? std::string("'\\''") : std::string(1, c); }
  const bool drawn = std::system(("gnuplot " + quoted + "'").c_str()) == 0;
  if (drawn) { std::filesystem::remove(script); }
  return drawn;
}

}  // namespace peers
