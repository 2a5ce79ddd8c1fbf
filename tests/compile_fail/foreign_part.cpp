// An assembly takes only the types of subsystem that it was made for.
// EXPECT: this type of subsystem is not among those that the Assembly lists
#include <iim/iim.hpp>

int main()
{
#ifdef IIM_CORRECT
  iim::Assembly<iim::FixedLink<double>, iim::RevoluteLink<double>> assembly;
#else
  iim::Assembly<iim::FixedLink<double>> assembly;
#endif
  assembly.add("link", {}, iim::RevoluteLink<double>{});
}
