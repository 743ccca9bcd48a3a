#include "emulator/faulty_line.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace twinrate {
namespace {

std::int64_t to_ns(double s) {
  return std::llround(1e9 * std::min(s, 9e9));
}

}  // namespace

bool FaultyLine::happens(double share) {
  if (share <= 0) return false;
  const bool by_chance = std::uniform_real_distribution<>(0, 1)(random_) < share;
  if (!by_chance && !std::exchange(now_, false)) return false;
  ++made_;
  return true;
}

bool FaultyLine::pulled(std::int64_t t_ns) const {
  const std::int64_t since = t_ns - to_ns(faults_.pulled_at_s);
  return since >= 0 && since < to_ns(faults_.pulled_for_s);
}

void FaultyLine::send(std::span<const std::uint8_t> bytes, std::int64_t t_ns) {
  if (bytes.empty()) return;
  Frame frame(bytes.begin(), bytes.end());
  const bool faulty = t_ns >= to_ns(faults_.from_s);
  if (pulled(t_ns) || (faulty && happens(faults_.lost))) return;
  if (faulty && faults_.bit_errors > 0) {
    for (std::size_t bit = 0; bit < 8 * frame.size(); ++bit)
      if (std::uniform_real_distribution<>(0, 1)(random_) < faults_.bit_errors)
        frame[bit / 8] = static_cast<std::uint8_t>(frame[bit / 8] ^ (1u << bit % 8)), ++made_;
    if (std::exchange(now_, false)) frame[random_() % frame.size()] ^= 0x10, ++made_;
  }
  if (faulty && held_.empty() && happens(faults_.reordered)) {
    held_ = std::move(frame);
    return;
  }
  const bool twice = faulty && happens(faults_.doubled);
  put(frame, t_ns);
  if (twice) put(std::move(frame), t_ns);
  if (!held_.empty()) put(std::exchange(held_, {}), t_ns);
}

void FaultyLine::put(Frame frame, std::int64_t t_ns) {
  std::int64_t leaves = std::max(t_ns, busy_until_ns_);
  if (faults_.baud > 0) {
    const double byte_ns = 1e10 / faults_.baud;
    const auto size = static_cast<double>(frame.size());
    if (!faults_.waits && static_cast<double>(leaves - t_ns) + byte_ns * size > byte_ns * kBuffer)
      return;
    leaves += std::llround(byte_ns * size);
  }
  busy_until_ns_ = leaves;
  double late = faults_.latency_s;
  if (faults_.jitter_s > 0) late += std::uniform_real_distribution<>(0, faults_.jitter_s)(random_);
  last_arrival_ns_ = std::max(last_arrival_ns_, leaves + to_ns(late));
  on_the_way_.push_back({last_arrival_ns_, std::move(frame)});
}

std::int64_t FaultyLine::next_arrival() const {
  return on_the_way_.empty() ? INT64_MAX : on_the_way_.front().arrival_ns;
}

std::vector<std::uint8_t> FaultyLine::receive(std::int64_t t_ns) {
  std::vector<std::uint8_t> bytes;
  while (!on_the_way_.empty() && on_the_way_.front().arrival_ns <= t_ns) {
    const OnTheWay& first = on_the_way_.front();
    if (!pulled(first.arrival_ns))
      bytes.insert(bytes.end(), first.frame.begin(), first.frame.end());
    on_the_way_.pop_front();
  }
  return bytes;
}

}  // namespace twinrate
