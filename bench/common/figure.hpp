// Line and point charts as SVG, drawn by gnuplot from a file that holds its own data.
#pragma once

#include "methods.hpp"
#include "statistics.hpp"

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace bench {

struct Curve {
  std::string title;
  Look look;
  std::vector<Point> points;
};

struct Figure {
  std::string file;  ///< without extension
  std::string title;
  std::string x{};  ///< label with unit
  std::string y{};
  bool log_x = false;
  bool log_y = false;
  bool scatter = false;  ///< large points, no lines
  double y_min = 0;      ///< where a linear axis begins
  double y_max = 0;      ///< cut off there; 0: as far as the curves reach
  std::vector<Curve> curves{};
};

/// Smallest and largest abscissa or ordinate of all curves.
inline std::pair<double, double> extent(const Figure& figure, double Point::* coordinate)
{
  std::pair<double, double> range{std::numeric_limits<double>::infinity(), 0};
  for (const Curve& curve : figure.curves) {
    for (const Point& p : curve.points) {
      range.first = std::min(range.first, p.*coordinate);
      range.second = std::max(range.second, p.*coordinate);
    }
  }
  return range;
}

/// The figure as a gnuplot program; NAME.svg appears in the folder where gnuplot runs.
inline std::string gnuplot_text(const Figure& figure)
{
  std::ostringstream out;
  out.precision(6);
  out << "set terminal svg size 1000,560 dynamic enhanced background rgb 'white' font 'DejaVu "
         "Sans,Arial,sans-serif,15'\n"
      << "set encoding utf8\n"
      << "set output '" << figure.file << ".svg'\n"
      << "set title \"" << figure.title << "\"\n"
      << "set xlabel \"" << figure.x << "\"\n"
      << "set ylabel \"" << figure.y << "\"\n"
      << "set key outside right center Left reverse samplen 2.5 spacing 1.25\n"
      << "set border 3\nset tics nomirror\n"
      << "set grid xtics ytics mytics linecolor rgb '#cccccc', linecolor rgb '#eeeeee'\n";
  if (figure.log_x) { out << "set logscale x\n"; }
  if (figure.log_y) { out << "set logscale y\n"; }
  if (figure.scatter) {
    const auto [x_low, x_high] = extent(figure, &Point::x);
    const auto [y_low, y_high] = extent(figure, &Point::y);
    out << "set xrange [" << x_low / 2 << ":" << x_high * 2 << "]\n"
        << "set yrange [" << y_low / 3 << ":" << y_high * 3 << "]\n"
        << "set format y '10^{%T}'\n"
        << "set xtics (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000)\n";
  } else {
    out << "set xrange [" << (figure.log_x ? "*" : "0") << ":*]\n";
    if (figure.log_y) {
      out << "set yrange [" << extent(figure, &Point::y).first / 1.25 << ":*]\n";
    } else {
      out << "set yrange [" << figure.y_min << ":" << (figure.y_max > 0 ? std::to_string(figure.y_max) : "*") << "]\n";
    }
  }
  for (std::size_t c = 0; c < figure.curves.size(); ++c) {
    out << "$curve" << c << " << END\n";
    for (const Point& p : figure.curves[c].points) { out << p.x << ' ' << p.y << '\n'; }
    out << "END\n";
  }
  out << "plot ";
  for (std::size_t c = 0; c < figure.curves.size(); ++c) {
    const Look& look = figure.curves[c].look;
    out << (c > 0 ? ", \\\n  " : "") << "$curve" << c << " using 1:2 with "
        << (figure.scatter ? "points" : "linespoints") << " linecolor rgb '" << look.colour << "' pointtype "
        << look.point << " pointsize " << (figure.scatter ? 1.6 : 0.55);
    if (figure.scatter) {
      out << " linewidth 2";
    } else {
      out << " linewidth " << look.width << " dashtype " << look.dash;
    }
    out << " title \"" << figure.curves[c].title << "\"";
  }
  out << '\n';
  return out.str();
}

/// Writes NAME.gp for every figure into the folder, and NAME.svg if there is gnuplot. Returns false if there is none.
inline bool draw(const std::vector<Figure>& figures, const std::filesystem::path& folder)
{
  const std::filesystem::path here = std::filesystem::current_path();
  for (const Figure& figure : figures) {
    std::ofstream out(folder / (figure.file + ".gp"));
    out << gnuplot_text(figure);
    if (!out) { throw std::runtime_error("cannot write " + (folder / (figure.file + ".gp")).string()); }
  }
  std::filesystem::current_path(folder);
  bool drawn = true;
  for (const Figure& figure : figures) {
    drawn = drawn && std::system(("gnuplot " + figure.file + ".gp > gnuplot.log 2>&1").c_str()) == 0;
  }
  if (drawn) { std::filesystem::remove("gnuplot.log"); }
  std::filesystem::current_path(here);
  return drawn;
}

}  // namespace bench
