// A Scalar that carries a derivative: the time derivatives of q̈₀ and B̂ along a motion, against finite differences.
#include "catch.hpp"
#include "random_tree.hpp"

#include <cmath>
#include <limits>
#include <ostream>
#include <vector>

namespace {

/// x + d·dt with dt² = 0. One made from nothing is no number: Scalar() need not be 0, as it is not of AutoDiffScalar.
struct Dual {
  double x = std::numeric_limits<double>::quiet_NaN(), d = x;

  Dual() = default;
  Dual(double value) : x(value), d(0) {}
  Dual(double value, double derivative) : x(value), d(derivative) {}
  explicit operator double() const { return x; }

  Dual& operator+=(const Dual& b) { return x += b.x, d += b.d, *this; }
  Dual& operator-=(const Dual& b) { return x -= b.x, d -= b.d, *this; }
  Dual& operator*=(const Dual& b) { return d = d * b.x + x * b.d, x *= b.x, *this; }
  Dual& operator/=(const Dual& b) { return d = (d - x / b.x * b.d) / b.x, x /= b.x, *this; }
  friend Dual operator+(Dual a, const Dual& b) { return a += b; }
  friend Dual operator-(Dual a, const Dual& b) { return a -= b; }
  friend Dual operator*(Dual a, const Dual& b) { return a *= b; }
  friend Dual operator/(Dual a, const Dual& b) { return a /= b; }
  friend Dual operator-(const Dual& a) { return {-a.x, -a.d}; }
  friend bool operator==(const Dual& a, const Dual& b) { return a.x == b.x; }
  friend auto operator<=>(const Dual& a, const Dual& b) { return a.x <=> b.x; }
  friend Dual sqrt(const Dual& a) { return {std::sqrt(a.x), a.d / (2 * std::sqrt(a.x))}; }
  friend Dual sin(const Dual& a) { return {std::sin(a.x), std::cos(a.x) * a.d}; }
  friend Dual cos(const Dual& a) { return {std::cos(a.x), -std::sin(a.x) * a.d}; }
  friend bool isfinite(const Dual& a) { return std::isfinite(a.x) && std::isfinite(a.d); }
  friend std::ostream& operator<<(std::ostream& out, const Dual& a) { return out << a.x << "+" << a.d << "dt"; }
};

}  // namespace

template <>
struct Eigen::NumTraits<Dual> : Eigen::GenericNumTraits<double> {
  using Real = Dual;
  using NonInteger = Dual;
  using Literal = Dual;
  using Nested = Dual;
  enum { RequireInitialization = 1 };
  static Dual epsilon() { return std::numeric_limits<double>::epsilon(); }
  static Dual dummy_precision() { return 1e-12; }
  static Dual highest() { return std::numeric_limits<double>::max(); }
  static Dual lowest() { return std::numeric_limits<double>::lowest(); }
  static Dual quiet_NaN() { return std::numeric_limits<double>::quiet_NaN(); }
};

using namespace iim;

namespace {

constexpr double eps = std::numeric_limits<double>::epsilon();

/// q̈₀ beside B̂ of a robot.
template <class T>
MatrixX<T> solve(const StandardAssembly<T>& assembly, const std::vector<test::NamedInput>& named, const VectorX<T>& q,
                 const VectorX<T>& qd)
{
  const DynamicTree tree(assembly);
  const Inputs inputs = test::make_inputs(tree, named);
  Workspace ws(tree);
  ImplicitInversion method(tree, inputs);
  const auto result = method(forward_dynamics(q, qd, ws));
  REQUIRE(result.ok());
  MatrixX<T> both(tree.n_v(), 1 + inputs.columns());
  both << result.qdd0, result.Bhat;
  return both;
}

}  // namespace

TEST_CASE("derivatives of q̈₀ and B̂ along a motion", "[scalar]")
{
  test::RandomOptions options;
  options.most = 8;
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    INFO("seed " << seed);
    const test::RandomRobot random = test::random_robot(seed, options);
    const DynamicTree tree(random.assembly);
    if (tree.n_v() == 0) { continue; }
    test::Random draw(seed);
    const test::RandomState state = test::random_state(tree, 0, draw);
    // The quaternion's rate is a small one and its length need not stay: what is off is divided out, and
    // differentiated.
    const Eigen::VectorXd q_rate = Eigen::VectorXd::NullaryExpr(tree.n_q(), [&] { return draw.uniform(-0.5, 0.5); });
    const Eigen::VectorXd qdd = Eigen::VectorXd::NullaryExpr(tree.n_v(), [&] { return draw.uniform(-1, 1); });

    VectorX<Dual> q(tree.n_q()), qd(tree.n_v());
    for (Index k = 0; k < q.size(); ++k) { q(k) = Dual(state.q(k), q_rate(k)); }
    for (Index k = 0; k < qd.size(); ++k) { qd(k) = Dual(state.qd(k), qdd(k)); }
    const MatrixX<Dual> dual = solve<Dual>(test::in<Dual>(random.assembly), random.inputs, q, qd);

    // Fourth-order differences in long double: rounding 1e-19/h = 1e-15, truncation h⁴/30 = 5e-17 of a fifth
    // derivative, which a solution of size one over lengths of 0.1 may have at 1e7.
    using Real = long double;
    const Real h = 2e-4L;
    const auto aside = [&](int steps) {
      const VectorX<Real> q_l = state.q.cast<Real>() + Real(steps) * h * q_rate.cast<Real>();
      const VectorX<Real> qd_l = state.qd.cast<Real>() + Real(steps) * h * qdd.cast<Real>();
      return solve<Real>(test::in<Real>(random.assembly), random.inputs, q_l, qd_l);
    };
    const MatrixX<Real> difference = (Real(8) * (aside(1) - aside(-1)) - (aside(2) - aside(-2))) / (Real(12) * h);
    const MatrixX<Real> value = aside(0);
    for (Index j = 0; j < dual.cols(); ++j) {
      Real wrong = 0, off = 0;
      for (Index i = 0; i < dual.rows(); ++i) {
        wrong += std::pow(Real(dual(i, j).d) - difference(i, j), 2);
        off += std::pow(Real(dual(i, j).x) - value(i, j), 2);
      }
      // Columns of forces on the world's side are roundings of zero: measured beside the whole as well.
      const Real scale = value.col(j).norm() + Real(1e-3) * value.norm();
      CHECK(std::sqrt(off) <= 800 * eps * scale);  // as in test_reference_library
      CHECK(std::sqrt(wrong) <= Real(1e-9) * (scale + difference.col(j).norm()));
    }
  }
}
