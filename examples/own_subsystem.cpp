// A subsystem of one's own: a pan-tilt head with two motors, and the same robot made of two revolute links.
#include <iim/iim.hpp>
#include <iim/models.hpp>

#include <array>
#include <iostream>
#include <string>

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

struct Result {
  Eigen::VectorXd qdd0;
  Eigen::MatrixXd Bhat;
};

// One text for both robots: a pole on the head, a force at its end.
template <class Assembly>
Result solve(Assembly& robot)
{
  iim::Attachment<double> on{"head", Matrix3<double>::Identity(), {0.1, 0.0, 0.2}};
  robot.add("pole", on, iim::models::link<double>());
  const iim::DynamicTree tree(robot);
  iim::Inputs inputs(tree);
  inputs.add_force("pole", {0.0, 0.0, -1.0});
  iim::Workspace ws(tree);
  iim::ImplicitInversion method(tree, inputs);
  const Eigen::Vector3d q(0.7, -0.4, 0.3), qd(2.0, -3.0, 1.0);
  const auto dynamics = method(iim::forward_dynamics(q, qd, ws));
  if (!dynamics.ok()) { std::cerr << "failed: " << to_string(dynamics.status) << "\n"; }
  return {dynamics.qdd0, dynamics.Bhat};
}

}  // namespace

int main()
{
  iim::Body<double> head;
  head.mass = 2;
  head.com = {0.05, 0.01, 0.1};
  head.inertia.diagonal() << 0.02, 0.03, 0.01;

  iim::Assembly<PanTilt, iim::RevoluteLink<double>> own;
  own.add("head", {}, PanTilt{head});

  iim::Assembly<iim::RevoluteLink<double>> two_links;
  const auto massless = iim::Body<double>::massless();
  two_links.add("pan", {}, iim::RevoluteLink<double>{{Vector3<double>::UnitZ()}, massless});
  two_links.add("head", {"pan"}, iim::RevoluteLink<double>{{Vector3<double>::UnitY()}, head});

  const Result a = solve(own), b = solve(two_links);
  const double qdd0_difference = (a.qdd0 - b.qdd0).norm() / b.qdd0.norm();
  const double Bhat_difference = (a.Bhat - b.Bhat).norm() / b.Bhat.norm();
  std::cout << "q̈₀ = " << a.qdd0.transpose() << "\nB̂ =\n" << a.Bhat << "\n"
            << "relative difference to two links: q̈₀ " << qdd0_difference << ", B̂ " << Bhat_difference << "\n";
  return qdd0_difference < 1e-13 && Bhat_difference < 1e-13 ? 0 : 1;
}
