#include "tests/system/log_messages.hpp"

#include <algorithm>
#include <lcm/lcm-cpp.hpp>

#include "core/channels.hpp"
#include "core/event_log.hpp"
#include "core/run_log.hpp"

namespace twinrate::test {
namespace {

std::int64_t seq_of(const std::uint8_t* bytes) {
  std::uint64_t seq = 0;
  for (int i = 8; i < 16; ++i) seq = seq << 8 | bytes[i];
  return static_cast<std::int64_t>(seq);
}

const char* tick_channel(const std::string& name) {
  for (const ChannelInfo& channel : kChannels)
    if (channel.channel < Channel::kStatus && name.rfind(channel.name, 0) == 0) return channel.name;
  return nullptr;
}

}  // namespace

std::vector<LoggedMessage> tick_messages(const std::string& run_directory) {
  std::vector<LoggedMessage> messages;
  for (const std::string& part : log_parts(run_directory)) {
    lcm::LogFile file(part, "r");
    while (const lcm::LogEvent* event = file.readNextEvent()) {
      const char* channel = tick_channel(event->channel);
      if (!channel || event->datalen < 32) continue;
      const auto* bytes = static_cast<const std::uint8_t*>(event->data);
      messages.push_back({channel, seq_of(bytes), {bytes, bytes + event->datalen}});
      // Session, time on the host and tag are of the run, not of the drive.
      std::fill_n(messages.back().bytes.begin() + 24, 8, std::uint8_t{0});
      std::fill_n(messages.back().bytes.end() - 16, 16, std::uint8_t{0});
    }
  }
  return messages;
}

std::map<Role, std::vector<double>> heartbeats(const std::string& run_directory) {
  std::map<Role, std::vector<double>> beats;
  EventLog log(run_directory, OnDamage::kSkip);
  while (const lcm::LogEvent* event = log.next()) {
    status_t status{};
    if (log.channel() == Channel::kStatus && status.decode(event->data, 0, event->datalen) > 0)
      beats[static_cast<Role>(status.role)].push_back(1e-6 * static_cast<double>(event->timestamp));
  }
  return beats;
}

::testing::AssertionResult same_messages(const std::string& run_a, const std::string& run_b,
                                         int ticks) {
  const std::vector<LoggedMessage> a = tick_messages(run_a), b = tick_messages(run_b);
  for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i)
    if (a[i] != b[i])
      return ::testing::AssertionFailure()
             << "message " << i << " differs: " << a[i].channel << "(" << a[i].seq << ") in "
             << run_a << ", " << b[i].channel << "(" << b[i].seq << ") in " << run_b;
  if (a.size() != b.size())
    return ::testing::AssertionFailure()
           << a.size() << " messages in " << run_a << ", " << b.size() << " in " << run_b;
  const auto measurements = std::count_if(
      a.begin(), a.end(), [](const auto& m) { return m.channel == "DRIVE_MEASUREMENT"; });
  if (measurements != ticks)
    return ::testing::AssertionFailure()
           << measurements << " ticks in " << run_a << ", expected " << ticks;
  return ::testing::AssertionSuccess();
}

}  // namespace twinrate::test
