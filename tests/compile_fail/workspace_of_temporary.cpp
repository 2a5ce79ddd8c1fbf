// A workspace refers to its tree, which must outlive it.
// EXPECT: use of deleted function|deleted constructor
#include <iim/iim.hpp>

int main()
{
  const iim::StandardAssembly<double> assembly;
#ifdef IIM_CORRECT
  const iim::DynamicTree tree(assembly);
  iim::Workspace workspace(tree);
#else
  iim::Workspace workspace{iim::DynamicTree(assembly)};
#endif
}
