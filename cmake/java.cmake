# The message types for Java, for lcm-spy: lcmtypes/twinrate.jar, where Java and LCM's own jar (liblcm-java) are there.
find_program(TWINRATE_JAVAC javac)
find_program(TWINRATE_JAR jar)
find_file(LCM_JAR lcm.jar PATHS /usr/share/java)
if(NOT TWINRATE_JAVAC OR NOT TWINRATE_JAR OR NOT LCM_JAR)
  message(STATUS "no types for twinrate spy: javac or lcm.jar is not installed (tools/packages.txt, [java])")
  return()
endif()
set(java ${CMAKE_CURRENT_BINARY_DIR}/lcmtypes/java)
set(sources)
foreach(type ${lcm_types})
  list(APPEND sources ${CMAKE_CURRENT_SOURCE_DIR}/lcmtypes/${type}.lcm)
endforeach()
add_custom_command(OUTPUT ${lcm_out}/twinrate.jar
  COMMAND ${CMAKE_COMMAND} -E rm -rf ${java}
  COMMAND ${CMAKE_COMMAND} -E make_directory ${java}/classes
  COMMAND ${LCM_GEN} -j --jpath ${java} ${sources}
  COMMAND ${TWINRATE_JAVAC} -nowarn --release 11 -cp ${LCM_JAR} -d ${java}/classes ${java}/twinrate/*.java
  COMMAND ${TWINRATE_JAR} cf ${lcm_out}/twinrate.jar -C ${java}/classes .
  DEPENDS ${sources}
  COMMENT "lcm-gen, types for Java")
add_custom_target(lcmtypes_java ALL DEPENDS ${lcm_out}/twinrate.jar)
install(FILES ${lcm_out}/twinrate.jar DESTINATION ${CMAKE_INSTALL_DATADIR}/twinrate/lcmtypes)
