// EXPECT: springs\(\) are part of internal_force
#include <iim/iim.hpp>

struct Hinge : iim::RevoluteLink<double> {
  using Angle = Eigen::Matrix<double, 1, 1>;
  std::array<iim::Spring<double, 1>, 1> springs(const Angle& q, const Angle&) const
  {
    return {{{Angle(1), 30, 0, 30 * q(0)}}};
  }
#ifdef IIM_CORRECT
  Angle internal_force(const Angle& q, const Angle&) const { return 30 * q; }
#endif
};

int main()
{
  const iim::DynamicTree tree(iim::Assembly<Hinge>().add("hinge", {}, Hinge()));
  iim::Workspace ws(tree);
  const Eigen::VectorXd q = Eigen::VectorXd::Zero(1);
  return iim::forward_dynamics(q, q, ws).ok() ? 0 : 1;
}
