// Robots of URDF files as scenes, where there are files and a parser.
#pragma once

#include "accuracy.hpp"

#include <string>
#include <vector>

namespace bench {

/// panda, ur5, anymal, solo12 at so many random states; all motors, and forces at hands and feet. What is missing goes
/// to `absent`.
std::vector<AccuracyScene> accuracy_robots(const std::string& folder, int states, std::vector<std::string>& absent);

}  // namespace bench
