// EXPECT: what is_free has no springs
#include <iim/iim.hpp>

#include <array>

struct Balloon : iim::FloatingBase<double> {
#ifndef IIM_CORRECT
  std::array<iim::Spring<double, 6>, 1> springs(const Eigen::Matrix<double, 7, 1>&,
                                                const Eigen::Matrix<double, 6, 1>&) const
  {
    return {};
  }
#endif
};

int main()
{
  const iim::DynamicTree tree(iim::Assembly<Balloon>().add("balloon", {}, Balloon()));
  iim::Workspace ws(tree);
  return ws.tree().size() == 1 ? 0 : 1;
}
