// The tick messages of a log as bytes, for comparing two runs bit for bit.
#pragma once
#include <gtest/gtest.h>

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "core/channels.hpp"

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

// Drive time of the heartbeats in a run's log, s, by role.
std::map<Role, std::vector<double>> heartbeats(const std::string& run_directory);

}  // namespace twinrate::test
