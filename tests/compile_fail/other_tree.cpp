// A method takes receipts of trees of its own type.
// EXPECT: no match for|no matching (member )?function
#include <iim/iim.hpp>

using Link = iim::RevoluteLink<double>;
using One = iim::StaticTree<iim::On<-1, Link>>;
using Two = iim::StaticTree<iim::On<-1, Link>, iim::On<0, Link>>;

#ifdef IIM_CORRECT
using Other = One;
#else
using Other = Two;
#endif

void use(iim::ImplicitInversion<One>& method, iim::Workspace<Other>& workspace)
{
  const Eigen::VectorXd q(1), qd(1);
  static_cast<void>(method(iim::forward_dynamics(q, qd, workspace)));
}

int main() {}
