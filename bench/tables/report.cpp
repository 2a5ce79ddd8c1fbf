// PART OF: iim_tables
// REQUIRES: benchmark
// Tables 1 to 3 and Figs. 3 and 4 from the records.
#include "report.hpp"

#include "../common/figure.hpp"
#include "../common/machine.hpp"
#include "../common/report.hpp"
#include "methods.hpp"
#include "scenes.hpp"

#include <iim_build_info.hpp>

#include <algorithm>
#include <fstream>
#include <map>
#include <ostream>
#include <stdexcept>

namespace bench {

namespace {

/// A row of scenes with one abscissa: n or m.
struct Series {
  std::vector<SceneId> scenes;
  Index SceneId::* abscissa;
};

class Analysis {
public:
  Analysis(const Records& records, const std::vector<Method>& methods, const Effort& effort)
      : records_(records), methods_(methods)
  {
    for (const Index n : effort.chain_n) {
      single.scenes.push_back({"chain", n, 1});
      full.scenes.push_back({"chain", n, n});
    }
    for (const Index m : effort.inputs) {
      chain_inputs.scenes.push_back({"chain", longest, m});
      tree_inputs.scenes.push_back({"tree", longest, m});
    }
  }

  const std::vector<Method>& methods() const { return methods_; }
  const Record& record(const SceneId& scene, const std::string& method) const
  {
    const Record* found = records_.find(scene, method);
    if (found == nullptr) { throw std::logic_error("nothing was measured for " + method + " on " + scene.model); }
    return *found;
  }
  double time(const SceneId& scene, const std::string& method) const { return record(scene, method).time.median; }

  /// Median time [µs] over n or m.
  std::vector<Point> curve(const Series& series, const std::string& method) const
  {
    std::vector<Point> points;
    for (const SceneId& scene : series.scenes) {
      points.push_back({static_cast<double>(scene.*series.abscissa), time(scene, method)});
    }
    return points;
  }

  /// Where method a is faster than method b, in words.
  std::string faster(const Series& series, const std::string& a, const std::string& b) const
  {
    const BreakEven at = break_even(curve(series, a), curve(series, b));
    if (!at.first) { return at.first_below_at_start ? "all n" : "no n"; }
    if (at.first_below_at_start != at.first_below_at_end) {
      const std::string place = text("%.1f", *at.last);
      const std::string words = (at.first_below_at_end ? "n > " : "n < ") + place;
      return *at.first < *at.last ? words + text(" (first %.1f)", *at.first) : words;
    }
    if (at.first_below_at_start) { return text("n < %.1f", *at.first) + text(" and n > %.1f", *at.last); }
    return text("%.1f < n", *at.first) + text(" < %.1f", *at.last);
  }

  /// Which of the library's methods with B̂ takes the least time, over n or m; other updates of a method are not others.
  std::string fastest(const Series& series) const
  {
    std::string words;
    std::string last;
    for (const SceneId& scene : series.scenes) {
      const Record* best = nullptr;
      for (const Method& method : methods_) {
        const bool other_update = method.id.starts_with(product) && method.id != product;
        const Record& candidate = record(scene, method.id);
        if (method.gives_Bhat && !other_update && (best == nullptr || candidate.time.median < best->time.median)) {
          best = &candidate;
        }
      }
      if (best->method != last) {
        words += (last.empty() ? "" : ", ") + std::string("from ") + std::to_string(scene.*series.abscissa) + ' ' +
                 best->method;
        last = best->method;
      }
    }
    return words;
  }

  /// Time per further input [µs], least squares.
  double per_input(const Series& series, const std::string& method) const { return slope(curve(series, method)); }

  /// The same in percent of the time with one input.
  double percent_per_input(const Series& series, const std::string& method) const
  {
    return 100 * per_input(series, method) / time(series.scenes.front(), method);
  }

