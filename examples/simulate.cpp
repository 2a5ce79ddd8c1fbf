// A body with two three-link arms tumbles in free fall: Runge–Kutta of fourth order on q̈₀, and how well energy and
// momentum are kept. The errors fall with the fourth power of the step until rounding is all that is left.
#include <iim/iim.hpp>
#include <iim/models.hpp>
#include <iim/task.hpp>

#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <string>
#include <vector>

namespace {

using Vec3 = iim::Vector3<double>;
using Vector = Eigen::VectorXd;

iim::StandardAssembly<double> tumbler()
{
  iim::StandardAssembly<double> robot;
  iim::FloatingBase<double> torso;
  torso.body.mass = 5;
  torso.body.inertia.diagonal() << 0.3, 0.2, 0.1;
  robot.add("torso", {}, torso);
  for (const double side : {1.0, -1.0}) {
    std::string parent = "torso";
    Vec3 at(0.0, 0.3 * side, 0.2);
    for (int k = 0; k < 3; ++k) {
      iim::RevoluteLink<double> link = iim::models::link<double>();
      if (k == 1) { link.joint.axis = Vec3::UnitX(); }
      const std::string name = (side > 0 ? "left" : "right") + std::to_string(k);
      robot.add(name, {parent, iim::Matrix3<double>::Identity(), at}, link);
      parent = name;
      at = -Vec3::UnitZ();
    }
  }
  return robot;
}

struct State {
  Vector q, qd;
};

/// Everything that a simulation of a tree needs, with the memory of its workspace.
template <class Tree>
class Simulation {
public:
  explicit Simulation(const Tree& tree) : tree_(&tree), inputs_(tree), tasks_(tree, inputs_), ws_(tree)
  {
    momentum_ = tasks_.add_momentum();
    for (iim::Index i = 0; i < tree.size(); ++i) {
      body_.push_back(tasks_.add_frame(tree.name(i), tree.frame_mass(tree.node(i).frame).com));
    }
  }
  Simulation(const Simulation&) = delete;  // tasks_ refers to inputs_
  Simulation& operator=(const Simulation&) = delete;

  /// d(q, q̇)/dt.
  State rate(const State& x)
  {
    const auto fd = iim::forward_dynamics(x.q, x.qd, ws_);
    if (!fd.ok()) { throw std::runtime_error(describe(fd, *tree_)); }
    State rate{x.q, fd.qdd0()};
    iim::coordinate_rate(*tree_, x.q, x.qd, rate.q);
    return rate;
  }

  State step(const State& x, double h)
  {
    const State a = rate(x);
    const State b = rate({x.q + h / 2 * a.q, x.qd + h / 2 * a.qd});
    const State c = rate({x.q + h / 2 * b.q, x.qd + h / 2 * b.qd});
    const State d = rate({x.q + h * c.q, x.qd + h * c.qd});
    State next{x.q + h / 6 * (a.q + 2 * b.q + 2 * c.q + d.q), x.qd + h / 6 * (a.qd + 2 * b.qd + 2 * c.qd + d.qd)};
    iim::normalize(*tree_, next.q);
    return next;
  }

  /// Kinetic and potential energy, body by body.
  double energy(const State& x)
  {
    const auto rows = tasks_(iim::forward_dynamics(x.q, x.qd, ws_));
    const Vector V = rows.J * x.qd;
    double energy = 0;
    for (iim::Index i = 0; i < tree_->size(); ++i) {
      const auto id = body_[static_cast<std::size_t>(i)];
      const auto& body = tree_->frame_mass(tree_->node(i).frame);
      const auto& at = tasks_.placement(id);
      const Vec3 v = V.template segment<3>(tasks_.row(id)), w = at.R.transpose() * V.template segment<3>(tasks_.row(id) + 3);
      energy += body.mass * v.squaredNorm() / 2 + w.dot(body.central_inertia * w) / 2 - body.mass * tree_->gravity().dot(at.p);
    }
    return energy;
  }

  /// Linear momentum, and angular momentum about the centre of mass.
  iim::Vector6<double> momentum(const State& x)
  {
    const auto rows = tasks_(iim::forward_dynamics(x.q, x.qd, ws_));
    return rows.J.template middleRows<6>(tasks_.row(momentum_)) * x.qd;
  }

  double mass() const { return tasks_.mass(); }

private:
  const Tree* tree_;
  iim::Inputs<Tree> inputs_;
  iim::Tasks<Tree> tasks_;
  iim::Workspace<Tree> ws_;
  iim::Index momentum_;
  std::vector<iim::Index> body_;
};

}  // namespace

int main()
{
  const iim::DynamicTree tree(tumbler());
  Simulation simulation(tree);
  State start{Vector::Zero(tree.n_q()), Vector::Zero(tree.n_v())};
  start.q(6) = 1;
  start.q.tail<6>() << 0.5, 0.3, -0.4, -0.7, 0.2, 0.9;
  start.qd << 0.5, 0.0, 3.0, 1.0, -2.0, 1.5, 2.0, -1.0, 1.0, -2.0, 1.5, 0.5;

  const double duration = 2;
  const double energy = simulation.energy(start);
  const iim::Vector6<double> momentum = simulation.momentum(start);
  iim::Vector6<double> expected = momentum;
  expected.head<3>() += duration * simulation.mass() * tree.gravity();

  std::printf("energy %.6f J, angular momentum %.6f kg m²/s, %.0f s of flight\n\n%10s %16s %16s %16s\n", energy,
              momentum.tail<3>().norm(), duration, "step [s]", "energy", "momentum", "angular momentum");
  std::vector<double> drifts;
  for (const int steps : {250, 500, 1000, 2000}) {
    State x = start;
    for (int k = 0; k < steps; ++k) { x = simulation.step(x, duration / steps); }
    const iim::Vector6<double> off = simulation.momentum(x) - expected;
    const double drift = std::abs(simulation.energy(x) - energy) / std::abs(energy);
    const double angular = off.tail<3>().norm() / momentum.tail<3>().norm();
    std::printf("%10.4f %16.2e %16.2e %16.2e\n", duration / steps, drift, off.head<3>().norm() / expected.head<3>().norm(), angular);
    drifts.push_back(drift + angular);
  }
  const double order = std::log2(drifts[1] / drifts[3]) / 2;
  std::printf("\nrelative drift; the order of its decrease is %.1f\n", order);
  return drifts.back() < 1e-7 && order > 3.5 ? 0 : 1;
}
