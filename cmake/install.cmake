# What `cmake --install` puts where: programs (bin/), presets, messages and documents (share/), and the CMake package
# twinrate with headers and libraries for own processes (docs/own-code.md).
#
#   find_package(twinrate)     twinrate::lcmtypes     the messages
#                              twinrate::model        the drive on paper
#                              twinrate::estimator    filters, and the frame of an own estimator
#                              twinrate::controller   controllers, and the frame of an own controller
include(CMakePackageConfigHelpers)
set(twinrate_data ${CMAKE_INSTALL_DATADIR}/twinrate)
set(twinrate_package ${CMAKE_INSTALL_LIBDIR}/cmake/twinrate)

install(DIRECTORY config/ DESTINATION ${twinrate_data}/config)
install(DIRECTORY lcmtypes/ DESTINATION ${twinrate_data}/lcmtypes)
install(FILES bench/results/instructions.json DESTINATION ${twinrate_data}/bench/results)
install(DIRECTORY tools/maps tools/new DESTINATION ${twinrate_data}/tools)
install(FILES README.md ARCHITECTURE.md DESTINATION ${CMAKE_INSTALL_DOCDIR})
install(DIRECTORY docs DESTINATION ${CMAKE_INSTALL_DOCDIR})
install(DIRECTORY examples DESTINATION ${CMAKE_INSTALL_DOCDIR} USE_SOURCE_PERMISSIONS)

set(twinrate_libraries lcmtypes options model core process estimator controller)
foreach(library ${twinrate_libraries})
  set_target_properties(twinrate_${library} PROPERTIES EXPORT_NAME ${library})
endforeach()
list(TRANSFORM twinrate_libraries PREPEND twinrate_ OUTPUT_VARIABLE targets)
install(TARGETS ${targets} EXPORT twinrate ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
install(DIRECTORY model core estimator controller DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/twinrate
        FILES_MATCHING PATTERN "*.hpp")
install(DIRECTORY ${CMAKE_BINARY_DIR}/lcmtypes/twinrate DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}
        FILES_MATCHING PATTERN "*.hpp")
install(EXPORT twinrate NAMESPACE twinrate:: FILE twinrateTargets.cmake DESTINATION ${twinrate_package})
install(FILES cmake/twinrateConfig.cmake DESTINATION ${twinrate_package})
write_basic_package_version_file(${CMAKE_BINARY_DIR}/twinrateConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_BINARY_DIR}/twinrateConfigVersion.cmake DESTINATION ${twinrate_package})

# Man pages of programs and verbs, and the completion of bash, as the programs print them.
set(pages ${CMAKE_BINARY_DIR}/pages)
set(man_pages)
foreach(process plant estimator gain controller logger monitor emulator)
  list(APPEND man_pages COMMAND twinrate-${process} --man-page > ${pages}/man1/twinrate-${process}.1)
endforeach()
add_custom_command(OUTPUT ${pages}/twinrate
  COMMAND ${CMAKE_COMMAND} -E rm -rf ${pages}
  COMMAND ${CMAKE_COMMAND} -E make_directory ${pages}/man1
  COMMAND twinrate pages --man ${pages}/man1
  ${man_pages}
  COMMAND gzip -9n ${pages}/man1/*.1
  COMMAND twinrate pages --bash-completion > ${pages}/twinrate
  DEPENDS twinrate twinrate-plant twinrate-estimator twinrate-gain twinrate-controller twinrate-logger twinrate-monitor twinrate-emulator
  COMMENT "man pages")
add_custom_target(twinrate_pages ALL DEPENDS ${pages}/twinrate)
install(DIRECTORY ${pages}/man1 DESTINATION ${CMAKE_INSTALL_MANDIR})
install(FILES ${pages}/twinrate DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions)

include(cmake/package.cmake)
