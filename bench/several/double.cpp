// PART OF: iim_several
// OPTIONAL: openmp
#include "measure.hpp"

#ifdef _OPENMP
#include <omp.h>
#endif

namespace bench {

template SeveralTimes measure_several<double>(const peers::Model&, int);
template Spread measure_cores<double>(const peers::Model&, int, int);
template double peak<double>();

int usable_cores()
{
#ifdef _OPENMP
  return omp_get_num_procs();
#else
  return 1;
#endif
}

}  // namespace bench
