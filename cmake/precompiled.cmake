# Precompiled headers and unity builds, for a short build. They do not change the flags of an object.
#
# The headers of the libraries used are parsed once instead of once a source file. Three sets: Eigen and std, with
# text and LCM above them, with the test libraries above those. Sources with flags of their own
# (instruction sets, benchmarks) have SKIP_PRECOMPILE_HEADERS. The sets hold no header of this tree, and every source
# also compiles with TWINRATE_PCH=OFF and TWINRATE_UNITY=OFF.
#
# No set holds nlohmann/json.hpp: it defines literals, which instantiate the parser in each translation unit that uses
# the set. That costs a unit without JSON more time than the set saves a unit with JSON.
#
# Unity builds: several files form a translation unit, which instantiates the templates of GoogleTest, Eigen and fmt
# once. Tests with equal names in their unnamed namespaces have namespaces of their own (twinrate::NAME_test).
#
# Off by default with ccache, which does not cache objects compiled with a precompiled header.
set(twinrate_short_build ON)
if(CMAKE_CXX_COMPILER_LAUNCHER MATCHES "ccache")
  set(twinrate_short_build OFF)
endif()
option(TWINRATE_PCH "precompile the headers of the libraries used" ${twinrate_short_build})
option(TWINRATE_UNITY "compile several files at a time" ${twinrate_short_build})

# GCC 12 reports false overflows in std::string if its header is precompiled. These four are warnings in builds with
# precompiled headers and errors in builds without.
if(TWINRATE_PCH AND CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
  target_compile_options(twinrate_options INTERFACE
    "$<BUILD_INTERFACE:-Wno-error=array-bounds;-Wno-error=restrict;-Wno-error=stringop-overflow;-Wno-error=stringop-overread>")
  # The garbage collector took 5 % of the time of a translation unit.
  target_compile_options(twinrate_options INTERFACE $<BUILD_INTERFACE:--param=ggc-min-heapsize=1000000>)
endif()

set(twinrate_pch_model_headers <algorithm> <array> <cmath> <complex> <cstddef> <cstdint> <functional> <map> <memory>
    <numbers> <optional> <span> <string> <string_view> <utility> <vector> <Eigen/Core> <Eigen/LU>)
set(twinrate_pch_headers ${twinrate_pch_model_headers} <chrono> <filesystem> <fstream> <set> <sstream> <thread>
    <Eigen/Cholesky> <fmt/format.h> <fmt/ranges.h> <lcm/lcm-cpp.hpp>)
set(twinrate_pch_tests_headers ${twinrate_pch_headers} <Eigen/Dense> <gtest/gtest.h>)

# twinrate_precompiled_set(SET [LIBRARIES ..]): the set of headers `twinrate_SET`, as a target.
function(twinrate_precompiled_set set)
  if(NOT TWINRATE_PCH)
    return()
  endif()
  set(source ${CMAKE_BINARY_DIR}/twinrate_${set}.cpp)
  file(CONFIGURE OUTPUT ${source} CONTENT "")
  add_library(twinrate_${set} OBJECT ${source})
  target_link_libraries(twinrate_${set} PRIVATE twinrate_options ${ARGN})
  target_precompile_headers(twinrate_${set} PRIVATE ${twinrate_${set}_headers})
endfunction()

# twinrate_precompiled(SET TARGET ..): the targets use the set.
function(twinrate_precompiled set)
  if(NOT TWINRATE_PCH)
    return()
  endif()
  foreach(target ${ARGN})
    target_precompile_headers(${target} REUSE_FROM twinrate_${set})
  endforeach()
endfunction()

# twinrate_unity(TARGET BATCH): BATCH files in a translation unit; files of other folders (../) stay alone.
function(twinrate_unity target batch)
  if(NOT TWINRATE_UNITY)
    return()
  endif()
  set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE ${batch})
  get_target_property(sources ${target} SOURCES)
  foreach(source ${sources})
    if(source MATCHES "\\.\\./")
      set_source_files_properties(${source} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
    endif()
  endforeach()
endfunction()

# twinrate_unity_group(TARGET GROUP SOURCES ..): the files form one translation unit; files without a group stay alone.
function(twinrate_unity_group target group)
  if(NOT TWINRATE_UNITY)
    return()
  endif()
  set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_MODE GROUP)
  set_source_files_properties(${ARGN} PROPERTIES UNITY_GROUP ${group})
endfunction()
