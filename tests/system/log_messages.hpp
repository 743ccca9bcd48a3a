// The tick messages of a log as bytes, for comparing two runs bit for bit.
#pragma once
#include <gtest/gtest.h>

#include <cstdint>
#include <string>
#include <vector>

namespace twinrate::test {

struct LoggedMessage {
  std::string channel;  // without the channel suffix
  std::int64_t seq;
  std::vector<std::uint8_t> bytes;  // session set to 0: two runs differ in it
  bool operator==(const LoggedMessage&) const = default;
};

// MEASUREMENT, TRUTH, ESTIMATE, GAIN, REFERENCE and COMMAND of every part of a run's log, in the
// order of the log.
std::vector<LoggedMessage> tick_messages(const std::string& run_directory);

// Equal message by message, order included, and of `ticks` ticks; names the first difference.
::testing::AssertionResult same_messages(const std::string& run_a, const std::string& run_b,
                                         int ticks);

}  // namespace twinrate::test
