#include "bridge/vesc_host.hpp"

#include <cmath>
#include <cstring>

namespace twinrate {
namespace {

double int16_at(std::span<const std::uint8_t> p, std::size_t at) {
  return static_cast<std::int16_t>(p[at] << 8 | p[at + 1]);
}

// The VESC's own coding of a float equals the IEEE one for normal numbers.
double float_at(std::span<const std::uint8_t> p, std::size_t at) {
  const std::uint32_t bits = static_cast<std::uint32_t>(p[at]) << 24 |
                             static_cast<std::uint32_t>(p[at + 1]) << 16 |
                             static_cast<std::uint32_t>(p[at + 2]) << 8 | p[at + 3];
  float x = 0;
  std::memcpy(&x, &bits, 4);
  return static_cast<double>(x);
}

}  // namespace

std::uint16_t vesc_crc(std::span<const std::uint8_t> payload) {
  std::uint16_t crc = 0;
  for (const std::uint8_t byte : payload) {
    crc = static_cast<std::uint16_t>(crc ^ byte << 8);
    for (int bit = 0; bit < 8; ++bit)
      crc = static_cast<std::uint16_t>(crc & 0x8000 ? crc << 1 ^ 0x1021 : crc << 1);
  }
  return crc;
}

Bytes vesc_frame(std::span<const std::uint8_t> payload) {
  Bytes frame;
  if (payload.size() < 256) {
    frame = {2, static_cast<std::uint8_t>(payload.size())};
  } else {
    frame = {3, static_cast<std::uint8_t>(payload.size() >> 8),
             static_cast<std::uint8_t>(payload.size())};
  }
  frame.insert(frame.end(), payload.begin(), payload.end());
  const std::uint16_t crc = vesc_crc(payload);
  frame.insert(frame.end(),
               {static_cast<std::uint8_t>(crc >> 8), static_cast<std::uint8_t>(crc), 3});
  return frame;
}

// Bytes that begin no frame are skipped one by one; a frame that fails its CRC too.
bool VescReceiver::next() {
  std::size_t at = 0;
  bool found = false, waits = false;
  while (!found && !waits && at < bytes_.size()) {
    const std::size_t left = bytes_.size() - at, head = bytes_[at] == 3 ? 3 : 2;
    if (bytes_[at] != 2 && bytes_[at] != 3) {
      ++at;
      continue;
    }
    if (left < head) break;
    const std::size_t size =
        head == 2 ? bytes_[at + 1] : static_cast<std::size_t>(bytes_[at + 1] << 8 | bytes_[at + 2]);
    if (size == 0 || size > kMaxPayload) {
      ++at;
      continue;
    }
    waits = left < head + size + 3;
    if (waits) break;
    const std::span<const std::uint8_t> payload(&bytes_[at + head], size);
    const std::uint8_t* end = payload.data() + size;
    found = end[2] == 3 && vesc_crc(payload) == (end[0] << 8 | end[1]);
    if (found) {
      payload_.assign(payload.begin(), payload.end());
      at += head + size + 3;
    } else {
      ++damaged_;
      ++at;
    }
  }
  bytes_.erase(bytes_.begin(), bytes_.begin() + static_cast<std::ptrdiff_t>(at));
  return found;
}

Bytes VescHost::hello(bool) {
  return vesc_frame(Bytes{kGetValues});
}

// The next burst when the one before is whole, or has stopped.
Bytes VescHost::poll(std::int64_t now_ns) {
  constexpr std::int64_t kQuiet_ns = 2'000'000'000;
  if (!info_ || (left_ > 0 && now_ns - heard_ns_ < kQuiet_ns)) return {};
  if (left_ > 0) counts_.lost += left_;
  heard_ns_ = now_ns;
  left_ = kBurst;
  k_ += k_ < 0 ? 0 : kGap;
  const Bytes payload = {kSamplePrint, 1, kBurst >> 8, kBurst & 0xff, 1, 0};
  return vesc_frame(payload);
}

void VescHost::take(std::span<const std::uint8_t> bytes, std::int64_t arrival_ns) {
  receiver_.receive(bytes, [&](std::span<const std::uint8_t> p) { take_payload(p, arrival_ns); });
  counts_.damaged = receiver_.damaged();
}

void VescHost::take_payload(std::span<const std::uint8_t> p, std::int64_t arrival_ns) {
  constexpr std::size_t kBusAt = 27;  // id, 2 temperatures, 4 currents, duty, speed
  ++counts_.frames;
  if (p[0] == kGetValues && p.size() >= kBusAt + 2) {
    v_dc_ = 0.1 * int16_at(p, kBusAt);
    info_ = DriveInfo{.name = "VESC"};
  }
  if (p[0] == kSamplePrint && (p.size() == 39 || p.size() == 35) && left_ > 0)
    take_sample(p, arrival_ns);
}

void VescHost::take_sample(std::span<const std::uint8_t> p, std::int64_t arrival_ns) {
  --left_;
  heard_ns_ = arrival_ns;
  const std::size_t currents = p.size() == 39 ? 3 : 2, u_at = 1 + 4 * currents;
  const double i_1 = float_at(p, 1), i_2 = float_at(p, 5);
  DriveSample s;
  s.arrival_ns = arrival_ns;
  Measurement& m = s.m;
  m.k = ++k_;
  s.time_us = std::llround(1e6 * static_cast<double>(k_) * drive_.T_s());
  m.i_abc = {i_1, i_2, currents == 3 ? float_at(p, 9) : -i_1 - i_2};
  m.u_alphabeta = clarke({float_at(p, u_at), float_at(p, u_at + 4), float_at(p, u_at + 8)});
  const double angle = p[p.size() - 1];
  if (angle_ < 0) theta_e_ = kTwoPi * angle / kAngleSteps;
  if (angle_ >= 0) theta_e_ += kTwoPi / kAngleSteps * std::remainder(angle - angle_, kAngleSteps);
  angle_ = angle;
  m.theta_m = (theta_e_ + bridge_.theta_e_offset) / drive_.machine.n_p;
  m.v_dc = v_dc_;
  m.signals = kPhaseCurrents | kVoltage | kBusVoltage | kPosition;
  samples_.push_back(s);
}

std::optional<DriveSample> VescHost::next() {
  if (samples_.empty()) return {};
  DriveSample sample = samples_.front();
  samples_.pop_front();
  return sample;
}

}  // namespace twinrate
