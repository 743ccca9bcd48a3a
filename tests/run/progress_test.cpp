// The live line of a run and who reads it.
#include "run/progress.hpp"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <string>
#include <thread>

#include "tests/support/drives.hpp"

namespace twinrate::progress_test {
namespace {

// A pipe in the place of the standard output, with `free_bytes` left in it.
class Pipe {
 public:
  explicit Pipe(std::size_t free_bytes) {
    std::fflush(stdout);
    EXPECT_EQ(pipe2(ends_.data(), O_NONBLOCK), 0);
    const std::string blanks(4096, ' ');
    std::size_t held = 0;
    for (ssize_t n = 0; (n = write(ends_[1], blanks.data(), blanks.size())) > 0;)
      held += static_cast<std::size_t>(n);
    std::string freed(free_bytes, ' ');
    EXPECT_LE(free_bytes, held);
    if (free_bytes > 0) {
      EXPECT_EQ(read(ends_[0], freed.data(), free_bytes), static_cast<ssize_t>(free_bytes));
    }
    fcntl(ends_[1], F_SETFL, 0);  // a write waits
    stdout_ = dup(STDOUT_FILENO);
    dup2(ends_[1], STDOUT_FILENO);
  }
  ~Pipe() {
    dup2(stdout_, STDOUT_FILENO);
    for (const int end : {stdout_, ends_[0], ends_[1]}) close(end);
  }
  Pipe(const Pipe&) = delete;
  Pipe& operator=(const Pipe&) = delete;
  // What was written after the blanks.
  std::string text() const {
    std::string all, part(65536, '\0');
    for (ssize_t n = 0; (n = read(ends_[0], part.data(), part.size())) > 0;)
      all.append(part, 0, static_cast<std::size_t>(n));
    return all.substr(std::min(all.size(), all.find_first_not_of(' ')));
  }

 private:
  std::array<int, 2> ends_{};
  int stdout_ = -1;
};

std::string shown(std::size_t free_bytes) {
  const Pipe pipe(free_bytes);
  Progress progress(test::drive_of("dilys2021"), true);
  std::this_thread::sleep_for(std::chrono::milliseconds(210));  // a line each 0.2 s
  for (int i = 0; i < 256; ++i) progress.show({}, {}, {});
  return pipe.text();
}

// The supervisor of a drive prints it: one that waits for its reader sends no heartbeat.
TEST(Progress, LeavesALineOutWhereTheReaderHasNoRoomForIt) {
  alarm(10);  // a write to a full pipe never returns
  EXPECT_EQ(shown(0), "");
  alarm(0);
  EXPECT_NE(shown(8192).find("\"steps_per_s\""), std::string::npos);
}

}  // namespace
}  // namespace twinrate::progress_test
