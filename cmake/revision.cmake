# cmake -DSOURCE_DIR=.. -DOUT=FILE -P revision.cmake: writes the revision that the tree stands at as a C++ source. The
# file stays untouched where it says so already, so that nothing is compiled again.
set(revision "unknown")
find_package(Git QUIET)
if(GIT_FOUND)
  execute_process(COMMAND ${GIT_EXECUTABLE} describe --always --dirty --abbrev=12
                  WORKING_DIRECTORY ${SOURCE_DIR}
                  OUTPUT_VARIABLE described OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET
                  RESULT_VARIABLE failed)
  if(NOT failed AND described)
    set(revision "${described}")
  endif()
endif()
file(CONFIGURE OUTPUT ${OUT} CONTENT [[
#include "core/paths.hpp"

namespace twinrate {

std::string revision() {
  return "@revision@";
}

}  // namespace twinrate
]] @ONLY)
