// The page in a browser: tests/scope/page_test.mjs drives it.
#include <gtest/gtest.h>

#include "tests/system/run_program.hpp"

namespace twinrate::test {
namespace {

using ScopePage = ProgramTest;

bool found(const std::string& program) {
  return run_program({"sh", "-c", "command -v " + program}).exit_code == 0;
}

TEST_F(ScopePage, DoesWhatAPersonAsksOfIt) {
  for (const char* program : {"chromium", "node"})
    if (!found(program)) GTEST_SKIP() << program << " is not installed: the page was not opened";
  const ProgramResult result =
      run_program({"node", TWINRATE_SOURCE_DIR "/tests/scope/page_test.mjs", TWINRATE_PROGRAM,
                   path("pictures")},
                  420);
  EXPECT_EQ(result.exit_code, 0) << result.out << result.err;
}

}  // namespace
}  // namespace twinrate::test
