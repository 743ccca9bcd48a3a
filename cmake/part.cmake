# twinrate_part(NAME USER SOURCES .. LINK ..): the sources as a shared object of their own, which the library USER loads at
# its first use (core/load_part.hpp), with the libraries that nothing else needs. It uses no code of other targets, so it
# is linked with none.
function(twinrate_part name user)
  cmake_parse_arguments(PARSE_ARGV 2 part "" "" "SOURCES;LINK")
  set(target twinrate_part_${name})
  add_library(${target} MODULE ${part_SOURCES})
  target_link_libraries(${target} PRIVATE twinrate_options ${part_LINK})
  target_link_options(${target} PRIVATE LINKER:--as-needed)
  # The compiler's own libraries follow, all of them: a part that only hands over functions of its library calls none of
  # libc, but Debian's policy asks for libc in every shared object.
  target_link_libraries(${target} PRIVATE -Wl,--no-as-needed)
  if(NOT TWINRATE_SANITIZE)  # the program has the functions of the sanitizers
    target_link_options(${target} PRIVATE LINKER:--no-undefined)
  endif()
  set_target_properties(${target} PROPERTIES PREFIX twinrate- OUTPUT_NAME ${name} CXX_VISIBILITY_PRESET hidden
                        VISIBILITY_INLINES_HIDDEN ON LIBRARY_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/parts)
  set_source_files_properties(${part_SOURCES} PROPERTIES SKIP_PRECOMPILE_HEADERS ON)
  # Two levels below lib: CPack takes lib/NAME for a directory of ldconfig.
  install(TARGETS ${target} LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}/twinrate/parts)
  add_dependencies(${user} ${target})
endfunction()
