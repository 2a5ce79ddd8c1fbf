// The subsystems of a StaticTree stand depth first.
// EXPECT: must be listed depth first
#include <iim/iim.hpp>

using Link = iim::RevoluteLink<double>;
#ifdef IIM_CORRECT
using Tree = iim::StaticTree<iim::On<-1, Link>, iim::On<0, Link>, iim::On<1, Link>, iim::On<0, Link>>;
#else
using Tree = iim::StaticTree<iim::On<-1, Link>, iim::On<0, Link>, iim::On<0, Link>, iim::On<1, Link>>;
#endif

Eigen::Index size(const Tree& tree) { return tree.n_v(); }

int main() {}
