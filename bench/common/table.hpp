// Tables for the console and for Markdown, and numbers as they are written into them.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ostream>
#include <string>
#include <utility>
#include <vector>

namespace bench {

/// Number of columns that UTF-8 text takes: continuation bytes and combining marks (U+0300 … U+036F) take none.
inline std::size_t width(const std::string& text)
{
  std::size_t count = 0;
  for (std::size_t k = 0; k < text.size(); ++k) {
    const auto byte = static_cast<unsigned char>(text[k]);
    const auto next = k + 1 < text.size() ? static_cast<unsigned char>(text[k + 1]) : 0u;
    const bool continuation = (byte & 0xC0u) == 0x80u;
    const bool combining = byte == 0xCCu || (byte == 0xCDu && next < 0xB0u);
    count += !continuation && !combining;
  }
  return count;
}

/// Rows of text under a head. The first column is aligned left, the others right.
class Table {
public:
  explicit Table(std::vector<std::string> head) : rows_{std::move(head)} {}

  void add(std::vector<std::string> row)
  {
    row.resize(rows_.front().size());
    rows_.push_back(std::move(row));
  }

  /// All columns aligned left: for sentences.
  Table& left()
  {
    left_ = true;
    return *this;
  }

  bool empty() const { return rows_.size() < 2; }

  void print(std::ostream& out) const { write(out, "  ", "", ""); }
  void markdown(std::ostream& out) const { write(out, " | ", "| ", " |"); }

private:
  void write(std::ostream& out, const std::string& between, const std::string& before, const std::string& after) const
  {
    std::vector<std::size_t> widths(rows_.front().size(), 3);
    for (const auto& row : rows_) {
      for (std::size_t k = 0; k < row.size(); ++k) { widths[k] = std::max(widths[k], width(row[k])); }
    }
    for (std::size_t r = 0; r < rows_.size(); ++r) {
      std::string line = before;
      std::string rule = before;
      for (std::size_t k = 0; k < widths.size(); ++k) {
        const std::string gap(widths[k] - width(rows_[r][k]), ' ');
        const bool to_the_left = left_ || k == 0;
        line += (k > 0 ? between : "") + (to_the_left ? rows_[r][k] + gap : gap + rows_[r][k]);
        std::string dashes(widths[k], '-');
        if (!before.empty() && !to_the_left) { dashes.back() = ':'; }
        rule += (k > 0 ? between : "") + dashes;
      }
      if (before.empty()) { line.erase(line.find_last_not_of(' ') + 1); }
      out << line << after << '\n';
      if (r == 0) { out << rule << after << '\n'; }
    }
  }

  std::vector<std::vector<std::string>> rows_;
  bool left_ = false;
};

/// printf for one number.
inline std::string text(const char* format, double x)
{
  char buffer[64];
  std::snprintf(buffer, sizeof buffer, format, x);
  return buffer;
}

/// Three significant digits without an exponent.
inline std::string three_digits(double x)
{
  if (!std::isfinite(x)) { return "–"; }
  const double size = std::abs(x);
  if (size >= 99.95) { return text("%.0f", x); }
  return text(size >= 9.995 ? "%.1f" : size >= 0.9995 ? "%.2f" : "%.3f", x);
}

/// An error or a condition number; "–" for what was not measured (NaN).
inline std::string magnitude(double x)
{
  if (std::isnan(x)) { return "–"; }
  return x == 0 ? "0" : text("%.1e", x);
}

}  // namespace bench
