// Of a tree that is declared const, decltype(tree) is no tree type.
// EXPECT: the tree's type without const
#include <iim/iim.hpp>
#include <iim/task.hpp>

#include <type_traits>

int main()
{
  iim::StandardAssembly<double> arm;
  arm.add("link", {}, iim::RevoluteLink<double>{});
  const iim::DynamicTree tree(arm);
  iim::Inputs inputs(tree);
#ifdef IIM_CORRECT
  using Tree = std::remove_const_t<decltype(tree)>;
#else
  using Tree = decltype(tree);
#endif
  iim::Tasks<Tree, iim::Scene{.implicit = true}> tasks(tree, inputs);
  static_cast<void>(tasks);
}
