// What a method returns is memory of the method: not of one that is gone after the statement.
// EXPECT: passing .* as 'this' argument discards qualifiers|no match for call|no matching function|not viable
#include <iim/iim.hpp>

int main()
{
  const iim::DynamicTree tree(iim::StandardAssembly<double>{});
  const iim::Inputs inputs(tree);
  iim::Workspace workspace(tree);
  const Eigen::VectorXd q, qd;
#ifdef IIM_CORRECT
  iim::ImplicitInversion method(tree, inputs);
  const auto result = method(q, qd, workspace);
#else
  const auto result = iim::ImplicitInversion(tree, inputs)(q, qd, workspace);
#endif
  return result.ok() ? 0 : 1;
}
