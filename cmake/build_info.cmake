# Writes OUTPUT, the header iim_build_info.hpp, from SOURCE (for the commit), COMPILER, FLAGS, BUILD_TYPE and VERSION.
# The file keeps its time if nothing has changed, so that nothing is compiled again.
set(commit "unknown")
find_program(git git)
if(git)
  execute_process(COMMAND "${git}" -C "${SOURCE}" rev-parse --short=12 HEAD
                  OUTPUT_VARIABLE hash OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET RESULT_VARIABLE failed)
  if(NOT failed)
    set(commit "${hash}")
    execute_process(COMMAND "${git}" -C "${SOURCE}" status --porcelain -- .
                    OUTPUT_VARIABLE changes ERROR_QUIET)
    if(changes)
      string(APPEND commit "-dirty")
    endif()
  endif()
endif()

string(REGEX REPLACE " +" " " FLAGS "${FLAGS}")
string(STRIP "${FLAGS}" FLAGS)
foreach(text IN ITEMS COMPILER FLAGS BUILD_TYPE VERSION)
  string(REPLACE "\\" "\\\\" ${text} "${${text}}")
  string(REPLACE "\"" "\\\"" ${text} "${${text}}")
endforeach()

file(CONFIGURE OUTPUT "${OUTPUT}" @ONLY CONTENT [=[
// How the program that includes this was built. Written by the build.
#pragma once

#include <Eigen/Core>

#define IIM_BUILD_TEXT_OF(x) #x
#define IIM_BUILD_TEXT(x) IIM_BUILD_TEXT_OF(x)

namespace iim_build {

inline constexpr const char* version = "@VERSION@";
inline constexpr const char* compiler = "@COMPILER@";
inline constexpr const char* flags = "@FLAGS@";
inline constexpr const char* build_type = "@BUILD_TYPE@";
inline constexpr const char* commit = "@commit@";
inline constexpr const char* eigen =
    IIM_BUILD_TEXT(EIGEN_WORLD_VERSION) "." IIM_BUILD_TEXT(EIGEN_MAJOR_VERSION) "." IIM_BUILD_TEXT(EIGEN_MINOR_VERSION);

}  // namespace iim_build

#undef IIM_BUILD_TEXT
#undef IIM_BUILD_TEXT_OF
]=])
