// A geared pendulum, its weight a point at the end of the rod: (m l² + k² J) q̈ = k u − m g l sin q.
#include <iim/iim.hpp>
#include <iim/version.hpp>

#include <cmath>
#include <cstdio>
#include <limits>

int main()
{
  const double m = 2, l = 0.5, g = 9.81, k = 50, J = 1e-4, q0 = 0.3;

  iim::MotorArm<double> arm;
  arm.joint.axis = Eigen::Vector3d::UnitY();
  arm.body.mass = m;
  arm.body.com = Eigen::Vector3d(0, 0, -l);
  arm.motor.gear_ratio = k;
  arm.motor.axis = Eigen::Vector3d::UnitY();
  arm.motor.axial_inertia = J;

  iim::StandardAssembly<double> assembly;
  assembly.add("pendulum", {}, arm);
  const iim::DynamicTree tree(assembly);
  const iim::Inputs inputs(tree);
  iim::Workspace workspace(tree);
  iim::ImplicitInversion method(tree, inputs);

  const Eigen::VectorXd q = Eigen::VectorXd::Constant(1, q0), qd = Eigen::VectorXd::Zero(1);
  const auto [qdd0, Bhat, status, subsystem] = method(iim::forward_dynamics(q, qd, workspace));

  const double inertia = m * l * l + k * k * J;
  const double error =
      std::max(std::abs(qdd0(0) * inertia / (-m * g * l * std::sin(q0)) - 1), std::abs(Bhat(0, 0) * inertia / k - 1));
  const bool no_options = OPTIONS_OF_IIM[0] == '\0';
  std::printf("iim %d.%d.%d: %s, relative error %.1e, options of the target: '%s'\n", iim::version_major,
              iim::version_minor, iim::version_patch, iim::to_string(status), error, OPTIONS_OF_IIM);
  // Some twenty roundings lie between the two ways of writing the same numbers.
  return status == iim::Status::ok && error < 20 * std::numeric_limits<double>::epsilon() && no_options ? 0 : 1;
}
