// EXPECT: q and qd must have the Scalar of the tree
#include <iim/iim.hpp>
#include <iim/models.hpp>

int main()
{
  const iim::DynamicTree tree(iim::models::chain<double>(3));
  iim::Workspace ws(tree);
#ifdef IIM_CORRECT
  const Eigen::VectorXd q = Eigen::VectorXd::Zero(3);
#else
  const Eigen::VectorXf q = Eigen::VectorXf::Zero(3);
#endif
  return iim::forward_dynamics(q, q, ws).ok() ? 0 : 1;
}
