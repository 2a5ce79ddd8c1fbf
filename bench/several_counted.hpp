// A number that counts what is done to it: the floating-point work of one state.
#pragma once

#include <Eigen/Core>

#include <cmath>
#include <limits>
#include <ostream>

namespace bench {

/// A double that counts its operations; a fused multiply-add is two, a division, root or sine one.
struct Counted {
  double x = 0;
  static inline long operations = 0;

  Counted() = default;
  Counted(double value) : x(value) {}
  Counted(int value) : x(value) {}
  Counted(long value) : x(static_cast<double>(value)) {}
  explicit operator double() const { return x; }

  Counted& operator+=(const Counted& b) { return count(x + b.x); }
  Counted& operator-=(const Counted& b) { return count(x - b.x); }
  Counted& operator*=(const Counted& b) { return count(x * b.x); }
  Counted& operator/=(const Counted& b) { return count(x / b.x); }
  friend Counted operator+(Counted a, const Counted& b) { return a += b; }
  friend Counted operator-(Counted a, const Counted& b) { return a -= b; }
  friend Counted operator*(Counted a, const Counted& b) { return a *= b; }
  friend Counted operator/(Counted a, const Counted& b) { return a /= b; }
  friend Counted operator-(const Counted& a) { return Counted(-a.x); }
  friend bool operator==(const Counted& a, const Counted& b) { return a.x == b.x; }
  friend auto operator<=>(const Counted& a, const Counted& b) { return a.x <=> b.x; }
  friend Counted sqrt(Counted a) { return a.count(std::sqrt(a.x)); }
  friend Counted sin(Counted a) { return a.count(std::sin(a.x)); }
  friend Counted cos(Counted a) { return a.count(std::cos(a.x)); }
  friend bool isfinite(const Counted& a) { return std::isfinite(a.x); }
  friend std::ostream& operator<<(std::ostream& out, const Counted& a) { return out << a.x; }

private:
  Counted& count(double result)
  {
    ++operations;
    x = result;
    return *this;
  }
};

}  // namespace bench

template <>
struct Eigen::NumTraits<bench::Counted> : Eigen::GenericNumTraits<double> {
  using Real = bench::Counted;
  using NonInteger = bench::Counted;
  using Literal = bench::Counted;
  using Nested = bench::Counted;
  static bench::Counted epsilon() { return std::numeric_limits<double>::epsilon(); }
  static bench::Counted dummy_precision() { return 1e-12; }
  static bench::Counted highest() { return std::numeric_limits<double>::max(); }
  static bench::Counted lowest() { return std::numeric_limits<double>::lowest(); }
  static bench::Counted quiet_NaN() { return std::numeric_limits<double>::quiet_NaN(); }
};
