// PROGRAM: iim_peers_controller
// What a user compiles: one cycle of a controller of the run-time biped. iim_peers compiles it again and reports the
// time and the size of this program (peers/compile.hpp).
#include <iim/iim.hpp>
#include <iim/models.hpp>

#include <iostream>

int main()
{
  const iim::DynamicTree tree(iim::models::biped<double>());
  iim::Inputs inputs(tree);
  for (const char* point : iim::models::biped_contacts) { inputs.add_force(point); }
  iim::Workspace ws(tree);
  iim::ImplicitInversion method(tree, inputs);
  Eigen::VectorXd q = Eigen::VectorXd::Zero(tree.n_q());
  q(6) = 1;
  const Eigen::VectorXd qd = Eigen::VectorXd::Ones(tree.n_v());
  const Eigen::VectorXd u = Eigen::VectorXd::Constant(inputs.columns(), 0.5);

  const auto dynamics = method(q, qd, ws);
  if (!dynamics.ok()) { return 1; }
  std::cout << (dynamics.qdd0 + dynamics.Bhat * u).transpose() << '\n';
  return 0;
}
