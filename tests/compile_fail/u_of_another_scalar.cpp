// EXPECT: u must have the Scalar of the tree
#include <iim/iim.hpp>
#include <iim/models.hpp>

int main()
{
  const iim::DynamicTree tree(iim::models::chain<float>(3));
  const iim::Inputs inputs(tree);
  iim::Workspace ws(tree);
  const Eigen::VectorXf q = Eigen::VectorXf::Zero(3);
#ifdef IIM_CORRECT
  const Eigen::VectorXf u = q;
#else
  const Eigen::VectorXd u = Eigen::VectorXd::Zero(3);
#endif
  return iim::forward_dynamics(q, q, inputs, u, ws).ok() ? 0 : 1;
}
