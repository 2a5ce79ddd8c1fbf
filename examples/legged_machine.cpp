// A legged robot as it is built: elastic drives at the hips, four-bar knees, ankles on push-rods, eight contact points.
// Every method computes q̈₀ and B̂ of it; the table shows their errors and what they cost.
#include "legged_machine.hpp"

#include <cstdio>

int main()
{
  const legged::Comparison comparison = legged::compare(64, 21);
  std::printf("%ld subsystems, %ld degrees of freedom, %ld inputs; reference certain to %.0e\n\n", comparison.subsystems,
              comparison.n_v, comparison.columns, std::max(comparison.doubt.qdd0, comparison.doubt.Bhat));
  std::printf("%10s %16s %12s   %s\n", "time [us]", "error of qdd0", "of Bhat", "method");
  for (const legged::Result& r : comparison.results) {
    std::printf("%10.2f %16.1e %12.1e   %s\n", r.microseconds, r.error.qdd0, r.error.Bhat, r.method.c_str());
  }
  return comparison.agree(1e-9) ? 0 : 1;
}
