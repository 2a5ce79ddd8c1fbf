// PART OF: iim_accuracy
// Energy and momentum of free mechanisms over many steps of the classical Runge–Kutta method.
#include "../common/table.hpp"
#include "report.hpp"
#include "runge_kutta.hpp"

#include <iim/equations_of_motion.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>

namespace bench {

namespace {

using Parts = iim::StandardAssembly<double>;
using Vec3 = iim::Vector3<double>;

/// Floating link with `n` further links in a row behind it, axes alternating, the last one `load` times as heavy.
Parts free_chain(Index n, double load)
{
  Parts parts;
  const iim::RevoluteLink<double> link = iim::models::link<double>();
  iim::FloatingBase<double> base;
  base.body = link.body;
  parts.add("link0", {}, base);
  for (Index i = 1; i <= n; ++i) {
    iim::RevoluteLink<double> next = link;
    next.joint.axis = Vec3::Unit(i % 2);
    if (i == n) {
      next.body.mass *= load;
      next.body.inertia *= load;
    }
    iim::Attachment<double> on;
    on.parent = "link" + std::to_string(i - 1);
    on.p.z() = -1;
    parts.add("link" + std::to_string(i), on, next);
  }
  return parts;
}

/// Kinetic energy, and momentum and moment of momentum about the world's origin, of a floating mechanism: ½ q̇ᵀM q̇ and
/// the base's rows of M q̇. In long double whatever the scalar of the run.
struct Conserved {
  long double energy;
  Eigen::Matrix<long double, 3, 1> momentum, angular;
};

class Balance {
public:
  explicit Balance(const Parts& parts)
      : tree_(parts.cast<long double>()), inputs_(tree_, iim::Start::empty), workspace_(tree_),
        equations_(tree_, inputs_)
  {
  }
  Balance(const Balance&) = delete;
  Balance& operator=(const Balance&) = delete;

  Conserved operator()(const State<long double>& x)
  {
    const iim::VectorX<long double> p = equations_(x.q, x.qd, workspace_).M * x.qd;
    const iim::Matrix3<long double>& R = workspace_.frame(0).R;
    Conserved c;
    c.energy = p.dot(x.qd) / 2;
    c.momentum = R * p.head<3>();
    const Eigen::Matrix<long double, 3, 1> at = x.q.head<3>();
    c.angular = R * p.segment<3>(3) + at.cross(c.momentum);
    return c;
  }

private:
  const Tree<long double> tree_;
  iim::Inputs<Tree<long double>> inputs_;
  iim::Workspace<Tree<long double>, iim::Update::square_root> workspace_;
  iim::EquationsOfMotion<Tree<long double>> equations_;
};

/// Kahan's sum: the state itself keeps its digits when small steps are added, so that what drifts is the dynamics.
template <class Scalar>
struct Compensated {
  iim::VectorX<Scalar> value, lost;

  explicit Compensated(const iim::VectorX<Scalar>& begin) : value(begin), lost(iim::VectorX<Scalar>::Zero(begin.size()))
  {
  }

