// OPTIONAL: openmp
// A sampling controller (MPPI) turns a seven-axis arm to a target: in each cycle it tries hundreds of random courses over
// a horizon, several states at once in the lanes of a core and, with OpenMP, on all cores; the mean of the courses,
// weighted by how well they went, is the new plan.
#include <iim/iim.hpp>
#include <iim/several_states.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <functional>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <vector>

#ifdef _OPENMP
#include <omp.h>
#endif

namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using iim::Index;

iim::StandardAssembly<double> seven_axis_arm()
{
  const double lengths[7] = {0.34, 0.2, 0.2, 0.2, 0.2, 0.1, 0.1};
  iim::StandardAssembly<double> arm;
  iim::Attachment<double> on;
  for (int k = 0; k < 7; ++k) {
    const double mass = 4.0 - 0.5 * k;
    iim::RevoluteLink<double> link;
    link.joint.axis = k % 2 == 0 ? Eigen::Vector3d::UnitZ() : Eigen::Vector3d::UnitY();
    link.body.mass = mass;
    link.body.com = {0.01, 0, lengths[k] / 2};
    link.body.inertia.diagonal() << 0.02 * mass, 0.02 * mass, 0.005 * mass;
    const std::string name = "axis" + std::to_string(k + 1);
    arm.add(name, on, link);
    on.parent = name;
    on.p.z() = lengths[k];
  }
  return arm;
}

using Tree = decltype(iim::DynamicTree(seven_axis_arm()));
using Several = iim::SeveralStates<Tree>;

constexpr Index n = 7;
constexpr Index samples = 512;
constexpr Index horizon = 12;
constexpr double step = 0.02;  // [s]
constexpr double spread = 6;     // of the accelerations that are tried [rad/s²]

/// Something of every sample over the horizon: at time step t the columns of courses[t], n × samples.
using Courses = std::vector<MatrixXd>;

/// Explicit in the velocities, implicit in the coordinates.
template <class Q, class V, class A>
void integrate(Q&& q, V&& qd, const A& qdd)
{
  qd += step * qdd;
  q += step * qd;
}

template <class Q, class V>
VectorXd cost(const Q& q, const V& qd, const VectorXd& target)
{
  return 20 * (q.colwise() - target).colwise().squaredNorm().transpose() + qd.colwise().squaredNorm().transpose();
}

/// Courses that lead to a state without a result have no weight. (Their states are NaN from then on, and fail again.)
void exclude(const std::vector<iim::Outcome>& outcomes, Eigen::Ref<VectorXd> costs)
{
  for (std::size_t k = 0; k < outcomes.size(); ++k) {
    if (!outcomes[k].ok()) { costs(static_cast<Index>(k)) = std::numeric_limits<double>::infinity(); }
  }
}

/// One core's share of the roll-outs: samples first … first + count. Adds their costs.
void roll_out(Several& several, const Courses& courses, const VectorXd& q0, const VectorXd& qd0, const VectorXd& target,
              Index first, Index count, VectorXd& costs)
{
  MatrixXd q = q0.replicate(1, count), qd = qd0.replicate(1, count), qdd(n, count);
  std::vector<iim::Outcome> outcomes(static_cast<std::size_t>(count));
  for (const MatrixXd& u : courses) {
    const Index failed = several.accelerations(q, qd, u.middleCols(first, count), qdd, outcomes);
    integrate(q, qd, qdd);
    costs.segment(first, count) += cost(q, qd, target);
    if (failed > 0) { exclude(outcomes, costs.segment(first, count)); }
  }
}

/// All roll-outs, on as many cores as there are objects.
void roll_out_on_cores(std::vector<std::unique_ptr<Several>>& cores, const Courses& courses, const VectorXd& q,
                       const VectorXd& qd, const VectorXd& target, VectorXd& costs)
{
  const int parts = static_cast<int>(cores.size());
#ifdef _OPENMP
#pragma omp parallel for schedule(static, 1) num_threads(parts)
#endif
  for (int part = 0; part < parts; ++part) {
    const Index first = samples * part / parts;
    const Index count = samples * (part + 1) / parts - first;
    roll_out(*cores[static_cast<std::size_t>(part)], courses, q, qd, target, first, count, costs);
  }
}

/// The same one state at a time: what the others are measured against.
void roll_out_one_by_one(iim::Workspace<Tree>& ws, const iim::Inputs<Tree>& inputs, const Courses& courses,
                         const VectorXd& q0, const VectorXd& qd0, const VectorXd& target, VectorXd& costs)
{
  for (Index k = 0; k < samples; ++k) {
    VectorXd q = q0, qd = qd0;
    for (const MatrixXd& u : courses) {
      integrate(q, qd, iim::forward_dynamics(q, qd, inputs, u.col(k), ws).qdd);
      costs(k) += cost(q, qd, target)(0);
    }
  }
}

