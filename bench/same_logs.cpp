// Whether run directories hold the same messages at every tick, bit for bit, but for session, host_ns
// and tag.
//
//   same_logs RUN_DIR RUN_DIR..       exit code 1 if one differs from the first
#include <fmt/format.h>

#include "bench/log_digest.hpp"
#include "core/report_error.hpp"

int main(int argc, char** argv) try {
  using namespace twinrate;
  if (argc < 3) {
    fmt::print(stderr, "same_logs RUN_DIR RUN_DIR..\n");
    return 2;
  }
  const LogDigest first = digest_of(argv[1]);
  bool same = true;
  for (int i = 2; i < argc; ++i) {
    const LogDigest other = digest_of(argv[i]);
    fmt::print("{}: {} ticks, {}\n", argv[i], other.count.front(),
               other == first ? "bit for bit" : "different");
    same = same && other == first;
  }
  return same ? 0 : 1;
} catch (...) {
  return twinrate::report_error("same_logs");
}
