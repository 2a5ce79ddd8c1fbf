// A tree has one Scalar: the parts of an assembly of doubles are made of doubles.
// EXPECT: this type of subsystem is not among those that the Assembly lists
#include <iim/iim.hpp>

int main()
{
  iim::StandardAssembly<double> assembly;
#ifdef IIM_CORRECT
  assembly.add("link", {}, iim::RevoluteLink<double>{});
#else
  assembly.add("link", {}, iim::RevoluteLink<float>{});
#endif
}
