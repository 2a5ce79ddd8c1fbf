// A subsystem of one's own, a pan-tilt head with two motors: through the law suite and every method, against the same robot
// made of two revolute links.
#include <iim/global_inverse.hpp>
#include <iim/iim.hpp>
#include <iim/law_suite.hpp>
#include <iim/models.hpp>
#include <iim/recursive_inverse.hpp>
#include <iim/unit_force.hpp>

#include <algorithm>
#include <array>
#include <iostream>
#include <stdexcept>
#include <string>
#include <vector>

using iim::Matrix3, iim::Vector3;

/// Pan about the inlet's z, then tilt about the turned y. q: the two angles [rad]. Inputs: the two torques.
struct PanTilt {
  using Scalar = double;
  static constexpr int n_q = 2;
  static constexpr int n_i = 2;
  static constexpr int n_u = 2;
  static constexpr int n_frames = 1;
  // Both axes go through the coupling point: no linear motion, no offset. But the tilt axis turns with the pan.
  static constexpr iim::MotionPattern pattern{.linear = false, .offset = false, .bias = true};

  iim::Body<double> body;

  void prepare(const std::string& name) { iim::validate(body, name); }

  // Where the frame is, how it moves per q̇, and how it accelerates for q̈ = 0, seen from the inlet (world axes).
  bool motion(const Matrix3<double>& R, const Eigen::Vector2d& q, const Eigen::Vector2d& qd,
              std::array<iim::FrameMotion<double, 2>, 1>& frames) const
  {
    iim::FrameMotion<double, 2>& m = frames[0];
    const Matrix3<double> panned = R * Eigen::AngleAxisd(q(0), Vector3<double>::UnitZ()).toRotationMatrix();
    m.R = panned * Eigen::AngleAxisd(q(1), Vector3<double>::UnitY()).toRotationMatrix();
    const Vector3<double> pan = R.col(2), tilt = panned.col(1);
    m.S.bottomRows<3>() << pan, tilt;
    m.bias.head<3>().setZero();
    m.bias.tail<3>() = (qd(0) * pan).cross(tilt) * qd(1);
    return true;
  }

  std::array<iim::CarriedBody<double>, 1> bodies() const { return {{{0, body}}}; }

  Eigen::Matrix2d Bbar(const Eigen::Vector2d&) const { return Eigen::Matrix2d::Identity(); }
};
static_assert(iim::Subsystem<PanTilt>);

namespace {

// One text for both robots: a pole on the head, a force at its end. (q̈₀, B̂) by each of the four methods.
template <class Assembly>
std::vector<Eigen::MatrixXd> solve(Assembly robot)
{
  robot.add("pole", {"head", Matrix3<double>::Identity(), {0.1, 0.0, 0.2}}, iim::models::link<double>());
  const iim::DynamicTree tree(robot);
  iim::Inputs inputs(tree);
  inputs.add_force("pole", {0.0, 0.0, -1.0});
  iim::Workspace ws(tree);
  const auto fd = iim::forward_dynamics(Eigen::Vector3d(0.7, -0.4, 0.3), Eigen::Vector3d(2.0, -3.0, 1.0), ws);
  std::vector<Eigen::MatrixXd> answers;
  const auto add = [&](auto method) {
    const auto dynamics = method(fd);
    if (!dynamics.ok()) { throw std::runtime_error(describe(dynamics, tree)); }
    answers.emplace_back(tree.n_v(), 1 + inputs.columns());
    answers.back() << dynamics.qdd0, dynamics.Bhat;
  };
  add(iim::ImplicitInversion(tree, inputs));
  add(iim::UnitForce(tree, inputs));
  add(iim::RecursiveInverse(tree, inputs));
  add(iim::GlobalInverse(tree, inputs));
  return answers;
}

}  // namespace

int main()
{
  iim::Body<double> head;
  head.mass = 2;
  head.com = {0.05, 0.01, 0.1};
  head.inertia.diagonal() << 0.02, 0.03, 0.01;

  // The laws of mechanics, in random states on a robot that moves.
  const iim::LawReport laws = iim::check_laws(PanTilt{head});
  std::cout << laws.text();

  iim::Assembly<PanTilt, iim::RevoluteLink<double>> own;
  own.add("head", {}, PanTilt{head});

  iim::Assembly<iim::RevoluteLink<double>> two_links;
  const auto massless = iim::Body<double>::massless();
  two_links.add("pan", {}, iim::RevoluteLink<double>{{Vector3<double>::UnitZ()}, massless});
  two_links.add("head", {"pan"}, iim::RevoluteLink<double>{{Vector3<double>::UnitY()}, head});

  const auto a = solve(own), b = solve(two_links);
  double difference = 0;
  for (const auto& answers : {a, b}) {
    for (const Eigen::MatrixXd& answer : answers) {
      difference = std::max(difference, (answer - b[0]).norm() / b[0].norm());
    }
  }
  std::cout << "(q̈₀, B̂) =\n" << a[0] << "\nall four methods are two links, up to " << difference << "\n";
  return laws.ok() && difference < 1e-13 ? 0 : 1;
}
