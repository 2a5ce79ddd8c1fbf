// What a type of subsystem costs.
#pragma once

#include "../common/counted.hpp"

#include <string>
#include <vector>

namespace bench {

struct Cost {
  Operations operations;
  double nanoseconds = 0;
};

/// What one more subsystem of a type in a chain of them adds.
struct TypeCost {
  std::string name;
  long n_i = 0;  ///< internal velocities
  long n_u = 0;  ///< motors
  Cost qdd0;     ///< the O(n) pass with q̈₀
  Cost column;   ///< each column of B̂ by implicit inversion
};

/// The machine of examples/legged_machine.hpp, by one method: largest errors of a row of q̈₀ and of B̂ over all states.
struct LeggedResult {
  std::string method;
  double qdd0_error, Bhat_error, microseconds;
};

struct LeggedReport {
  long subsystems, n_v, columns;
  double doubt;  ///< difference of two methods in the Scalar of the reference
  std::vector<LeggedResult> methods;
};

std::vector<TypeCost> costs_of_joints(bool quick);
std::vector<TypeCost> costs_of_drives(bool quick);
std::vector<TypeCost> costs_of_loops(bool quick);
LeggedReport legged_report(bool quick);

}  // namespace bench
