// PART OF: iim_accuracy
// Stiff machines over seconds: the linearly implicit step against the explicit one and a reference of small steps.
#include "../common/table.hpp"
#include "report.hpp"
#include "runge_kutta.hpp"

#include <iim/law_suite/observer.hpp>
#include <iim/subsystem/elastic_motor_arm.hpp>
#include <iim/subsystem/sprung.hpp>

#include <algorithm>
#include <cmath>
#include <string>
#include <type_traits>
#include <vector>

namespace bench {

namespace {

using Vector = Eigen::VectorXd;
using Vec3 = Eigen::Vector3d;
using Drive = iim::ElasticMotorArm<double>;
using Rigid = iim::MotorArm<double>;
using Link = iim::Sprung<iim::RevoluteLink<double>>;
using Parts = iim::Assembly<Drive, Rigid, Link>;  // one type for all machines: everything is compiled once
using Machine = Parts::Tree;

/// Thin rods [kg, m] in a row, which hang in a plane; each on a joint as `link` has it.
template <class Part>
Parts row(const std::vector<double>& masses, double length, Part link)
{
  Parts parts;
  iim::Attachment<double> on;
  int k = 0;
  for (const double mass : masses) {
    link.joint.axis = Vec3::UnitY();
    link.body.mass = mass;
    link.body.com = Vec3(length / 2, 0, 0);
    link.body.inertia = Vec3(1e-3 * mass, mass * length * length / 12, mass * length * length / 12).asDiagonal();
    const std::string name = "link" + std::to_string(k++);
    parts.add(name, on, link);
    on.parent = name;
    on.p.x() = length;
  }
  return parts;
}

template <class Part>
Parts arm(Part drive)
{
  drive.motor.gear_ratio = 100;
  drive.motor.axial_inertia = 1e-5;
  drive.motor.axis = Vec3::UnitY();
  return row({3, 2, 1}, 0.4, drive);
}

Parts elastic_arm(double stiffness)
{
  Drive drive;
  drive.stiffness = stiffness;
  return arm(drive);
}

Parts damped_chain()
{
  Link link;
  link.stiffness(0) = 200;
  link.damping(0) = 2;
  link.rest(0) = 0.02;
  return row(std::vector<double>(8, 0.2), 0.1, link);
}

/// (q, q̇) at rest: the given angle of all joints, no torque in the drives' springs.
Vector at_rest(const Machine& tree, double angle)
{
  Vector y = Vector::Zero(tree.n_q() + tree.n_v());
  tree.outward([&]<class N, class S>(const N& node, const S& part) {
    y.segment<S::n_q>(node.q).setConstant(angle);
    if constexpr (std::is_same_v<S, Drive>) { y(node.q) *= part.motor.gear_ratio; }
  });
  return y;
}

Vector joint_angles(const Machine& tree, const Vector& y)
{
  Vector angles(tree.size());
  tree.outward([&]<class N, class S>(const N& node, const S&) { angles(node.index) = y(node.q + S::n_q - 1); });
  return angles;
}

/// Kinetic energy, weight and springs [J].
double energy(const Machine& tree, const Vector& y)
{
  const auto seen = iim::detail::observe(tree, y.head(tree.n_q()), y.tail(tree.n_v()));
  double energy = seen.kinetic + seen.potential;
  tree.outward([&]<class N, class S>(const N& node, const S& part) {
    if constexpr (requires { part.potential(y.segment<S::n_q>(node.q)); }) {
      energy += part.potential(y.segment<S::n_q>(node.q));
    }
  });
  return energy;
}

struct Course {
  bool stands = true;  ///< the velocities' norm stayed below 10⁶
  long steps = 0;
  std::vector<Point> energy;  ///< [J] every millisecond
  Vector angles;              ///< of the joints at the time that is compared
};

/// One machine from one state by several methods.
class Experiment {
public:
  Experiment(const Parts& parts, double angle, double duration, double compared_at)
      : tree_(parts), start_(at_rest(tree_, angle)), duration_(duration), compared_at_(compared_at)
  {
  }
  Experiment(const Experiment&) = delete;
  Experiment& operator=(const Experiment&) = delete;

  template <iim::Update update>
  Course implicit_steps(double h) const
  {
    const iim::Inputs<Machine> inputs(tree_);
    iim::Workspace<Machine, update> workspace(tree_);
    iim::ImplicitInversion<Machine> method(tree_, inputs);
    return integrate(h, [&](Vector& y) {
      const auto dynamics = method(iim::implicit_step(y.head(tree_.n_q()), y.tail(tree_.n_v()), h, workspace));
      return euler(dynamics.qdd0, h, y) && dynamics.ok();
    });
  }

  /// All forces as they are at the beginning of the step.
  Course explicit_steps(double h) const
  {
    iim::Workspace<Machine> workspace(tree_);
    return integrate(h, [&](Vector& y) {
      const auto fd = iim::forward_dynamics(y.head(tree_.n_q()), y.tail(tree_.n_v()), workspace);
      return euler(fd.qdd0(), h, y) && fd.ok();
    });
  }

  Course runge_kutta(double h) const
  {
    RungeKutta<Machine> method(tree_);
    return integrate(h, [&](Vector& y) {
      const bool ok = method(y, h);
      y += method.step();
      return ok;
    });
  }

private:
  /// q̇⁺ = q̇ + h q̈,  q⁺ = q + h q̇⁺; whether the velocities are within reason.
  bool euler(const Eigen::Ref<const Vector>& qdd, double h, Vector& y) const
  {
    y.tail(tree_.n_v()) += h * qdd;
    y.head(tree_.n_q()) += h * y.tail(tree_.n_v());
    return y.tail(tree_.n_v()).norm() < 1e6;
  }

