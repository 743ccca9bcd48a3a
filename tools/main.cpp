// twinrate: runs a verb, prints an error in one line.
#include "core/report_error.hpp"
#include "tools/run_verb.hpp"

int main(int argc, char** argv) {
  try {
    twinrate::expect_utf8(argc, argv);
    return twinrate::finish_output("twinrate", twinrate::run_verb(argc, argv));
  } catch (...) {
    return twinrate::report_error("twinrate");
  }
}