  void add(const iim::VectorX<Scalar>& step)
  {
    for (Index i = 0; i < value.size(); ++i) {
      const Scalar exact_step = step(i) - lost(i);
      const volatile Scalar sum = value(i) + exact_step;
      const volatile Scalar added = sum - value(i);
      lost(i) = added - exact_step;
      value(i) = sum;
    }
  }
};

struct Drift {
  std::string status{"ok"};
  double energy = 0;    ///< largest relative change
  double momentum = 0;  ///< relative to Σ|p| at the beginning
  double angular = 0;
  double at_end = 0;  ///< of the energy
  double seconds = 0;
  std::vector<Point> energy_over_time;
  std::vector<Point> momentum_over_time;  ///< moment of momentum
};

template <class Scalar, iim::Update update>
Drift run(const Parts& parts, const State<double>& begin, double h, long steps)
{
  using TreeType = Tree<Scalar>;
  using Vector = iim::VectorX<Scalar>;
  const TreeType tree(parts.cast<Scalar>());
  RungeKutta<TreeType, update> method(tree);
  const Index n_q = tree.n_q();
  const Index n_v = tree.n_v();
  Vector first(n_q + n_v);
  first << begin.q.cast<Scalar>(), begin.qd.cast<Scalar>();
  first.template segment<4>(3).normalize();  // the base's quaternion, to the scalar's digits
  Compensated<Scalar> y(first);
  Balance balance(parts);
  const auto conserved = [&] {
    return balance(
        {y.value.head(n_q).template cast<long double>(), y.value.tail(n_v).template cast<long double>(), {}});
  };
  const Conserved initial = conserved();
  const long double p0 = std::max<long double>(initial.momentum.norm(), std::sqrt(2 * initial.energy));
  const long double L0 = std::max<long double>(initial.angular.norm(), std::sqrt(2 * initial.energy));
  Drift drift;
  const Scalar step(h);
  const auto start = std::chrono::steady_clock::now();
  double measuring = 0;
  for (long s = 1; s <= steps; ++s) {
    if (!method(y.value, step)) {
      drift.status = "status at step " + std::to_string(s);
      break;
    }
    y.add(method.step());
    if (s % std::max(1L, steps / 100) == 0) {
      const auto pause = std::chrono::steady_clock::now();
      const Conserved now = conserved();
      drift.at_end = static_cast<double>((now.energy - initial.energy) / initial.energy);
      drift.energy = std::max(drift.energy, std::abs(drift.at_end));
      drift.momentum = std::max(drift.momentum, static_cast<double>((now.momentum - initial.momentum).norm() / p0));
      const auto angular = static_cast<double>((now.angular - initial.angular).norm() / L0);
      drift.angular = std::max(drift.angular, angular);
      drift.momentum_over_time.push_back({static_cast<double>(s) * h, std::max(angular, 1e-18)});
      drift.energy_over_time.push_back({static_cast<double>(s) * h, std::max(std::abs(drift.at_end), 1e-18)});
      measuring += std::chrono::duration<double>(std::chrono::steady_clock::now() - pause).count();
    }
  }
  drift.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count() - measuring;
  return drift;
}

struct Run {
  std::string name;
  Parts parts;
  double h;
};

template <class Scalar>
void run_tiers(const Run& scene, long steps, const char* scalar, Table& table, Figure& energy, Figure& momentum)
{
  const Tree<double> tree(scene.parts);
  State<double> begin = random_states(tree, 0, 1, 4711).front();
  begin.qd /= 4;
  const auto row = [&](const char* tier, const Drift& drift, const Look& look) {
    if (drift.energy_over_time.empty()) {
      table.add({scene.name, scalar, tier, "–", "–", "–", "–", "–", drift.status});
      return;
    }
    table.add({scene.name, scalar, tier, magnitude(drift.energy), text("%+.1e", drift.at_end),
               magnitude(drift.momentum), magnitude(drift.angular), text("%.1f", drift.seconds), drift.status});
    energy.curves.push_back({std::string(tier) + ", " + scalar, look, drift.energy_over_time});
    momentum.curves.push_back({std::string(tier) + ", " + scalar, look, drift.momentum_over_time});
  };
  const int dash = std::string(scalar) == "float" ? 2 : 1;
  row("printed", run<Scalar, iim::Update::printed>(scene.parts, begin, scene.h, steps), {"#E69F00", 0, dash, 2});
  row("projected", run<Scalar, iim::Update::projected>(scene.parts, begin, scene.h, steps), {"#0072B2", 0, dash, 2});
  row("square root", run<Scalar, iim::Update::square_root>(scene.parts, begin, scene.h, steps),
      {"#009E73", 0, dash, 2});
}

}  // namespace

std::vector<Figure> long_runs(bool quick, Report& report)
{
  const long steps = quick ? 20000 : 1000000;
  report.section("Long runs: " + std::to_string(steps) + " steps");
  report.paragraph(
      "Free mechanisms without gravity and inputs, random state (seed 4711), classical Runge–Kutta of order 4 with "
      "fixed steps "
      "so short that its own error stays near the roundings of double, the state summed with compensation. Largest "
      "change of "
      "the kinetic energy and of the two momenta about the world's origin, relative to themselves at the beginning (or "
      "to "
      "√(2 E), where that is larger); they are measured in long double. A run that ends by a status ends there.");
  Table table({"mechanism", "scalar", "tier", "energy", "energy at the end", "momentum", "moment of momentum",
               "time [s]", "status"});
  std::vector<Figure> figures;
  std::vector<Run> scenes;
  scenes.push_back({"free chain of 5, h = 0.1 ms", free_chain(4, 1), 1e-4});
  scenes.push_back({"free chain of 5, last link 1e6 times heavier, h = 0.1 ms", free_chain(4, 1e6), 1e-4});
  scenes.push_back({"floating biped, h = 0.1 ms", iim::models::biped<double>(), 1e-4});
  for (Run& scene : scenes) { scene.parts.set_gravity(Vec3::Zero()); }
  const char* files[] = {"accuracy_run_chain", "accuracy_run_loaded_chain", "accuracy_run_biped"};
  for (std::size_t k = 0; k < scenes.size(); ++k) {
    Figure figure{files[k], "Energy over time: " + scenes[k].name, "time [s]", "relative change of energy", false,
                  true};
    Figure momentum{std::string(files[k]) + "_momentum",
                    "Moment of momentum over time: " + scenes[k].name,
                    "time [s]",
                    "relative change of the moment of momentum",
                    false,
                    true};
    run_tiers<double>(scenes[k], steps, "double", table, figure, momentum);
    run_tiers<float>(scenes[k], steps, "float", table, figure, momentum);
    figures.push_back(figure);
    figures.push_back(momentum);
  }
  report.table(table);
  for (const Figure& figure : figures) { report.image(figure.file + ".svg", figure.title); }
  return figures;
}

}  // namespace bench
