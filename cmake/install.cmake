# cmake --install: the headers and the package files that find_package(iim) reads.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

set(iim_package_dir "${CMAKE_INSTALL_DATADIR}/cmake/iim")

if(CMAKE_VERSION VERSION_GREATER_EQUAL 3.23)
  install(TARGETS iim EXPORT iim-targets FILE_SET HEADERS DESTINATION "${CMAKE_INSTALL_INCLUDEDIR}")
else()
  install(TARGETS iim EXPORT iim-targets)
  install(DIRECTORY "${PROJECT_SOURCE_DIR}/include/iim" DESTINATION "${CMAKE_INSTALL_INCLUDEDIR}"
          FILES_MATCHING PATTERN "*.hpp")
endif()
install(EXPORT iim-targets NAMESPACE iim:: DESTINATION "${iim_package_dir}")

configure_package_config_file("${PROJECT_SOURCE_DIR}/cmake/iim-config.cmake.in"
                              "${PROJECT_BINARY_DIR}/iim-config.cmake"
                              INSTALL_DESTINATION "${iim_package_dir}"
                              NO_SET_AND_CHECK_MACRO)
write_basic_package_version_file("${PROJECT_BINARY_DIR}/iim-config-version.cmake"
                                 COMPATIBILITY SameMinorVersion ARCH_INDEPENDENT)
install(FILES "${PROJECT_BINARY_DIR}/iim-config.cmake"
              "${PROJECT_BINARY_DIR}/iim-config-version.cmake"
              "${PROJECT_SOURCE_DIR}/cmake/iim-urdf.cmake"
        DESTINATION "${iim_package_dir}")
