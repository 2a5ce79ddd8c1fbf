// PART OF: iim_several
#include "several_measure.hpp"

namespace bench {

template SeveralTimes measure_several<float>(const peers::Model&, int);
template double peak<float>();

}  // namespace bench
