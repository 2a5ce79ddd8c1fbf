// Only forward_dynamics makes a receipt.
// EXPECT: is private within this context|calling a private constructor
#include <iim/iim.hpp>

using Tree = iim::StaticTree<iim::On<-1, iim::RevoluteLink<double>>>;

void use(iim::Workspace<Tree>& workspace)
{
  const Eigen::VectorXd q(1), qd(1);
#ifdef IIM_CORRECT
  const iim::ForwardDynamics<iim::Workspace<Tree>> receipt = iim::forward_dynamics(q, qd, workspace);
#else
  const iim::ForwardDynamics<iim::Workspace<Tree>> receipt(workspace, iim::Scene{}, 0.0, iim::Status::ok, -1);
#endif
  (void)receipt;
}

int main() {}
