// Integers cannot hold a robot's parameters.
// EXPECT: must be able to hold fractions
#include <iim/iim.hpp>

int main()
{
#ifdef IIM_CORRECT
  iim::StandardAssembly<float> assembly;
#else
  iim::StandardAssembly<int> assembly;
#endif
}