double states_per_second(const std::function<void()>& roll_outs)
{
  double best = 0;
  const auto end = std::chrono::steady_clock::now() + std::chrono::milliseconds(200);
  while (std::chrono::steady_clock::now() < end) {
    const auto start = std::chrono::steady_clock::now();
    roll_outs();
    const std::chrono::duration<double> time = std::chrono::steady_clock::now() - start;
    best = std::max(best, static_cast<double>(samples * horizon) / time.count());
  }
  return best;
}

}  // namespace

int main()
{
  const iim::StandardAssembly<double> assembly = seven_axis_arm();
  const Tree tree(assembly);
  const iim::Inputs inputs(tree);
  iim::Workspace ws(tree);
  iim::ImplicitInversion method(tree, inputs);

  std::vector<std::unique_ptr<Several>> one_core, all_cores;
  int cores = 1;
#ifdef _OPENMP
  cores = omp_get_max_threads();
#endif
  one_core.push_back(std::make_unique<Several>(assembly, inputs));
  for (int k = 0; k < cores; ++k) { all_cores.push_back(std::make_unique<Several>(assembly, inputs)); }

  VectorXd q = VectorXd::Zero(n), qd = VectorXd::Zero(n), target(n), costs(samples);
  target << 0.8, 0.6, -0.5, -0.9, 0.4, 0.7, 0.3;
  MatrixXd plan = MatrixXd::Zero(n, horizon);
  Courses accelerations(horizon, MatrixXd(n, samples)), torques = accelerations;
  std::mt19937_64 bits(1);
  std::normal_distribution<double> normal;

  const double start = (q - target).norm();
  for (int cycle = 0; cycle < 125; ++cycle) {
    // Where the arm is now, u = B̂⁻¹ (q̈ − q̈₀): what is tried are accelerations, in reach of every axis alike.
    const auto dynamics = method(q, qd, ws);
    if (!dynamics.ok()) { return 1; }
    const Eigen::PartialPivLU<MatrixXd> Bhat(dynamics.Bhat);
    const VectorXd qdd0 = dynamics.qdd0;

    const double size = spread * std::min(1.0, (q - target).norm() + 0.1);  // finer as the target comes near
    MatrixXd deviation = MatrixXd::Zero(n, samples);
    for (std::size_t t = 0; t < accelerations.size(); ++t) {
      deviation = 0.8 * deviation + 0.6 * size * MatrixXd::NullaryExpr(n, samples, [&] { return normal(bits); });
      deviation.col(0).setZero();  // the plan itself
      accelerations[t] = deviation.colwise() + plan.col(static_cast<Index>(t));
      torques[t] = Bhat.solve(accelerations[t].colwise() - qdd0);
    }
    costs.setZero();
    roll_out_on_cores(all_cores, torques, q, qd, target, costs);
    VectorXd weight = (-(costs.array() - costs.minCoeff()) / (0.02 * costs.minCoeff() + 1e-6)).exp();
    weight /= weight.sum();
    for (std::size_t t = 0; t < accelerations.size(); ++t) { plan.col(static_cast<Index>(t)) = accelerations[t] * weight; }

    const VectorXd u = Bhat.solve(plan.col(0) - qdd0);
    integrate(q, qd, iim::forward_dynamics(q, qd, inputs, u, ws).qdd);
    plan.leftCols(horizon - 1) = plan.rightCols(horizon - 1).eval();
    if (cycle % 25 == 24) { std::printf("%.1f s: %.3f rad from the target\n", (cycle + 1) * step, (q - target).norm()); }
  }

  const double left = (q - target).norm();
  const double alone = states_per_second([&] { roll_out_one_by_one(ws, inputs, torques, q, qd, target, costs); });
  const double lanes = states_per_second([&] { roll_out_on_cores(one_core, torques, q, qd, target, costs); });
  const double together = states_per_second([&] { roll_out_on_cores(all_cores, torques, q, qd, target, costs); });
  std::printf("roll-outs, million states per second: one at a time %.2f, %d lanes %.2f, %d lanes × %d cores %.2f\n",
              alone * 1e-6, Several::lanes, lanes * 1e-6, Several::lanes, cores, together * 1e-6);
  
  std::printf("%s: %.3f of %.3f rad left\n", left < 0.1 * start ? "reached" : "not reached", left, start);
  return left < 0.1 * start ? 0 : 1;
}
