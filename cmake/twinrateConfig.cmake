# find_package(twinrate): the targets of cmake/install.cmake. They need the Debian packages liblcm-dev libeigen3-dev
# libfmt-dev libtomlplusplus-dev nlohmann-json3-dev.
include(CMakeFindDependencyMacro)
find_dependency(Eigen3)
find_dependency(fmt)
find_dependency(tomlplusplus)
find_dependency(nlohmann_json)
find_dependency(Threads)

# LCM 1.3.1 has no CMake package.
if(NOT TARGET lcm::lcm)
  find_path(LCM_INCLUDE_DIR lcm/lcm-cpp.hpp)
  find_library(LCM_LIBRARY lcm)
  if(NOT LCM_INCLUDE_DIR OR NOT LCM_LIBRARY)
    set(twinrate_FOUND FALSE)
    set(twinrate_NOT_FOUND_MESSAGE "twinrate needs LCM (liblcm-dev)")
    return()
  endif()
  add_library(lcm::lcm INTERFACE IMPORTED)
  target_include_directories(lcm::lcm SYSTEM INTERFACE ${LCM_INCLUDE_DIR})
  target_link_libraries(lcm::lcm INTERFACE ${LCM_LIBRARY})
endif()
# Of the libraries themselves, for linking alone. libsodium: where the bus was built with it.
if(NOT TARGET cli11::cli11)
  add_library(cli11::cli11 INTERFACE IMPORTED)
endif()
find_library(SODIUM_LIBRARY sodium)
if(SODIUM_LIBRARY AND NOT TARGET sodium::sodium)
  add_library(sodium::sodium INTERFACE IMPORTED)
  target_link_libraries(sodium::sodium INTERFACE ${SODIUM_LIBRARY})
endif()

include(${CMAKE_CURRENT_LIST_DIR}/twinrateTargets.cmake)
