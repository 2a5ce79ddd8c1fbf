# The target iim::urdf for <iim/urdf.hpp>, if liburdfdom is installed; otherwise iim_urdf_missing says what is absent.
# Read by the installed package and by the project itself, which sets iim_urdf_scope. An imported target, so that what
# links to it can be exported.
if(TARGET iim::urdf)
  return()
endif()

# By its CMake package (3.0 and newer); by pkg-config where that is all there is.
find_package(urdfdom CONFIG QUIET)
if(TARGET urdfdom::urdfdom_model)
  set(iim_urdfdom urdfdom::urdfdom_model)
else()
  find_package(PkgConfig QUIET)
  if(PkgConfig_FOUND)
    pkg_check_modules(iim_urdfdom QUIET IMPORTED_TARGET urdfdom)
    if(TARGET PkgConfig::iim_urdfdom)
      set(iim_urdfdom PkgConfig::iim_urdfdom)
    endif()
  endif()
endif()

if(iim_urdfdom)
  add_library(iim::urdf INTERFACE IMPORTED ${iim_urdf_scope})
  target_link_libraries(iim::urdf INTERFACE iim::iim ${iim_urdfdom})
  # The XML library that urdfdom was made with, which <iim/urdf.hpp> calls too: tinyxml2 from 4 on, tinyxml before.
  foreach(iim_xml IN ITEMS tinyxml tinyxml2)
    find_library(IIM_${iim_xml}_LIBRARY ${iim_xml})
    mark_as_advanced(IIM_${iim_xml}_LIBRARY)
    if(IIM_${iim_xml}_LIBRARY)
      target_link_libraries(iim::urdf INTERFACE "${IIM_${iim_xml}_LIBRARY}")
    endif()
  endforeach()
  unset(iim_xml)
else()
  set(iim_urdf_missing "liburdfdom is not installed (Debian, Ubuntu: liburdfdom-dev), neither as CMake package \
'urdfdom' nor for pkg-config")
endif()
unset(iim_urdfdom)
