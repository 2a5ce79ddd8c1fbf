// The methods that the tables compare.
#pragma once

#include "../common/methods.hpp"

#include <vector>

namespace bench {

/// The method that all others are compared with.
inline constexpr const char* product = "iim";
/// The O(n) pass alone.
inline constexpr const char* floor_of_all = "pass";

std::vector<Method> implicit_methods();
std::vector<Method> unit_force_methods();
std::vector<Method> global_methods();

/// All, in the order of rows.
inline std::vector<Method> methods()
{
  std::vector<Method> all;
  for (const auto& group : {implicit_methods(), unit_force_methods(), global_methods()}) {
    all.insert(all.end(), group.begin(), group.end());
  }
  return all;
}

}  // namespace bench
