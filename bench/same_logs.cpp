// Whether run directories hold the same messages at every tick, bit for bit, but for session, host_ns
// and tag.
//
//   same_logs RUN_DIR RUN_DIR..       exit code 1 if one differs from the first
#include <fmt/format.h>

#include "bench/log_digest.hpp"

int main(int argc, char** argv) {
  using namespace twinrate;
  if (argc < 3) {
    fmt::print(stderr, "same_logs RUN_DIR RUN_DIR..\n");
    return 2;
  }
  try {
    const LogDigest first = digest_of(argv[1]);
    bool same = true;
    for (int i = 2; i < argc; ++i) {
      const LogDigest other = digest_of(argv[i]);
      fmt::print("{}: {} ticks, {}\n", argv[i], other.count.front(),
                 other == first ? "bit for bit" : "different");
      same = same && other == first;
    }
    return same ? 0 : 1;
  } catch (const BadInput& problem) {
    fmt::print(stderr, "same_logs: {}\n", problem.what());
    return 2;
  }
}
