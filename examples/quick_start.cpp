// The first screen of the README: q̈ = q̈₀ + B̂ u of a biped on eight contact points.
#include <iim/iim.hpp>
#include <iim/models.hpp>

#include <iostream>

int main()
{
  const iim::DynamicTree tree(iim::models::biped<double>());  // constant; threads may share it
  iim::Inputs inputs(tree);                                   // all 14 motors, then three columns per contact point
  for (const char* point : iim::models::biped_contacts) { inputs.add_force(point); }
  iim::Workspace ws(tree);                                    // all memory is in these two:
  iim::ImplicitInversion method(tree, inputs);                // what follows allocates none

  Eigen::VectorXd q = iim::neutral(tree);                     // torso position, quaternion (x, y, z, w), 14 joints
  const Eigen::VectorXd qd = Eigen::VectorXd::Ones(tree.n_v());
  const Eigen::VectorXd u = Eigen::VectorXd::Constant(inputs.columns(), 0.5);

  const auto dynamics = method(q, qd, ws);                    // q̈₀ and B̂, 20 × 38
  if (!dynamics.ok()) { return 1; }                           // nothing throws here
  const Eigen::VectorXd qdd = dynamics.qdd0 + dynamics.Bhat * u;
  std::cout << "q̈ = " << qdd.transpose() << "\n";

  // The same by the O(n) pass with u.
  const auto direct = iim::forward_dynamics(q, qd, inputs, u, ws);
  const double difference = (qdd - direct.qdd).norm() / qdd.norm();
  std::cout << "relative difference to the O(n) pass with u: " << difference << "\n";
  return difference < 1e-12 ? 0 : 1;
}
