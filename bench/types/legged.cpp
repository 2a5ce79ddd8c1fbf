// PART OF: iim_types
// The legged machine of the examples, by all methods.
#include "types.hpp"

#include "../../examples/legged_machine.hpp"

namespace bench {

LeggedReport legged_report(bool quick)
{
  const legged::Comparison comparison = legged::compare(64, quick ? 21 : 1001);
  LeggedReport report{comparison.subsystems,
                      comparison.n_v,
                      comparison.columns,
                      std::max(comparison.doubt.qdd0, comparison.doubt.Bhat),
                      {}};
  for (const legged::Result& r : comparison.results) {
    report.methods.push_back({r.method, r.error.qdd0, r.error.Bhat, r.microseconds});
  }
  return report;
}

}  // namespace bench
