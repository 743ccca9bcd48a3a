// twinrate: runs a verb, prints an error in one line.
#include <algorithm>
#include <string_view>

#include "core/report_error.hpp"
#include "tools/large_pages.hpp"
#include "tools/run_verb.hpp"

namespace {

// Verbs that compute with long signals.
constexpr std::string_view kLongSignals[] = {"import", "report", "trace", "tune"};

}  // namespace

int main(int argc, char** argv) {
  if (argc > 1 && std::ranges::count(kLongSignals, argv[1])) twinrate::use_large_pages();
  try {
    twinrate::expect_utf8(argc, argv);
    return twinrate::finish_output("twinrate", twinrate::run_verb(argc, argv));
  } catch (...) {
    return twinrate::report_error("twinrate");
  }
}
