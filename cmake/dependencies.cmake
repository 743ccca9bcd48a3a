# Debian 12 packages; tools/packages.txt lists their names. First those of a simulated drive.
find_package(Eigen3 3.4 REQUIRED)
find_package(fmt REQUIRED)
find_package(tomlplusplus REQUIRED)
find_package(nlohmann_json REQUIRED)
find_package(Threads REQUIRED)

# LCM 1.3.1 has no CMake package, and its pkg-config file needs GLib's development files.
find_path(LCM_INCLUDE_DIR lcm/lcm-cpp.hpp REQUIRED)
find_library(LCM_LIBRARY lcm REQUIRED)
find_program(LCM_GEN lcm-gen REQUIRED)
add_library(lcm::lcm INTERFACE IMPORTED)
target_include_directories(lcm::lcm SYSTEM INTERFACE ${LCM_INCLUDE_DIR})
target_link_libraries(lcm::lcm INTERFACE ${LCM_LIBRARY})

find_path(SODIUM_INCLUDE_DIR sodium.h REQUIRED)
find_library(SODIUM_LIBRARY sodium REQUIRED)
add_library(sodium::sodium INTERFACE IMPORTED)
target_include_directories(sodium::sodium SYSTEM INTERFACE ${SODIUM_INCLUDE_DIR})
target_link_libraries(sodium::sodium INTERFACE ${SODIUM_LIBRARY})

find_path(CLI11_INCLUDE_DIR CLI/CLI.hpp REQUIRED)
add_library(cli11::cli11 INTERFACE IMPORTED)
target_include_directories(cli11::cli11 SYSTEM INTERFACE ${CLI11_INCLUDE_DIR})
if(TWINRATE_VERBS STREQUAL "SIMULATED")
  return()
endif()

find_package(SUNDIALS 6.4 REQUIRED COMPONENTS arkode cvode nvecserial)
find_package(ZLIB REQUIRED)

# Ceres's CMake package needs the development files of every optional solver.
find_path(CERES_INCLUDE_DIR ceres/ceres.h REQUIRED)
find_library(CERES_LIBRARY ceres REQUIRED)
find_library(GLOG_LIBRARY glog REQUIRED)
add_library(ceres::ceres INTERFACE IMPORTED)
target_include_directories(ceres::ceres SYSTEM INTERFACE ${CERES_INCLUDE_DIR})
target_link_libraries(ceres::ceres INTERFACE ${CERES_LIBRARY} ${GLOG_LIBRARY})

find_path(MATIO_INCLUDE_DIR matio.h REQUIRED)
find_library(MATIO_LIBRARY matio REQUIRED)
add_library(matio::matio INTERFACE IMPORTED)
target_include_directories(matio::matio SYSTEM INTERFACE ${MATIO_INCLUDE_DIR})
target_link_libraries(matio::matio INTERFACE ${MATIO_LIBRARY})

find_path(ZSTD_INCLUDE_DIR zstd.h REQUIRED)
find_library(ZSTD_LIBRARY zstd REQUIRED)
add_library(zstd::zstd INTERFACE IMPORTED)
target_include_directories(zstd::zstd SYSTEM INTERFACE ${ZSTD_INCLUDE_DIR})
target_link_libraries(zstd::zstd INTERFACE ${ZSTD_LIBRARY})

find_path(LZ4_INCLUDE_DIR lz4frame.h REQUIRED)
find_library(LZ4_LIBRARY lz4 REQUIRED)
add_library(lz4::lz4 INTERFACE IMPORTED)
target_include_directories(lz4::lz4 SYSTEM INTERFACE ${LZ4_INCLUDE_DIR})
target_link_libraries(lz4::lz4 INTERFACE ${LZ4_LIBRARY})

# Its CMake package names targets of OpenSSL that need another package.
find_path(LIBWEBSOCKETS_INCLUDE_DIR libwebsockets.h REQUIRED)
find_library(LIBWEBSOCKETS_LIBRARY websockets REQUIRED)
add_library(libwebsockets INTERFACE IMPORTED)
target_include_directories(libwebsockets SYSTEM INTERFACE ${LIBWEBSOCKETS_INCLUDE_DIR})
target_link_libraries(libwebsockets INTERFACE ${LIBWEBSOCKETS_LIBRARY})

# Debian's library is compiled with these three; its header must see the same.
find_path(CPPHTTPLIB_INCLUDE_DIR httplib.h REQUIRED)
find_library(CPPHTTPLIB_LIBRARY cpp-httplib REQUIRED)
add_library(cpphttplib INTERFACE IMPORTED)
target_include_directories(cpphttplib SYSTEM INTERFACE ${CPPHTTPLIB_INCLUDE_DIR})
target_compile_definitions(cpphttplib INTERFACE CPPHTTPLIB_OPENSSL_SUPPORT CPPHTTPLIB_ZLIB_SUPPORT
                                                CPPHTTPLIB_BROTLI_SUPPORT)
target_link_libraries(cpphttplib INTERFACE ${CPPHTTPLIB_LIBRARY})
