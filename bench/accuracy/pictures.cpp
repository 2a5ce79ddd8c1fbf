// PART OF: iim_accuracy
// Figures of errors.
#include "report.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>
#include <stdexcept>

namespace bench {

namespace {

/// One colour and point per variant.
const std::vector<std::pair<std::string, Look>> looks{{"implicit inversion, printed", {"#E69F00", 5, 1, 2}},
                                                      {"implicit inversion, projected", {"#0072B2", 7, 1, 2.5}},
                                                      {"implicit inversion, square root", {"#009E73", 9, 1, 2.5}},
                                                      {"unit forces, projected", {"#56B4E9", 6, 2, 1.5}},
                                                      {"recursive inverse, projected", {"#CC79A7", 8, 2, 1.5}},
                                                      {"body-fixed frames, printed", {"#8C564B", 4, 4, 1.5}},
                                                      {"body-fixed frames, projected", {"#8C564B", 12, 1, 1.5}},
                                                      {"body-fixed frames, square root", {"#8C564B", 2, 3, 1.5}},
                                                      {"common origin, printed", {"#7F7F7F", 10, 4, 1.5}},
                                                      {"common origin, projected", {"#7F7F7F", 11, 1, 1.5}},
                                                      {"common origin, square root", {"#7F7F7F", 1, 3, 1.5}},
                                                      {"branch-sparse Cholesky", {"#D55E00", 13, 1, 2}}};

/// In the picture of error against time.
const std::vector<std::pair<std::string, const char*>> colours{{"implicit inversion, printed", "#E69F00"},
                                                               {"implicit inversion, projected", "#0072B2"},
                                                               {"implicit inversion, square root", "#009E73"},
                                                               {"unit forces, printed", "#F5C76A"},
                                                               {"unit forces, projected", "#56B4E9"},
                                                               {"unit forces, square root", "#7FD1B9"},
                                                               {"recursive inverse, printed", "#F0E442"},
                                                               {"recursive inverse, projected", "#CC79A7"},
                                                               {"recursive inverse, square root", "#9467BD"},
                                                               {"body-fixed frames, printed", "#C49C94"},
                                                               {"body-fixed frames, projected", "#8C564B"},
                                                               {"body-fixed frames, square root", "#5C2E23"},
                                                               {"common origin, printed", "#C7C7C7"},
                                                               {"common origin, projected", "#7F7F7F"},
                                                               {"common origin, square root", "#4D4D4D"},
                                                               {"branch-sparse Cholesky", "#D55E00"},
                                                               {"dense Cholesky", "#000000"}};

const std::map<std::string, int> points{{"float", 9}, {"double", 7}, {"long double", 5}};

std::string text_of(double x)
{
  std::ostringstream out;
  out << x;
  return out.str();
}

std::string file_name(std::string text)
{
  std::replace_if(text.begin(), text.end(), [](char c) { return c == ' ' || c == ','; }, '_');
  return text;
}

/// Runs gnuplot on NAME.gp in the folder.
bool run_gnuplot(const std::string& folder, const std::string& name)
{
  const bool drawn = std::system(("cd '" + folder + "' && gnuplot " + name + ".gp > gnuplot.log 2>&1").c_str()) == 0;
  if (drawn) { std::filesystem::remove(std::filesystem::path(folder) / "gnuplot.log"); }
  return drawn;
}

void write(const std::string& folder, const std::string& name, const std::string& text)
{
  std::ofstream out(std::filesystem::path(folder) / (name + ".gp"));
  out << text;
  out.close();
  if (!out) { throw std::runtime_error("cannot write " + name + ".gp"); }
}

}  // namespace

bool draw_in_powers(const std::vector<Figure>& figures, const std::string& folder)
{
  bool drawn = true;
  for (const Figure& figure : figures) {
    std::string text = gnuplot_text(figure);
    std::string powers = figure.log_x && extent(figure, &Point::x).second > 1e4 ? "set format x '10^{%T}'\n" : "";
    if (figure.log_y) {
      powers += "set format y '10^{%T}'\nset yrange [" + text_of(extent(figure, &Point::y).first / 2) + ":*]\n";
    }
    text.insert(text.rfind("\nplot ") + 1, powers);
    write(folder, figure.file, text);
    drawn = drawn && run_gnuplot(folder, figure.file);
  }
  return drawn;
}

Figure error_over(const std::vector<AccuracyResult>& results, const std::string& group, const std::string& title,
                  const std::string& x, const std::string& scalar)
{
  Figure figure{
      file_name("accuracy_" + group + "_" + scalar), title + ", " + scalar, x, "relative error of B̂", true, true};
  for (const auto& [variant, look] : looks) {
    Curve curve{variant, look, {}};
    for (const AccuracyResult& result : results) {
      if (result.scene.group != group) { continue; }
      for (const Outcome& o : result.outcomes) {
        if (o.scalar == scalar && o.variant == variant && o.refused < static_cast<int>(result.scene.states.size())) {
          curve.points.push_back({result.scene.parameter, std::clamp(o.Bhat_error, 1e-20, 1e3)});
        }
      }
    }
    if (!curve.points.empty()) { figure.curves.push_back(curve); }
  }
  Curve data{"one ε in the data", {"#000000", 1, 3, 1}, {}};
  for (const AccuracyResult& result : results) {
    if (result.scene.group != group || !result.reference.failure.empty()) { continue; }
    const double epsilons = std::ldexp(1.0, scalar == "float" ? 29 : scalar == "double" ? 0 : -11);
    data.points.push_back({result.scene.parameter, epsilons * result.reference.worst(&Yardstick::Bhat_sensitivity)});
  }
  figure.curves.push_back(data);
  return figure;
}

std::vector<const Outcome*> accuracy_front(const std::vector<Outcome>& outcomes)
{
  const auto stands = [](const Outcome& o) { return o.time > 0 && o.refused == 0 && o.Bhat_error > 0; };
  std::vector<const Outcome*> front;
  for (const Outcome& o : outcomes) {
    const bool beaten = std::any_of(outcomes.begin(), outcomes.end(), [&](const Outcome& other) {
      return stands(other) && other.time <= o.time && other.Bhat_error <= o.Bhat_error &&
             (other.time < o.time || other.Bhat_error < o.Bhat_error);
    });
    if (stands(o) && !beaten) { front.push_back(&o); }
  }
  std::sort(front.begin(), front.end(), [](const Outcome* a, const Outcome* b) { return a->time < b->time; });
  return front;
}

std::string draw_error_against_time(const AccuracyResult& result, const std::string& folder, bool& drawn)
{
  const std::string name = file_name("accuracy_time_" + result.scene.name);
  std::vector<Point> all;
  std::ostringstream data;
  std::ostringstream key;
  std::ostringstream plot;
  data.precision(6);
  // The first variants last, and smaller: points that coincide show as rings.
  for (auto look = colours.rbegin(); look != colours.rend(); ++look) {
    const auto& [variant, colour] = *look;
    for (const auto& [scalar, point] : points) {
      for (const Outcome& o : result.outcomes) {
        if (o.variant != variant || o.scalar != scalar || !(o.time > 0) || o.refused > 0 || !(o.Bhat_error > 0)) {
          continue;
        }
        all.push_back({o.time, o.Bhat_error});
        const std::string block = "$p" + std::to_string(all.size());
        data << block << " << END\n" << o.time << ' ' << o.Bhat_error << "\nEND\n";
        plot << ", \\\n  " << block << " using 1:2 with points linecolor rgb '" << colour << "' pointtype " << point
             << " pointsize " << (variant.rfind("implicit", 0) == 0 ? 1.0 : 1.6) << " notitle";
      }
    }
  }
  for (const auto& [variant, colour] : colours) {
    key << ", \\\n  keyentry with points linecolor rgb '" << colour << "' pointtype 7 pointsize 1.4 title \"" << variant
        << '"';
  }
  std::vector<Point> front;
  for (const Outcome* o : accuracy_front(result.outcomes)) { front.push_back({o->time, o->Bhat_error}); }
  std::ostringstream out;
  out.precision(6);
  out << "set terminal svg size 1100,760 dynamic enhanced background rgb 'white' font 'DejaVu "
         "Sans,Arial,sans-serif,15'\n"
      << "set encoding utf8\nset output '" << name << ".svg'\n"
      << "set title \"Error against run time: " << result.scene.name << "   (▲ float, ● double, ■ long double)\"\n"
      << "set xlabel \"time for q̈₀ and B̂ [µs]\"\nset ylabel \"relative error of B̂, worst state\"\n"
      << "set key outside right center Left reverse maxcols 1 samplen 1 spacing 1.25\nset border 3\nset tics nomirror\n"
      << "set grid xtics ytics mytics linecolor rgb '#cccccc', linecolor rgb '#eeeeee'\n"
      << "set logscale xy\nset format y '10^{%T}'\n$front << END\n";
  for (const Point& p : front) { out << p.x << ' ' << p.y << '\n'; }
  out << "END\n"
      << data.str() << "plot $front using 1:2 with steps linecolor rgb '#999999' linewidth 4 title \"front\""
      << key.str() << plot.str() << '\n';
  write(folder, name, out.str());
  drawn = drawn && run_gnuplot(folder, name);
  return name;
}

}  // namespace bench
