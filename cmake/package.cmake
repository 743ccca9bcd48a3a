# tools/package: the Debian package twinrate_VERSION_ARCH.deb, by CPack. It installs into /usr and needs no compiler.
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME twinrate)
set(CPACK_PACKAGE_CONTACT "The Twinrate authors <maintainers@users.noreply.github.com>")
set(CPACK_DEBIAN_PACKAGE_DESCRIPTION
"PMSM drives with a two-rate Kalman filter over LCM
Runs a sensorless drive with an extended Kalman filter whose gain is computed
in the background, as processes over LCM or in one process. Records and
replays runs, finds the slowest gain update rate that keeps synchronism,
and traces the physical effects that a model lacks in a measured log.")
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_DEPENDS "iproute2")
if(TWINRATE_PYTHON)
  string(APPEND CPACK_DEBIAN_PACKAGE_DEPENDS ", python3 (>= 3.11), python3 (<< 3.12), python3-numpy")
endif()
set(CPACK_DEBIAN_PACKAGE_SUGGESTS
    "g++, cmake, liblcm-dev, libeigen3-dev, libfmt-dev, libtomlplusplus-dev, nlohmann-json3-dev, python3-pandas")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
include(CPack)

# What the policy of Debian asks of every package.
set(changelog ${CMAKE_BINARY_DIR}/debian/changelog)
file(CONFIGURE OUTPUT ${changelog} CONTENT
"twinrate (${PROJECT_VERSION}) unstable; urgency=low

  * Built from the source tree; its history is that of git.

 -- ${CPACK_PACKAGE_CONTACT}  Tue, 24 Nov 2026 00:00:00 +0000
")
install(FILES cmake/debian/copyright DESTINATION ${CMAKE_INSTALL_DOCDIR})
install(CODE "execute_process(COMMAND gzip -9nc ${changelog} OUTPUT_FILE ${changelog}.gz COMMAND_ERROR_IS_FATAL ANY)")
install(FILES ${changelog}.gz DESTINATION ${CMAKE_INSTALL_DOCDIR})
