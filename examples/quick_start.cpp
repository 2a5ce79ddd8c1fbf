// The first screen of the README: q̈ = q̈₀ + B̂ u of a biped on eight contact points.
#include <iim/iim.hpp>
#include <iim/models.hpp>

#include <iostream>

/// All of it as members of a class, in this order; each refers to those before it.
class Controller {
  using Tree = iim::StandardTree<double>;

public:
  explicit Controller(const iim::StandardAssembly<double>& robot) : tree_(robot) {}
  Controller(const Controller&) = delete;
  Controller& operator=(const Controller&) = delete;

  auto dynamics(const Eigen::VectorXd& q, const Eigen::VectorXd& qd) { return method_(q, qd, ws_); }

private:
  const Tree tree_;
  const iim::Inputs<Tree> inputs_{tree_};  // all motors
  iim::Workspace<Tree> ws_{tree_};
  iim::ImplicitInversion<Tree> method_{tree_, inputs_};
};

int main()
{
  const iim::DynamicTree tree(iim::models::biped<double>());  // constant; threads may share it
  iim::Inputs inputs(tree);                                   // all 14 motors, then three columns per contact point
  for (const char* point : iim::models::biped_contacts) { inputs.add_force(point); }
  iim::Workspace ws(tree);                                    // the memory of the cycle
  iim::ImplicitInversion method(tree, inputs);                // is in these two

  Eigen::VectorXd q = iim::neutral(tree);                     // torso position, quaternion (x, y, z, w), 14 joints
  const Eigen::VectorXd qd = Eigen::VectorXd::Ones(tree.n_v());
  const Eigen::VectorXd u = Eigen::VectorXd::Constant(inputs.columns(), 0.5);

  const auto dynamics = method(q, qd, ws);                    // q̈₀ and B̂, 20 × 38; allocates nothing
  if (!dynamics.ok()) { return 1; }                           // nothing throws here
  const Eigen::VectorXd qdd = dynamics.qdd0 + dynamics.Bhat * u;
  std::cout << "q̈ = " << qdd.transpose() << "\n";

  // The same by the O(n) pass with u.
  const auto direct = iim::forward_dynamics(q, qd, inputs, u, ws);
  const double difference = (qdd - direct.qdd).norm() / qdd.norm();
  std::cout << "relative difference to the O(n) pass with u: " << difference << "\n";

  Controller controller(iim::models::biped<double>());
  const auto motors = controller.dynamics(q, qd);
  const double apart = (motors.Bhat - dynamics.Bhat.leftCols(14)).norm() / motors.Bhat.norm();
  return difference < 1e-12 && apart < 1e-12 ? 0 : 1;
}
