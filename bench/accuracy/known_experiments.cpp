// PART OF: iim_accuracy
// Two studies of others, as far as their descriptions go.
//
// R. Featherstone, An empirical study of the joint space inertia matrix, Int. J. Robotics Research 23(9), 2004:
// condition numbers of M between O(N) and O(N⁴), up to 4N⁴ on unbranched chains, smaller on branched mechanisms.
// U. M. Ascher, D. K. Pai, B. P. Cloutier, Forward dynamics, elimination methods, and formulation stiffness in robot
// simulation, Int. J. Robotics Research 16(6), 1997: composites with Cholesky cancel where articulated bodies do not,
// and an integrator with adaptive steps pays for it with smaller steps.
#include "../common/table.hpp"
#include "report.hpp"

#include <iim/equations_of_motion.hpp>
#include <iim/global_inverse.hpp>
#include <iim/recursive_inverse.hpp>

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>

namespace bench {

namespace {

using Parts = iim::StandardAssembly<double>;
using Vec3 = iim::Vector3<double>;

/// A uniform thin rod along −z that turns about y at its upper end.
iim::RevoluteLink<double> thin_rod(double mass, double length)
{
  iim::RevoluteLink<double> link;
  link.joint.axis = Vec3::UnitY();
  link.body.mass = mass;
  link.body.com = Vec3(0, 0, -length / 2);
  link.body.inertia.diagonal() << mass * length * length / 12, mass * length * length / 12, 0;
  return link;
}

struct Planar {
  bool floating = false;
  Index branching = 1;  ///< children per link
  double scale = 1;     ///< length of a link / length of its parent; masses go with the cube
};

/// n rods in one plane.
Parts planar(Index n, const Planar& shape)
{
  Parts parts;
  std::vector<double> length;
  for (Index i = 0; i < n; ++i) {
    iim::Attachment<double> on;
    const Index parent = i == 0 ? -1 : (i - 1) / shape.branching;
    length.push_back(parent < 0 ? 1.0 : shape.scale * length[static_cast<std::size_t>(parent)]);
    const double own = length.back();
    const iim::RevoluteLink<double> rod = thin_rod(own * own * own, own);
    if (parent >= 0) {
      on.parent = "link" + std::to_string(parent);
      on.p = Vec3(0, 0, -length[static_cast<std::size_t>(parent)]);
    } else if (shape.floating) {
      iim::FloatingBase<double> base;
      base.body = rod.body;
      base.body.inertia(2, 2) = 1.0 / 12;  // a base needs a moment about its own axis
      parts.add("link0", on, base);
      continue;
    }
    parts.add("link" + std::to_string(i), on, rod);
  }
  return parts;
}

double largest_eigenvalue(const Eigen::MatrixXd& A)
{
  return Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(A, Eigen::EigenvaluesOnly).eigenvalues().maxCoeff();
}

/// λ_max(M) λ_max(M⁻¹), M⁻¹ by the square-root form: both to a few roundings. angle(i): of joint i.
double condition_number(const Parts& parts, const std::function<double(Index)>& angle)
{
  const Tree<double> tree(parts);
  const iim::Inputs<Tree<double>> inputs(tree, iim::Start::empty);
  iim::Workspace<Tree<double>, iim::Update::square_root> workspace(tree);
  iim::RecursiveInverse<Tree<double>> inverse(tree, inputs);
  iim::EquationsOfMotion equations(tree, inputs);
  Eigen::VectorXd q = Eigen::VectorXd::Zero(tree.n_q());
  tree.outward([&]<class N, class S>(const N& node, const S&) {
    if constexpr (S::n_i == 6) {
      q(node.q + 6) = 1;
    } else {
      q(node.q) = angle(node.index);
    }
  });
  const auto fd = iim::forward_dynamics(q, Eigen::VectorXd::Zero(tree.n_v()), workspace);
  if (!inverse(fd).ok()) { return std::numeric_limits<double>::quiet_NaN(); }
  return largest_eigenvalue(equations(fd).M) * largest_eigenvalue(Eigen::MatrixXd(inverse.Minv()));
}

std::vector<Figure> featherstone(bool quick, Report& report)
{
  report.section("Known experiment: condition number of M (Featherstone 2004)");
  struct Series {
    std::string name;
    Planar shape;
    std::function<double(Index, Index)> angle;  // of joint i of n
    Look look;
  };
  const auto straight = [](Index, Index) { return 0.0; };
  const auto random = [](Index i, Index) {
    Random numbers(static_cast<std::uint64_t>(i) + 1);
    return std::numbers::pi * numbers();
  };
  const std::vector<Series> all{
      {"unbranched, straight", {}, straight, {"#0072B2", 7, 1, 2}},
      {"unbranched, random", {}, random, {"#56B4E9", 5, 1, 2}},
      {"unbranched, one full circle",
       {},
       [](Index i, Index n) { return i == 0 ? 0.0 : 2 * std::numbers::pi / static_cast<double>(n); },
       {"#E69F00", 9, 1, 2}},
      {"unbranched, folded", {}, [](Index i, Index) { return i == 0 ? 0.0 : std::numbers::pi; }, {"#D55E00", 11, 1, 2}},
      {"unbranched, floating, straight", {true}, straight, {"#009E73", 13, 1, 2}},
      {"two children per link, straight", {false, 2}, straight, {"#CC79A7", 4, 1, 2}},
      {"four children per link, straight", {false, 4}, straight, {"#9467BD", 6, 1, 2}},
      {"unbranched, each link 0.97 of the last", {false, 1, 0.97}, straight, {"#000000", 8, 2, 1.5}}};
  std::vector<Index> numbers{2, 4, 8, 16, 32, 64};
  if (!quick) { numbers.insert(numbers.end(), {128, 256}); }
  std::vector<std::string> head{"condition number of M"};
  for (const Index n : numbers) { head.push_back("N = " + std::to_string(n)); }
  head.push_back("growth");
  Table table(head);
  Figure figure{"accuracy_known_condition",
                "Condition number of M of planar mechanisms of N equal thin rods",
                "N",
                "condition number of M",
                true,
                true};
  const auto add = [&](const std::string& name, const Look& look, const std::function<double(Index)>& value,
                       bool straight_line) {
    std::vector<std::string> row{name};
    Curve curve{name, look, {}};
    for (const Index n : numbers) {
      const double x = value(n);
      row.push_back(text("%.3g", x));
      if (std::isfinite(x)) { curve.points.push_back({static_cast<double>(n), x}); }
    }
    // From the last three doublings.
    const std::size_t last = curve.points.size() - 1;
    const double growth = std::log2(curve.points[last].y / curve.points[last - 3].y) / 3;
    row.push_back(straight_line ? "N^4" : growth > 4.5 ? "faster" : "N^" + text("%.2f", growth));
    table.add(row);
    figure.curves.push_back(curve);
  };
  add(
      "Featherstone's bound, 4N⁴", {"#999999", 0, 3, 2},
      [](Index n) { return 4 * std::pow(static_cast<double>(n), 4); }, true);
  for (const Series& series : all) {
    add(
        series.name, series.look,
        [&](Index n) { return condition_number(planar(n, series.shape), [&](Index i) { return series.angle(i, n); }); },
        false);
  }
  report.paragraph(
      "His figure: the condition number grows as something between O(N) and O(N⁴), up to 4N⁴ on unbranched chains, and "
      "branching lowers it. Ours for planar mechanisms of N equal uniform thin rods: on the straight unbranched chain "
      "the largest eigenvalue of M tends to that of a clamped-free beam, m l² N⁴ / 1.8751⁴, the smallest to m l² / 48, "
      "together "
      "48 / 12.36 N⁴ = 3.88 N⁴. What could not be found out: the mass distribution of his links, his list of robots "
      "and which of "
      "them grow as O(N). The equal thin rods are our assumption; that their constant comes out at 3.88 says that it "
      "is a fair "
      "one. Links that shrink outward make M worse than any power of N.");
  report.table(table);
  report.image(figure.file + ".svg", figure.title);
  return {figure};
}

// --- formulation stiffness ------------------------------------------------------------------------------------------

/// Dormand and Prince's pair of orders 5 and 4.
struct StepCount {
  long accepted = 0;
  long rejected = 0;
  bool failed = false;
};

template <class Scalar, class Acceleration>
StepCount integrate(const State<double>& begin, double end, double tolerance, long limit, Acceleration&& acceleration)
{
  using Vector = iim::VectorX<Scalar>;
  static constexpr double a[7][6] = {{},
                                     {1.0 / 5},
                                     {3.0 / 40, 9.0 / 40},
                                     {44.0 / 45, -56.0 / 15, 32.0 / 9},
                                     {19372.0 / 6561, -25360.0 / 2187, 64448.0 / 6561, -212.0 / 729},
                                     {9017.0 / 3168, -355.0 / 33, 46732.0 / 5247, 49.0 / 176, -5103.0 / 18656},
                                     {35.0 / 384, 0, 500.0 / 1113, 125.0 / 192, -2187.0 / 6784, 11.0 / 84}};
  static constexpr double e[7] = {71.0 / 57600,      0,          -71.0 / 16695, 71.0 / 1920,
                                  -17253.0 / 339200, 22.0 / 525, -1.0 / 40};
  const Index n = begin.q.size();
  Vector y(2 * n);
  y << begin.q.cast<Scalar>(), begin.qd.cast<Scalar>();
  const auto f = [&](const Vector& x, Vector& rate) {
    rate.resize(2 * n);
    rate.head(n) = x.tail(n);
    return acceleration(x, rate);
  };
  std::array<Vector, 7> k;
  StepCount steps;
  double h = 1e-4;
  double t = 0;
  if (!f(y, k[0])) { return {0, 0, true}; }
  while (t < end) {
    if (steps.accepted + steps.rejected >= limit || h < 1e-12) {
      steps.failed = true;
      break;
    }
    h = std::min(h, end - t);
    Vector next;
    bool good = true;
    for (int s = 1; s < 7 && good; ++s) {
      next = y;
      for (int r = 0; r < s; ++r) { next += Scalar(h * a[s][r]) * k[static_cast<std::size_t>(r)]; }
      good = f(next, k[static_cast<std::size_t>(s)]);
    }
    double error = std::numeric_limits<double>::infinity();
    if (good) {
      Vector difference = Vector::Zero(2 * n);
      for (int s = 0; s < 7; ++s) { difference += Scalar(h * e[s]) * k[static_cast<std::size_t>(s)]; }
      error = 0;
      for (Index i = 0; i < 2 * n; ++i) {
        const double scaled =
            static_cast<double>(difference(i)) / (tolerance * (1 + std::abs(static_cast<double>(y(i)))));
        error += scaled * scaled / static_cast<double>(2 * n);
      }
      error = std::sqrt(error);
    }
    if (error <= 1) {
      t += h;
      y = next;
      k[0] = k[6];
      ++steps.accepted;
    } else {
      ++steps.rejected;
    }
    h *= std::clamp(0.9 * std::pow(std::max(error, 1e-10), -0.2), 0.2, 5.0);
  }
  return steps;
}

template <class Scalar>
void formulation_stiffness(const std::string& name, const Parts& parts, double tolerance, double end, long limit,
                           Table& table)
{
  using TreeType = Tree<Scalar>;
  const Tree<double> in_double(parts);
  const State<double> begin = random_states(in_double, 0, 1, 4711).front();
  const TreeType tree(parts.cast<Scalar>());
  const iim::Inputs<TreeType> inputs(tree, iim::Start::empty);
  const Index n = tree.n_v();
  const auto row = [&](const char* method, auto&& qdd0) {
    const StepCount steps = integrate<Scalar>(begin, end, tolerance, limit, qdd0);
    table.add({name, method, std::to_string(steps.accepted), std::to_string(steps.rejected),
               steps.failed ? "gives up" : "reaches the end"});
  };
  iim::GlobalInverse<TreeType> composites(tree, inputs);
  iim::Workspace<TreeType> kinematics(tree);
  row("composites, Cholesky", [&](const auto& x, auto& rate) {
    const auto result = composites(x.head(n), x.tail(n), kinematics);
    rate.tail(n) = result.qdd0;
    return result.ok();
  });
  const auto articulated = [&]<iim::Update update>(const char* method) {
    iim::Workspace<TreeType, update> workspace(tree);
    row(method, [&](const auto& x, auto& rate) {
      const auto fd = iim::forward_dynamics(x.head(n), x.tail(n), workspace);
      rate.tail(n) = fd.qdd0();
      return fd.ok();
    });
  };
  articulated.template operator()<iim::Update::printed>("articulated, printed");
  articulated.template operator()<iim::Update::projected>("articulated, projected");
  articulated.template operator()<iim::Update::square_root>("articulated, square root");
}

Parts chain_with_load(Index n, double load)
{
  Parts parts;
  for (Index i = 0; i < n; ++i) {
    iim::RevoluteLink<double> link = iim::models::link<double>();
    link.joint.axis = Vec3::Unit(i % 2);
    iim::Attachment<double> on;
    if (i > 0) {
      on.parent = "link" + std::to_string(i - 1);
      on.p.z() = -1;
    }
    if (i == n - 1) {
      link.body.mass *= load;
      link.body.inertia *= load;
    }
    parts.add("link" + std::to_string(i), on, link);
  }
  return parts;
}

void ascher_pai_cloutier(bool quick, Report& report)
{
  report.section("Known experiment: formulation stiffness (Ascher, Pai, Cloutier 1997)");
  report.paragraph(
      "Their statement: composites with Cholesky and articulated bodies are two eliminations of one linear system; on "
      "ill-conditioned mechanisms the former cancels, and an integrator with adaptive steps takes the noise in q̈ for "
      "stiffness and shortens its steps. Reproduced with Dormand and Prince's 5(4) pair, relative and absolute "
      "tolerance as "
      "given, chains of 1 m links under gravity with alternating axes, random state (seed 4711). What could not be "
      "found "
      "out: the parameters of their robots, their integrator's tolerances and their step counts; so the columns are "
      "ours "
      "alone, and only who wins can be compared: articulated bodies, as they say.");
  Table table({"mechanism, scalar, tolerance, time", "method", "steps", "rejected", "outcome"});
  const long limit = quick ? 20000 : 200000;
  formulation_stiffness<double>("chain of 20, double, 1e-10, 1 s", chain_with_load(20, 1), 1e-10, 1, limit, table);
  formulation_stiffness<double>("chain of 100, double, 1e-12, 0.05 s", chain_with_load(100, 1), 1e-12, 0.05, limit,
                                table);
  formulation_stiffness<double>("7 links, load 1e9, double, 1e-9, 0.01 s", chain_with_load(7, 1e9), 1e-9, 0.01, limit,
                                table);
  formulation_stiffness<double>("7 links, load 1e12, double, 1e-9, 0.001 s", chain_with_load(7, 1e12), 1e-9, 0.001,
                                limit, table);
  formulation_stiffness<float>("chain of 20, float, 1e-4, 0.5 s", chain_with_load(20, 1), 1e-4, 0.5, limit, table);
  formulation_stiffness<float>("chain of 50, float, 1e-4, 0.5 s", chain_with_load(50, 1), 1e-4, 0.5, limit, table);
  formulation_stiffness<float>("chain of 100, float, 1e-4, 0.5 s", chain_with_load(100, 1), 1e-4, 0.5, limit, table);
  formulation_stiffness<float>("7 links, load 1e4, float, 1e-4, 0.1 s", chain_with_load(7, 1e4), 1e-4, 0.1, limit,
                               table);
  report.table(table);
}

}  // namespace

std::vector<Figure> known_experiments(bool quick, Report& report)
{
  const std::vector<Figure> figures = featherstone(quick, report);
  ascher_pai_cloutier(quick, report);
  return figures;
}

}  // namespace bench