  template <class Advance>
  Course integrate(double h, Advance&& advance) const
  {
    Vector y = start_;
    Course course{true, 0, {{0, energy(tree_, y)}}, {}};
    while (course.stands && course.steps < std::lround(duration_ / h)) {
      course.stands = advance(y);
      ++course.steps;
      if (course.steps % std::lround(1e-3 / h) == 0) {
        course.energy.push_back({static_cast<double>(course.steps) * h, energy(tree_, y)});
      }
      if (course.steps == std::lround(compared_at_ / h)) { course.angles = joint_angles(tree_, y); }
    }
    return course;
  }

  const Machine tree_;
  const Vector start_;
  double duration_, compared_at_;
};

/// Over the logarithm of time: the first milliseconds, later every tenth.
Curve energy_curve(const std::string& title, const Look& look, const Course& course)
{
  Curve curve{title, look, {}};
  for (std::size_t k = 1; k < course.energy.size(); ++k) {
    if (k < 20 || k % 10 == 0) {
      curve.points.push_back({course.energy[k].x, course.energy[k].y - course.energy[0].y});
    }
  }
  return curve;
}

/// Rows of one machine; with a figure, curves of its explicit and its projected implicit steps.
void run_stiff(const std::string& name, const Experiment& experiment, const Course& reference, Table& table,
               Figure* figure = nullptr)
{
  const auto rows = [&](const std::string& form, const std::vector<double>& steps, auto&& run,
                        const std::vector<Look>& looks) {
    double coarser = 0;
    for (std::size_t k = 0; k < steps.size(); ++k) {
      const Course course = run(steps[k]);
      const std::string step = text("%g ms", 1e3 * steps[k]);
      if (figure && k < looks.size()) {
        figure->curves.push_back(energy_curve((form + ", ").append(step), looks[k], course));
      }
      if (!course.stands) {
        table.add({name, form, step, std::to_string(course.steps), "blows up", "–", "–", "–"});
        continue;
      }
      double off = 0, most = 0;
      for (std::size_t i = 0; i < course.energy.size(); ++i) {
        off = course.energy[i].y - reference.energy[i].y;
        most = std::max(most, std::abs(off));
      }
      const double error = (course.angles - reference.angles).norm();
      table.add({name, form, step, std::to_string(course.steps), text("%.2e", most), text("%+.2e", off),
                 text("%.2e", error), coarser > 0 ? text("%.3f", coarser / error) : "–"});
      coarser = error;
    }
  };
  if (figure) { figure->curves.push_back(energy_curve("reference", {"#000000", 0, 1, 2}, reference)); }
  rows("explicit", {1e-3}, [&](double h) { return experiment.explicit_steps(h); }, {{"#D55E00", 7}});
  const std::vector<double> steps{1e-3, 5e-4, 2.5e-4};
  rows("implicit, projected", steps, [&](double h) { return experiment.implicit_steps<iim::Update::projected>(h); },
       {{"#0072B2", 0, 1, 2}, {"#009E73", 0, 1, 2}, {"#56B4E9", 0, 1, 2}});
  rows("implicit, square root", steps, [&](double h) { return experiment.implicit_steps<iim::Update::square_root>(h); },
       {});
}

}  // namespace

std::vector<Figure> stiff_scenes(bool quick, Report& report)
{
  const double duration = quick ? 1 : 10;
  report.section("Stiff scenes");
  report.paragraph(
      "An arm of three links of 0.4 m on elastic drives (gear 100) without dampers, all joints at 1.2 rad, 6.6 J above "
      "hanging at rest; and a chain of eight links of 0.1 m with springs of 200 N m/rad and dampers of 2 N m s/rad, "
      "all joints at 0.1 rad, 3.8 J above its rest. Both begin at rest and move under gravity for " +
      text("%g s. ", duration) +
      "«Implicit» is the linearly implicit Euler step, q̈₀ by implicit inversion on the receipt of implicit_step; "
      "«explicit» is the same step with all forces as they are at its beginning, and blows up when the norm of q̇ "
      "exceeds 10⁶ or is not finite. The reference is Runge and Kutta's method of order 4: for the arm of 10⁹ N m/rad "
      "on the same arm with rigid drives, in steps of 1 ms; for the others on the very same machine, in steps of "
      "0.02 ms (with half of these steps joints are elsewhere by less than 10⁻⁹ rad). Energy is kinetic, of weight and "
      "of springs, less that of the reference at the same time (the arms' is constant): the largest difference at all "
      "milliseconds, and that at the end. The error is the norm of the difference of the joints' angles at 1 s (arms) "
      "and 0.2 s (chain), the ratio that of the error at twice the step to this one: 2 for a method of first order.");
  const Experiment stiff(elastic_arm(1e9), 1.2, duration, 1);
  const Experiment rigid(arm(Rigid()), 1.2, duration, 1);
  const Experiment softer(elastic_arm(1e5), 1.2, duration, 1);
  const Experiment chain(damped_chain(), 0.1, duration, 0.2);
  Figure figure{"accuracy_stiff_energy", "Energy over time: arm on elastic drives of 10⁵ N m/rad", "time [s]",
                "change of energy [J]", true};
  figure.y_min = -0.15;
  figure.y_max = 0.15;
  Table table({"machine", "method", "step", "steps", "energy off by [J]", "at the end [J]", "error [rad]", "ratio"});
  run_stiff("arm, 10⁹ N m/rad", stiff, rigid.runge_kutta(1e-3), table);
  run_stiff("arm, 10⁵ N m/rad", softer, softer.runge_kutta(2e-5), table, &figure);
  run_stiff("damped chain", chain, chain.runge_kutta(2e-5), table);
  report.table(table);
  report.image(figure.file + ".svg", figure.title);
  return {figure};
}

}  // namespace bench
