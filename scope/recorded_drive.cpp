#include "scope/recorded_drive.hpp"

#include "core/event_log.hpp"

namespace twinrate::scope {

std::string load_log(const std::string& path, Recording& recording,
                     std::atomic<double>* share_read) {
  EventLog log(path, OnDamage::kSkip);
  std::int64_t events = 0;
  while (const lcm::LogEvent* event = log.next()) {
    if (share_read && ++events % 1024 == 0) *share_read = log.share_read();
    if (!log.channel()) continue;
    const auto* bytes = static_cast<const std::uint8_t*>(event->data);
    const auto size = static_cast<std::size_t>(event->datalen);
    if (const auto header = read_header(bytes, size))
      recording.take(*log.channel(), bytes, size, *header, event->timestamp);
  }
  if (share_read) *share_read = 1;
  return log.damage();
}

}  // namespace twinrate::scope
