// PART OF: iim_several
#include "several_measure.hpp"

namespace bench {

template SeveralTimes measure_several<double>(const peers::Model&, int);
template double peak<double>();

}  // namespace bench
