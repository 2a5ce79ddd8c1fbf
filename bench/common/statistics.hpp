// What is said about a handful of repeated measurements, and about a series of them.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <vector>

namespace bench {

/// Median and quartiles of repeated measurements.
struct Spread {
  double median = std::numeric_limits<double>::quiet_NaN();
  double lower = median;  ///< first quartile
  double upper = median;  ///< third quartile
  std::size_t count = 0;
};

/// Quantile p of sorted numbers, interpolated between neighbours.
inline double quantile(const std::vector<double>& sorted, double p)
{
  const double place = p * static_cast<double>(sorted.size() - 1);
  const auto below = static_cast<std::size_t>(place);
  const std::size_t above = std::min(below + 1, sorted.size() - 1);
  return sorted[below] + (place - static_cast<double>(below)) * (sorted[above] - sorted[below]);
}

inline Spread spread(std::vector<double> samples)
{
  if (samples.empty()) { return {}; }
  std::sort(samples.begin(), samples.end());
  return {quantile(samples, 0.5), quantile(samples, 0.25), quantile(samples, 0.75), samples.size()};
}

/// A point of a curve.
struct Point {
  double x;
  double y;
};

/// Slope of the straight line of least squares; NaN for fewer than two abscissae.
inline double slope(const std::vector<Point>& points)
{
  double x = 0;
  double y = 0;
  for (const Point& p : points) {
    x += p.x / static_cast<double>(points.size());
    y += p.y / static_cast<double>(points.size());
  }
  double xx = 0;
  double xy = 0;
  for (const Point& p : points) {
    xx += (p.x - x) * (p.x - x);
    xy += (p.x - x) * (p.y - y);
  }
  return xx > 0 ? xy / xx : std::numeric_limits<double>::quiet_NaN();
}

/// Where two curves over the same abscissae change places.
struct BreakEven {
  bool first_below_at_start = false;  ///< whether the first curve begins below the second
  bool first_below_at_end = false;
  std::optional<double> first;  ///< first crossing; none if the curves never cross
  std::optional<double> last;   ///< last crossing; differs from `first` where noise or a step makes several
};

/// Crossings of a and b, by linear interpolation between the abscissae.
inline BreakEven break_even(const std::vector<Point>& a, const std::vector<Point>& b)
{
  BreakEven result;
  const std::size_t count = std::min(a.size(), b.size());
  if (count == 0) { return result; }
  result.first_below_at_start = a.front().y < b.front().y;
  result.first_below_at_end = a[count - 1].y < b[count - 1].y;
  for (std::size_t k = 1; k < count; ++k) {
    const double before = a[k - 1].y - b[k - 1].y;
    const double after = a[k].y - b[k].y;
    if ((before < 0) != (after < 0)) {
      const double x = a[k - 1].x + (a[k].x - a[k - 1].x) * before / (before - after);
      if (!result.first) { result.first = x; }
      result.last = x;
    }
  }
  return result;
}

}  // namespace bench
