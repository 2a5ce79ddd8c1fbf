// EXPECT: each type of subsystem is listed once
#include <iim/iim.hpp>

using Hinge = iim::RevoluteLink<double>;
#ifdef IIM_CORRECT
using Parts = iim::Assembly<Hinge>;
#else
using Parts = iim::Assembly<Hinge, iim::RevoluteLink<double> >;
#endif

int main() { return Parts().parts().empty() ? 0 : 1; }
