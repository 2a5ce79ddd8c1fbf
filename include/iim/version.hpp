// Version of the library. CMake reads the three numbers from the three lines below.
#pragma once

namespace iim {

inline constexpr int version_major = 0;
inline constexpr int version_minor = 1;
inline constexpr int version_patch = 0;

}  // namespace iim
