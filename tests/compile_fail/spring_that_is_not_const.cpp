// EXPECT: internal_force must be:
#include <iim/iim.hpp>

struct Hinge : iim::RevoluteLink<double> {
  using Angle = Eigen::Matrix<double, 1, 1>;
  Angle internal_force(const Angle& q, const Angle&)
#ifdef IIM_CORRECT
      const
#endif
  {
    return 30 * q;
  }
};

int main()
{
  const iim::DynamicTree tree(iim::Assembly<Hinge>().add("hinge", {}, Hinge()));
  iim::Workspace ws(tree);
  const Eigen::VectorXd q = Eigen::VectorXd::Zero(1);
  return iim::forward_dynamics(q, q, ws).ok() ? 0 : 1;
}
