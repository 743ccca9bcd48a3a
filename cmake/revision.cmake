# cmake -DSOURCE_DIR=.. -DOUT=FILE -P revision.cmake: writes the revision of the tree as a C++ source. A file with this
# revision is not rewritten, so that nothing is compiled again.
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
