// A Scalar that counts its operations: what a scene costs is a number, without noise.
#pragma once

#include <Eigen/Core>

#include <cmath>
#include <limits>
#include <ostream>

namespace iim::test {

/// A double that counts multiplications and divisions, additions apart.
struct Counted {
  double x = 0;
  static inline long products = 0, sums = 0, roots = 0;

  Counted() = default;
  Counted(double value) : x(value) {}
  Counted(int value) : x(value) {}
  Counted(long value) : x(static_cast<double>(value)) {}
  explicit operator double() const { return x; }

  Counted& operator+=(const Counted& b) { return ++sums, x += b.x, *this; }
  Counted& operator-=(const Counted& b) { return ++sums, x -= b.x, *this; }
  Counted& operator*=(const Counted& b) { return ++products, x *= b.x, *this; }
  Counted& operator/=(const Counted& b) { return ++products, x /= b.x, *this; }
  friend Counted operator+(Counted a, const Counted& b) { return a += b; }
  friend Counted operator-(Counted a, const Counted& b) { return a -= b; }
  friend Counted operator*(Counted a, const Counted& b) { return a *= b; }
  friend Counted operator/(Counted a, const Counted& b) { return a /= b; }
  friend Counted operator-(const Counted& a) { return Counted(-a.x); }
  friend bool operator==(const Counted& a, const Counted& b) { return a.x == b.x; }
  friend auto operator<=>(const Counted& a, const Counted& b) { return a.x <=> b.x; }
  friend Counted sqrt(const Counted& a) { return ++roots, Counted(std::sqrt(a.x)); }
  friend Counted sin(const Counted& a) { return ++roots, Counted(std::sin(a.x)); }
  friend Counted cos(const Counted& a) { return ++roots, Counted(std::cos(a.x)); }
  friend bool isfinite(const Counted& a) { return std::isfinite(a.x); }
  friend std::ostream& operator<<(std::ostream& out, const Counted& a) { return out << a.x; }
};

/// Products that f does; most of them are fused with a sum.
template <class F>
long count_products(F&& f)
{
  Counted::products = Counted::sums = Counted::roots = 0;
  f();
  return Counted::products;
}

}  // namespace iim::test

template <>
struct Eigen::NumTraits<iim::test::Counted> : Eigen::GenericNumTraits<double> {
  using Real = iim::test::Counted;
  using NonInteger = iim::test::Counted;
  using Literal = iim::test::Counted;
  using Nested = iim::test::Counted;
  enum { RequireInitialization = 1 };
  static iim::test::Counted epsilon() { return std::numeric_limits<double>::epsilon(); }
  static iim::test::Counted dummy_precision() { return 1e-12; }
  static iim::test::Counted highest() { return std::numeric_limits<double>::max(); }
  static iim::test::Counted lowest() { return std::numeric_limits<double>::lowest(); }
  static iim::test::Counted quiet_NaN() { return std::numeric_limits<double>::quiet_NaN(); }
};
