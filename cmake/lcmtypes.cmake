# lcm-gen turns each lcmtypes/NAME.lcm into build/lcmtypes/twinrate/NAME.hpp.
set(lcm_types measurement_t estimate_t gain_t command_t reference_t truth_t status_t event_t
              manifest_t request_t reply_t ack_t
              event_v2_t
              measurement_v4_t estimate_v4_t gain_v4_t command_v4_t reference_v4_t truth_v4_t status_v4_t event_v4_t
              manifest_v4_t request_v4_t reply_v4_t)
set(lcm_out ${CMAKE_CURRENT_BINARY_DIR}/lcmtypes)
set(lcm_headers)
foreach(type ${lcm_types})
  set(header ${lcm_out}/twinrate/${type}.hpp)
  add_custom_command(
    OUTPUT ${header}
    COMMAND ${LCM_GEN} -x --cpp-std c++11 --cpp-hpath ${lcm_out}
            ${CMAKE_CURRENT_SOURCE_DIR}/lcmtypes/${type}.lcm
    DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/lcmtypes/${type}.lcm
    COMMENT "lcm-gen ${type}")
  list(APPEND lcm_headers ${header})
endforeach()
add_custom_target(lcmtypes_headers DEPENDS ${lcm_headers})
add_library(twinrate_lcmtypes INTERFACE)
add_dependencies(twinrate_lcmtypes lcmtypes_headers)
target_include_directories(twinrate_lcmtypes SYSTEM INTERFACE
  $<BUILD_INTERFACE:${lcm_out}> $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
target_link_libraries(twinrate_lcmtypes INTERFACE lcm::lcm)
# LCM decodes a double through a pointer to int64_t. Where GCC inlines that and may assume strict aliasing, it reads the
# double before it was decoded: every omega_m_ref of RunLog::reference was 0 in the release build.
target_compile_options(twinrate_lcmtypes INTERFACE -fno-strict-aliasing)
