// What each scene costs, in operations: numbers without noise.
#pragma once

#include "../common/table.hpp"

namespace bench {

Table scenes_table();

}  // namespace bench
