// PART OF: iim_several
// OPTIONAL: openmp
#include "measure.hpp"

namespace bench {

template SeveralTimes measure_several<float>(const peers::Model&, int);
template Spread measure_cores<float>(const peers::Model&, int, int);
template double peak<float>();

}  // namespace bench
