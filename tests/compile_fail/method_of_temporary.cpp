// A method refers to its inputs, which must outlive it.
// EXPECT: use of deleted function|deleted constructor
#include <iim/iim.hpp>

int main()
{
  const iim::DynamicTree tree(iim::StandardAssembly<double>{});
#ifdef IIM_CORRECT
  const iim::Inputs inputs(tree);
  iim::ImplicitInversion method(tree, inputs);
#else
  iim::ImplicitInversion method(tree, iim::Inputs(tree));
#endif
}
