// A Scalar that counts what is done with it.
#pragma once

#include <Eigen/Core>

#include <cmath>
#include <compare>
#include <concepts>
#include <limits>
#include <ostream>

namespace bench {

/// Operations since Counted::done was last set to {}: multiplications and divisions; additions and subtractions; roots
/// and functions of angles.
struct Operations {
  double products = 0, sums = 0, functions = 0;

  double all() const { return products + sums + functions; }

  friend Operations operator-(const Operations& a, const Operations& b)
  {
    return {a.products - b.products, a.sums - b.sums, a.functions - b.functions};
  }
  friend Operations operator/(const Operations& a, double b) { return {a.products / b, a.sums / b, a.functions / b}; }
};

/// A double that counts its operations; a fused multiply-add is two.
struct Counted {
  static inline Operations done{};

  double x = 0;

  Counted() = default;
  Counted(double value) : x(value) {}
  Counted(int value) : x(value) {}
  Counted(long value) : x(static_cast<double>(value)) {}
  explicit operator double() const { return x; }
  explicit operator int() const { return static_cast<int>(x); }

  Counted& operator+=(const Counted& b) { return ++done.sums, x += b.x, *this; }
  Counted& operator-=(const Counted& b) { return ++done.sums, x -= b.x, *this; }
  Counted& operator*=(const Counted& b) { return ++done.products, x *= b.x, *this; }
  Counted& operator/=(const Counted& b) { return ++done.products, x /= b.x, *this; }
  friend Counted operator+(Counted a, const Counted& b) { return a += b; }
  friend Counted operator-(Counted a, const Counted& b) { return a -= b; }
  friend Counted operator*(Counted a, const Counted& b) { return a *= b; }
  friend Counted operator/(Counted a, const Counted& b) { return a /= b; }
  friend Counted operator-(const Counted& a) { return Counted(-a.x); }
  friend bool operator==(const Counted& a, const Counted& b) { return a.x == b.x; }
  friend auto operator<=>(const Counted& a, const Counted& b) { return a.x <=> b.x; }
  friend Counted abs(const Counted& a) { return Counted(std::abs(a.x)); }
  friend Counted sqrt(const Counted& a) { return function(std::sqrt(a.x)); }
  friend Counted sin(const Counted& a) { return function(std::sin(a.x)); }
  friend Counted cos(const Counted& a) { return function(std::cos(a.x)); }
  friend Counted atan2(const Counted& a, const Counted& b) { return function(std::atan2(a.x, b.x)); }
  friend bool isfinite(const Counted& a) { return std::isfinite(a.x); }
  friend std::ostream& operator<<(std::ostream& out, const Counted& a) { return out << a.x; }

private:
  static Counted function(double value) { return ++done.functions, Counted(value); }
};

/// What f does.
template <std::invocable F>
Operations operations(F&& f)
{
  Counted::done = {};
  f();
  return Counted::done;
}

}  // namespace bench

template <>
struct Eigen::NumTraits<bench::Counted> : Eigen::GenericNumTraits<double> {
  using Real = bench::Counted;
  using NonInteger = bench::Counted;
  using Literal = bench::Counted;
  using Nested = bench::Counted;
  enum { RequireInitialization = 1 };
  static Real epsilon() { return std::numeric_limits<double>::epsilon(); }
  static Real dummy_precision() { return 1e-12; }
  static Real highest() { return std::numeric_limits<double>::max(); }
  static Real lowest() { return std::numeric_limits<double>::lowest(); }
  static Real quiet_NaN() { return std::numeric_limits<double>::quiet_NaN(); }
};
