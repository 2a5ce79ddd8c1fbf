// An input-Jacobian method takes what forward_dynamics returns, not the workspace.
// EXPECT: no match for call|no matching function for call
#include <iim/iim.hpp>

int main()
{
  const iim::DynamicTree tree(iim::StandardAssembly<double>{});
  const iim::Inputs inputs(tree);
  iim::Workspace workspace(tree);
  iim::ImplicitInversion method(tree, inputs);
  Eigen::VectorXd q, qd;
#ifdef IIM_CORRECT
  static_cast<void>(method(iim::forward_dynamics(q, qd, workspace)));
#else
  static_cast<void>(method(workspace));
#endif
}