  Series single{{}, &SceneId::n};        ///< Fig. 3 (a)
  Series full{{}, &SceneId::n};          ///< Fig. 3 (b)
  Series chain_inputs{{}, &SceneId::m};  ///< Fig. 4
  Series tree_inputs{{}, &SceneId::m};   ///< Table 2

private:
  const Records& records_;
  const std::vector<Method>& methods_;
};

std::string times(double ratio) { return text(ratio < 9.95 ? "%.2f ×" : "%.1f ×", ratio); }
std::string percent(double x) { return three_digits(x) + " %"; }

using Sayings = std::map<std::string, std::string>;  // of the paper, by method

/// A row per method for one scene.
Table scene_table(const Analysis& analysis, const SceneId& scene, const Sayings& paper)
{
  Table table({"method", "n", "m", "median [µs]", "quartiles [µs]", "to IIM", "error B̂", "error q̈₀", "paper"});
  for (const Method& method : analysis.methods()) {
    const Record& r = analysis.record(scene, method.id);
    const auto said = paper.find(method.id);
    table.add({method.name, std::to_string(scene.n), std::to_string(method.gives_Bhat ? scene.m : 0),
               three_digits(r.time.median), three_digits(r.time.lower) + " – " + three_digits(r.time.upper),
               times(r.ratio), magnitude(r.error_Bhat), magnitude(r.error_qdd0),
               said == paper.end() ? "" : said->second});
  }
  return table;
}

/// A row per method, a column per chosen n: median times.
Table length_table(const Analysis& analysis, const Series& series)
{
  std::vector<SceneId> chosen;
  for (const SceneId& scene : series.scenes) {
    for (const Index n : {1, 2, 6, 10, 18, 22, 30, 40, 50}) {
      if (scene.n == n) { chosen.push_back(scene); }
    }
  }
  std::vector<std::string> head{"median [µs]"};
  for (const SceneId& scene : chosen) { head.push_back("n = " + std::to_string(scene.n)); }
  Table table(head);
  for (const Method& method : analysis.methods()) {
    std::vector<std::string> row{method.name};
    for (const SceneId& scene : chosen) { row.push_back(three_digits(analysis.time(scene, method.id))); }
    table.add(row);
  }
  return table;
}

/// Where the method of a row is faster than that of a column.
Table break_even_table(const Analysis& analysis, const Series& series)
{
  std::vector<std::string> head{"faster than …"};
  for (const Method& method : analysis.methods()) { head.push_back(method.id); }
  Table table(head);
  for (const Method& row : analysis.methods()) {
    std::vector<std::string> cells{row.name + " (" + row.id + ")"};
    for (const Method& column : analysis.methods()) {
      cells.push_back(row.id == column.id ? "" : analysis.faster(series, row.id, column.id));
    }
    table.add(cells);
  }
  return table;
}

/// Cost of a further input; beside it the paper's.
Table input_table(const Analysis& analysis, const Series& series, const Sayings& paper)
{
  const SceneId& first = series.scenes.front();
  const SceneId& last = series.scenes.back();
  Table table({"method", "m = " + std::to_string(first.m) + " [µs]", "m = " + std::to_string(last.m) + " [µs]",
               "per further input [µs]", "in % of m = 1", "paper"});
  for (const Method& method : analysis.methods()) {
    if (!method.gives_Bhat) { continue; }
    const auto said = paper.find(method.id);
    table.add({method.name, three_digits(analysis.time(first, method.id)), three_digits(analysis.time(last, method.id)),
               three_digits(analysis.per_input(series, method.id)),
               percent(analysis.percent_per_input(series, method.id)), said == paper.end() ? "" : said->second});
  }
  return table;
}

/// Time on the tree against that on the chain.
Table topology_table(const Analysis& analysis, const Sayings& paper)
{
  const Index one = 1;
  Table table({"method", "tree, m = 1 [µs]", "to the chain", "tree, m = 50 [µs]", "to the chain", "paper"});
  for (const Method& method : analysis.methods()) {
    std::vector<std::string> row{method.name};
    for (const Index m : {one, longest}) {
      const double tree = analysis.time({"tree", longest, m}, method.id);
      row.push_back(three_digits(tree));
      row.push_back(times(tree / analysis.time({"chain", longest, m}, method.id)));
    }
    const auto said = paper.find(method.id);
    row.push_back(said == paper.end() ? "" : said->second);
    table.add(row);
  }
  return table;
}

/// What the paper's text says, and what was measured here.
Table statements(const Analysis& analysis)
{
  const auto ratio = [&](const SceneId& scene, const char* method) {
    return times(analysis.record(scene, method).ratio);
  };
  const auto topology = [&](const char* method) {
    return times(analysis.time({"tree", longest, longest}, method) /
                 analysis.time({"chain", longest, longest}, method));
  };
  const SceneId single{"chain", longest, 1};
  const SceneId full{"chain", longest, longest};
  const SceneId biped{"biped", 20, 38};
  Table table({"where", "the paper", "here"});
  table.left();
  table.add({"Sect. 2.2", "O(n) methods are faster than the direct solution for n > 9",
             "O(n) pass faster than the global inverse (m = 1) for " +
                 analysis.faster(analysis.single, floor_of_all, "global_dense")});
  table.add({"Fig. 3 (a)", "one input: all alike up to about 18 DOF, from there IIM faster than the global inverse",
             "IIM faster for " + analysis.faster(analysis.single, product, "global_dense") +
                 "; at n = 50 the global inverse takes " + ratio(single, "global_dense")});
  table.add({"Fig. 3 (a)", "one input: IIM marginally faster than unit forces up to 50 DOF",
             "at n = 50 unit forces take " + ratio(single, "unit_published") + " as published, " +
                 ratio(single, "unit") + " on the workspace"});
  table.add({"Fig. 3 (b)", "fully actuated: IIM faster than the global inverse from 18–19 DOF",
             "IIM faster for " + analysis.faster(analysis.full, product, "global_dense") +
                 "; at n = 50 the global inverse takes " + ratio(full, "global_dense")});
  table.add({"Fig. 3 (b)", "fully actuated: the cost of unit forces is prohibitive",
             "at n = 50 unit forces take " + ratio(full, "unit_published") + " as published, " + ratio(full, "unit") +
                 " on the workspace"});
  table.add({"Table 1", "per input: IIM ≈ 1 %, global inverse ≈ 0.33 %, unit forces ≈ 33 %",
             percent(analysis.percent_per_input(analysis.chain_inputs, product)) + ", " +
                 percent(analysis.percent_per_input(analysis.chain_inputs, "global_dense")) + ", " +
                 percent(analysis.percent_per_input(analysis.chain_inputs, "unit_published"))});
  table.add({"Table 2",
             "tree: the global inverse slightly faster than on the chain, IIM and unit forces as on the chain",
             "tree to chain, n = m = 50: global inverse " + topology("global_dense") + ", IIM " + topology(product) +
                 ", unit forces " + topology("unit_published")});
  table.add({"Table 3", "biped: IIM slightly faster than the global inverse, unit forces slowest",
             "global inverse " + ratio(biped, "global_dense") + ", unit forces " + ratio(biped, "unit_published")});
  return table;
}

std::vector<Figure> figures(const Analysis& analysis)
{
  const auto over = [&](const Series& series, Figure figure, auto&& wanted) {
    for (const Method& method : analysis.methods()) {
      if (wanted(method)) { figure.curves.push_back({method.name, method.look, analysis.curve(series, method.id)}); }
    }
    return figure;
  };
  const auto ratios = [&](const Series& series, Figure figure) {
    figure.y = "run time / implicit inversion";
    figure.y_max = 2.5;
    const std::vector<Point> unit = analysis.curve(series, product);
    for (const Method& method : analysis.methods()) {
      std::vector<Point> points = analysis.curve(series, method.id);
      for (std::size_t k = 0; k < points.size(); ++k) { points[k].y /= unit[k].y; }
      if (std::all_of(points.begin(), points.end(), [&](const Point& p) { return p.y < figure.y_max; })) {
        figure.curves.push_back({method.name, method.look, points});
      }
    }
    return figure;
  };
  const auto scatter = [&](const SceneId& scene, Figure figure) {
    figure.x = "median run time [µs]";
    figure.y = "worst relative error of B̂";
    figure.log_x = figure.log_y = figure.scatter = true;
    for (const Method& method : analysis.methods()) {
      if (!method.gives_Bhat) { continue; }
      const Record& r = analysis.record(scene, method.id);
      figure.curves.push_back({method.name, method.look, {{r.time.median, r.error_Bhat}}});
    }
    return figure;
  };
  const auto all = [](const Method&) { return true; };
  const auto without_unit_forces = [](const Method& method) { return !method.id.starts_with("unit"); };
  const std::string n = "degrees of freedom n";
  const std::string m = "inputs m";
  const std::string t = "median run time [µs]";
  return {
      over(analysis.single, {"fig3a", "Fig. 3 (a): n-link chain, last link actuated", n, t, false, true}, all),
      over(analysis.full, {"fig3b", "Fig. 3 (b): n-link chain, fully actuated", n, t, false, true}, all),
      ratios(analysis.single, {"fig3a_ratio", "Fig. 3 (a) to implicit inversion: last link actuated", n}),
      ratios(analysis.full, {"fig3b_ratio", "Fig. 3 (b) to implicit inversion: fully actuated", n}),
      over(analysis.chain_inputs, {"fig4a", "Fig. 4 (a): 50-link chain, m inputs", m, t, false, true}, all),
      over(analysis.chain_inputs, {"fig4b", "Fig. 4 (b): 50-link chain, m inputs, without unit forces", m, t},
           without_unit_forces),
      over(analysis.tree_inputs, {"table2", "Table 2: binary tree of 50 links, m inputs", m, t, false, true}, all),
      scatter({"chain", longest, longest}, {"error_chain", "Error and run time: 50-link chain, fully actuated"}),
      scatter({"biped", 20, 38}, {"error_biped", "Error and run time: biped, 20 degrees of freedom, 38 inputs"}),
  };
}

void write_csv(const Records& records, std::ostream& out)
{
  out << "model,n,m,method,median_us,lower_quartile_us,upper_quartile_us,repetitions,ratio_to_iim,error_Bhat,error_"
         "qdd0\n";
  for (const Record& r : records.all) {
    out << r.scene.model << ',' << r.scene.n << ',' << r.scene.m << ',' << r.method << ',' << r.time.median << ','
        << r.time.lower << ',' << r.time.upper << ',' << r.time.count << ',' << r.ratio << ',';
    if (std::isfinite(r.error_Bhat)) { out << r.error_Bhat; }
    out << ',' << r.error_qdd0 << '\n';
  }
}

Table circumstances_table(const Effort& effort, const Circumstances& at)
{
  Table table({"this run", ""});
  table.left();
  table.add({"date", date()});
  table.add({"processor", processor() + ", " + std::to_string(cores()) + " cores"});
  table.add({"core", at.core >= 0 ? "pinned to core " + std::to_string(at.core) : "not pinned"});
  table.add({"load at the start", at.load >= 0 ? text("%.2f", at.load) : "unknown"});
  table.add({"iim", std::string(iim_build::version) + ", commit " + iim_build::commit});
  table.add({"compiler", iim_build::compiler});
  table.add({"flags", iim_build::flags});
  table.add({"Eigen", iim_build::eigen});
  table.add({"repetitions", std::to_string(effort.repetitions) + " of about " + text("%g ms", 1e3 * effort.min_time) +
                                " per method and scene, in random order within a scene"});
  table.add({"states", std::to_string(effort.states) + " random ones in turn; " +
                           std::to_string(effort.reference_states) + " of them compared with 50 digits"});
  table.add({"duration", text("%.0f s", at.seconds)});
  return table;
}

}  // namespace

void write_report(const Records& records, const std::vector<Method>& methods, const Effort& effort,
                  const CostOfGrowth& cost, const Circumstances& circumstances, const std::filesystem::path& folder,
                  std::ostream& terminal)
{
  const Analysis analysis(records, methods, effort);
  const auto open = [&](const char* name) {
    std::ofstream file(folder / name);
    if (!file) { throw std::runtime_error("cannot write " + (folder / name).string()); }
    return file;
  };
  std::ofstream csv = open("tables.csv");
  write_csv(records, csv);
  const bool drawn = draw(figures(analysis), folder);
  std::ofstream markdown = open("report.md");
  Report report(terminal, markdown);
  const auto image = [&](const std::string& name, const std::string& caption) {
    if (drawn) { report.image(name + ".svg", caption); }
  };

  report.title("q̈₀ and B̂: the paper's study");
  report.table(circumstances_table(effort, circumstances));
  report.paragraph(
      "Times are processor times of one evaluation of q̈₀ and B̂ from (q, q̇), everything included: medians "
      "and quartiles over repetitions. “To IIM” is the ratio to implicit inversion in the same scene of this "
      "run. Errors are relative, in the Frobenius norm, the worst of the states compared. The paper measured "
      "Matlab programs on another processor; its text gives no run times, only the statements beside ours.");
  if (!drawn) {
    report.paragraph(
        "No figures: gnuplot is absent or failed. The files *.gp hold drawing and data; `gnuplot NAME.gp` "
        "draws one.");
  }

  report.section("Methods");
  Table what({"id", "method", "what it does"});
  what.left();
  for (const Method& method : methods) { what.add({method.id, method.name, method.what}); }
  report.table(what);

  report.section("The paper's statements and ours");
  report.table(statements(analysis));

  report.section("Fig. 3 (a): n-link chain, last link actuated");
  image("fig3a", "run time over n, one input");
  image("fig3a_ratio", "run time to implicit inversion over n, one input");
  report.table(length_table(analysis, analysis.single));
  report.paragraph(
      "Where the method of the row is faster than that of the column (the paper: IIM and global inverse meet "
      "at about 18):");
  report.table(break_even_table(analysis, analysis.single));
  report.paragraph("The fastest of all, by n: " + analysis.fastest(analysis.single) + ".");

  report.section("Fig. 3 (b): n-link chain, fully actuated");
  image("fig3b", "run time over n, n inputs");
  image("fig3b_ratio", "run time to implicit inversion over n, n inputs");
  report.table(length_table(analysis, analysis.full));
  report.paragraph(
      "Where the method of the row is faster than that of the column (the paper: IIM and global inverse meet "
      "at 18–19):");
  report.table(break_even_table(analysis, analysis.full));
  report.paragraph("The fastest of all, by n: " + analysis.fastest(analysis.full) + ".");

  report.section("Fig. 4 and Table 1: 50-link chain with 1 to 50 inputs");
  image("fig4a", "run time over m");
  image("fig4b", "run time over m, without unit forces");
  const Sayings per_input{{product, "≈ 1 %"}, {"global_dense", "≈ 0.33 %"}, {"unit_published", "≈ 33 %"}};
  report.table(input_table(analysis, analysis.chain_inputs, per_input));
  for (const Index m : {Index(1), longest}) { report.table(scene_table(analysis, {"chain", longest, m}, {})); }

  report.section("Table 2: complete binary tree");
  image("table2", "run time over m on the binary tree");
  report.table(topology_table(analysis, {{product, "as on the chain"},
                                         {"global_dense", "slightly faster than on the chain"},
                                         {"unit_published", "as on the chain"}}));
  report.table(input_table(analysis, analysis.tree_inputs, {}));
  for (const Index m : {Index(1), longest}) { report.table(scene_table(analysis, {"tree", longest, m}, {})); }
  report.paragraph("The tree with all of its six levels full:");
  for (const Index m : {Index(1), full_tree}) { report.table(scene_table(analysis, {"tree", full_tree, m}, {})); }

  report.section("Table 3: biped, 20 degrees of freedom, 14 motors and 8 contact points");
  report.table(scene_table(analysis, {"biped", 20, 38},
                           {{product, "slightly faster than the global inverse"},
                            {"global_dense", "slightly slower than IIM"},
                            {"unit_published", "slowest"}}));

  report.section("How the cost grows");
  report.table(cost_table(cost));

  report.section("What each scene costs");
  report.paragraph(
      "Operations of one evaluation, counted by a Scalar that counts what is done with it. Products include divisions; "
      "most of them go with a sum into a multiply-add. B̂ and task rows are beyond the O(n) pass, which leaves q̈₀. "
      "Task rows are J_t, J̇_t q̇ and V̇_t0, for which B̂ is not needed; J_t B̂ is a product with B̂, which comes first "
      "and has a row of its own. With springs, every joint of the arm has a spring and a damper.");
  report.table(scenes_table());
  report.paragraph(
      "Gravity is the acceleration with which the pass's last loop begins, and no operation. Only small pivots make "
      "the numbers depend on the state, as they are computed anew: of these robots the arm has some, though not in "
      "the state of the table. Which of its two forms B̂ takes is decided here for one number at a time; registers of "
      "several may make it the other.");

  report.section("Error against run time");
  image("error_chain", "error of B̂ against run time, chain");
  image("error_biped", "error of B̂ against run time, biped");
  report.paragraph("All numbers stand in tables.csv, every repetition in benchmark.json.");
  if (!markdown || !csv) { throw std::runtime_error("cannot write into " + folder.string()); }
}

}  // namespace bench
