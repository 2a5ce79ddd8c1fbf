// An assembly takes only the types of subsystem that it was made for.
// EXPECT: no matching (member )?function for call to
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
