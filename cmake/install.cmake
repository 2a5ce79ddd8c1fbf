# cmake --install: the headers and the package files that find_package(iim) reads.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

set(iim_package_dir "${CMAKE_INSTALL_DATADIR}/cmake/iim")

install(TARGETS iim EXPORT iim-targets INCLUDES DESTINATION "${CMAKE_INSTALL_INCLUDEDIR}")
install(DIRECTORY "${PROJECT_SOURCE_DIR}/include/iim" DESTINATION "${CMAKE_INSTALL_INCLUDEDIR}"
        FILES_MATCHING PATTERN "*.hpp")
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
