# What a user does with the finished package: install it, find it, build against it; or take the sources in.
set(consumer "${CMAKE_CURRENT_SOURCE_DIR}/consumer")
set(folder "${CMAKE_CURRENT_BINARY_DIR}/consumer")
set(prefix "${folder}/prefix")
set(launcher "${CMAKE_CXX_COMPILER_LAUNCHER}")
if(launcher MATCHES "pch_defines")  # a list; here there are no precompiled headers
  set(launcher "${IIM_CCACHE}")
endif()
set(options
  "-DCMAKE_CXX_COMPILER=${CMAKE_CXX_COMPILER}"
  "-DCMAKE_CXX_FLAGS=${CMAKE_CXX_FLAGS}"
  "-DCMAKE_CXX_FLAGS_DEBUG=${CMAKE_CXX_FLAGS_DEBUG}"
  "-DCMAKE_CXX_COMPILER_LAUNCHER=${launcher}"
  "-DCMAKE_BUILD_TYPE=$<CONFIG>"
  # What is registered on this machine is not what is tested here.
  -DCMAKE_FIND_USE_PACKAGE_REGISTRY=OFF)
list(JOIN CMAKE_PREFIX_PATH ":" prefixes)
set(environment "CMAKE_PREFIX_PATH=${prefix}:${prefixes}:$ENV{CMAKE_PREFIX_PATH}")

add_test(NAME install
  COMMAND "${CMAKE_COMMAND}" --install "${PROJECT_BINARY_DIR}" --prefix "${prefix}" --config $<CONFIG>)
set_tests_properties(install PROPERTIES FIXTURES_SETUP iim_installed LABELS build)

# consumer_test(NAME program from request): configures, builds and runs.
function(consumer_test name program from request)
  add_test(NAME consumer_${name}
    COMMAND "${CMAKE_CTEST_COMMAND}" --build-and-test "${consumer}" "${folder}/${name}"
      --build-generator "${CMAKE_GENERATOR}" --build-noclean
      --build-options ${options} "-DIIM_FROM=${from}" "-DIIM_REQUEST=${request}"
      --test-command "${folder}/${name}/${program}")
  set_tests_properties(consumer_${name} PROPERTIES FIXTURES_REQUIRED iim_installed LABELS build
                       ENVIRONMENT "${environment}")
endfunction()

# refused(NAME message request cmake-argument…): find_package must fail, and say why.
function(refused name message request)
  add_test(NAME consumer_${name}
    COMMAND "${CMAKE_COMMAND}" -S "${consumer}" -B "${folder}/${name}" -G "${CMAKE_GENERATOR}" ${options}
      -DIIM_FROM=package "-DIIM_REQUEST=${request}" ${ARGN})
  # CMake wraps its messages: a blank in `message` is any white space.
  string(REPLACE " " "[ \n]+" pattern "${message}")
  set_tests_properties(consumer_${name} PROPERTIES FIXTURES_REQUIRED iim_installed LABELS build
                       ENVIRONMENT "${environment}" PASS_REGULAR_EXPRESSION "${pattern}")
endfunction()

consumer_test(find_package consumer package ${PROJECT_VERSION})
consumer_test(add_subdirectory consumer "${PROJECT_SOURCE_DIR}" "")
refused(wrong_version "compatible with requested version \"99.0\"" "99.0")
refused(wrong_component "component 'nonsense' of iim: there is no such component" "COMPONENTS nonsense")
refused(urdf_absent "component 'urdf' of iim: liburdfdom is not installed" "COMPONENTS urdf"
        -DCMAKE_DISABLE_FIND_PACKAGE_urdfdom=ON -DCMAKE_DISABLE_FIND_PACKAGE_PkgConfig=ON)
if(TARGET iim::urdf AND EXISTS "${PROJECT_SOURCE_DIR}/include/iim/urdf.hpp")
  consumer_test(urdf consumer_urdf package "COMPONENTS urdf")
endif()
