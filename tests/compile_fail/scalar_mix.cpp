// A tree has one Scalar: the parts of an assembly of doubles are made of doubles.
// EXPECT: no matching (member )?function for call to
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
