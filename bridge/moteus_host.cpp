#include "bridge/moteus_host.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/reason.hpp"
#include "model/frames.hpp"

namespace twinrate {
namespace {

Bytes bytes_of(const std::string& text) {
  return {text.begin(), text.end()};
}

template <class Queue>
std::optional<DriveSample> taken(Queue& samples) {
  if (samples.empty()) return {};
  DriveSample sample = samples.front();
  samples.pop_front();
  return sample;
}

double replied(const MoteusFrame& frame, int reg) {
  const auto found = frame.replies.find(reg);
  return found == frame.replies.end() ? std::numeric_limits<double>::quiet_NaN() : found->second;
}

}  // namespace

Bytes MoteusHost::sent(Bytes frame) const {
  pad_moteus(frame);
  return bytes_of(can_line("can send", 0x8000 | bridge_.moteus_id, frame) + "\n");
}

void MoteusHost::put_query(Bytes& frame) const {
  put_moteus_read(frame, kMoteusMode, 6);
  put_moteus_read(frame, kMoteusVoltage, 1);
  put_moteus_read(frame, kMoteusFault, 1);
  put_moteus_read(frame, kMoteusPhaseA, 3);
  put_moteus_read(frame, kMoteusMillisecond, 1);
}

Bytes MoteusHost::hello(bool) {
  Bytes frame;
  put_query(frame);
  return sent(frame);
}

// One question at a time.
Bytes MoteusHost::poll(std::int64_t now_ns) {
  if (!info_ || now_ns < next_poll_ns_ || !trips_.may_ask(now_ns)) return {};
  return hello(false);
}

Bytes MoteusHost::command(const DriveCommand& c) {
  Bytes frame;
  const float timeout_s = static_cast<float>(1e-6 * c.lease_us);
  if (bridge_.moteus_control == MoteusControl::kVoltage) {
    const Vec2 u_dq = park(c.command.u_alphabeta_ref, theta_e_);
    put_moteus_write_int8(frame, kMoteusMode, kMoteusModeVoltageDq);
    put_moteus_write(frame, kMoteusCommandDVoltage,
                     std::array{static_cast<float>(u_dq[0]), static_cast<float>(u_dq[1])});
  } else {
    const MachineParameters& m = drive_.machine;
    const auto torque = static_cast<float>(1.5 * m.n_p * m.psi_f * c.command.i_dq_ref[1]);
    constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
    put_moteus_write_int8(frame, kMoteusMode, kMoteusModePosition);
    // position NaN: none; speed 0; torque; gains scaled to 0
    put_moteus_write(frame, kMoteusCommandPosition, std::array{kNan, 0.f, torque, 0.f, 0.f});
    put_moteus_write(frame, kMoteusTimeout, std::array{timeout_s});
  }
  put_query(frame);
  return sent(frame);
}

Bytes MoteusHost::off() {
  Bytes frame;
  put_moteus_write_int8(frame, kMoteusMode, kMoteusStopped);
  put_query(frame);
  return sent(frame);
}

// A moteus leaves its fault in mode stopped.
Bytes MoteusHost::clear(int) {
  return off();
}

void MoteusHost::take(std::span<const std::uint8_t> bytes, std::int64_t arrival_ns) {
  for (const std::uint8_t byte : bytes) {
    if (byte == '\n' || byte == '\r') {
      if (!line_.empty()) take_line(line_, arrival_ns);
      line_.clear();
    } else if (line_.size() < kMaxLine) {
      line_.push_back(static_cast<char>(byte));
    }
  }
}

void MoteusHost::take_line(const std::string& line, std::int64_t arrival_ns) {
  if (line == "OK" || line.starts_with("OK ")) return;
  const auto can = parse_can_line(line, "rcv");
  const MoteusFrame frame = can ? parse_moteus(can->bytes) : MoteusFrame{.bad = true};
  if (frame.bad) {
    ++counts_.damaged;
    return;
  }
  if (can->id >> 8 != bridge_.moteus_id) return;  // of another drive on the bus
  ++counts_.frames;
  if (frame.replies.count(kMoteusMillisecond)) take_reply(frame, arrival_ns);
}

// Host seconds in a second of the drive. Crystals differ by less than kCrystals, and the counter of
// milliseconds does not show by how much; more is the pace of an emulated drive.
double MoteusHost::host_per_drive() const {
  constexpr double kCrystals = 0.01;
  return std::abs(clock_.drift()) > kCrystals ? 1 + clock_.drift() : 1;
}

bool MoteusHost::time_sample(DriveSample& s, const std::optional<RoundTrips::Moment>& trip) {
  if (clock_.blocks() < kTimedFrom) return false;
  const double T_us = 1e6 * drive_.T_s(), host_ns_per_us = 1e3 * host_per_drive();
  if (!trip || trip->within_ns > std::max(kLoose * T_us * host_ns_per_us, kTail * trip->usual_ns)) {
    ++counts_.untimed;
    return false;
  }
  if (counts_.timed > 0)
    sampled_us_ += static_cast<double>(trip->read_ns - last_read_ns_) / host_ns_per_us;
  last_read_ns_ = trip->read_ns;
  s.sampled_us = sampled_us_;
  const double to_next_us = (std::round(sampled_us_ / T_us) + 1) * T_us - sampled_us_;
  next_poll_ns_ = trip->read_ns + std::llround(host_ns_per_us * to_next_us) - trips_.half_ns();
  ++counts_.timed;
  counts_.within_us += trip->within_ns / host_ns_per_us;
  counts_.within_us_most = std::max(counts_.within_us_most, trip->within_ns / host_ns_per_us);
  return true;
}

// The counter without its wraps. A step back is a restart of the drive; ticks go on.
std::int64_t MoteusHost::counted_us(std::uint32_t us, std::int64_t read_ns) {
  const std::int64_t before_us = last_us_;
  last_us_ = clock_.take(us, read_ns);
  if (last_us_ >= before_us) return last_us_;
  ++counts_.resets;
  clock_.restart();
  k_before_restart_ = k_ + 1;
  return last_us_ = clock_.take(us, read_ns);
}

void MoteusHost::take_reply(const MoteusFrame& frame, std::int64_t arrival_ns) {
  const double ms = replied(frame, kMoteusMillisecond), mode_read = replied(frame, kMoteusMode);
  if (!(ms >= 0 && ms < 4e12) || !(std::abs(mode_read) < 128)) {
    ++counts_.damaged;
    return;
  }
  info_ = info_in(static_cast<int>(mode_read));
  const auto us = static_cast<std::uint32_t>(static_cast<std::uint64_t>(1e3 * ms));  // modulo 2^32
  DriveSample s;
  const auto trip = trips_.answered(arrival_ns);
  s.time_us = counted_us(us, times_samples() && trip ? trip->read_ns : arrival_ns);
  s.arrival_ns = arrival_ns;
  s.reason = info_->reason;
  s.off = s.reason != 0;
  Measurement& m = s.m;
  if (times_samples()) {
    if (!time_sample(s, trip)) return;
    m.k = std::llround(1e-6 * *s.sampled_us * drive_.rates.f_s_Hz);
  } else {
    m.k = k_before_restart_ +
          std::llround(1e-6 * static_cast<double>(s.time_us) * drive_.rates.f_s_Hz);
  }
  if (m.k <= k_) return;  // the same tick again
  take_values(frame, m);
  k_ = m.k;
  samples_.push_back(s);
}

DriveInfo MoteusHost::info_in(int mode) const {
  DriveInfo info{.name = "moteus",
                 .watchdog = bridge_.device_has_watchdog(),
                 .takes_voltage = bridge_.moteus_control == MoteusControl::kVoltage,
                 .reason = mode == kMoteusModeTimeout ? static_cast<int>(Reason::kCommandLost)
                           : mode == kMoteusModeFault ? static_cast<int>(Reason::kSafeRequested)
                                                      : 0};
  info.lease_max_ms = 1e3;
  return info;
}

void MoteusHost::take_values(const MoteusFrame& frame, Measurement& m) {
  const auto at = [&](int reg) { return replied(frame, reg); };
  m.theta_m = kTwoPi * at(kMoteusPosition) + bridge_.theta_e_offset / drive_.machine.n_p;
  m.omega_m = kTwoPi * at(kMoteusVelocity);
  theta_e_ = drive_.machine.n_p * m.theta_m;
  m.i_abc = inverse_clarke(inverse_park({at(kMoteusDCurrent), at(kMoteusQCurrent)}, theta_e_));
  const Vec2 u = clarke({at(kMoteusPhaseA), at(kMoteusPhaseA + 1), at(kMoteusPhaseA + 2)});
  m.u_alphabeta = mean_voltage_up_to(m.k, park(u, theta_e_));
  m.v_dc = at(kMoteusVoltage);
  m.signals = kPhaseCurrents | kVoltage | kBusVoltage | kPosition | kSpeed;
}

// Of [t_{k-1}, t_k], from the moments at both ends: in rotor axes their mean, turned by the angle in
// the middle; a vector that turns by phi over the interval has a mean shorter by sin(phi/2)/(phi/2).
// Of samples that are timed: since the sample before. After a longer gap: that of the moment alone.
Vec2 MoteusHost::mean_voltage_up_to(std::int64_t k, const Vec2& u_dq) {
  constexpr std::int64_t kLongest = 3;  // ticks
  const bool follows = k_ >= 0 && k - k_ <= (times_samples() ? kLongest : 1);
  const double phi = follows ? theta_e_ - theta_e_before_ : 0;
  const double share = std::abs(phi) < 1e-6 ? 1 : std::sin(phi / 2) / (phi / 2);
  const Vec2 mean = follows ? Vec2(share * 0.5 * (u_dq + u_dq_before_)) : u_dq;
  u_dq_before_ = u_dq;
  theta_e_before_ = theta_e_;
  return inverse_park(mean, theta_e_ - phi / 2);
}

std::optional<DriveSample> MoteusHost::next() {
  return taken(samples_);
}

Bytes MoteusBurst::hello(bool) {
  return {};
}

void MoteusBurst::take(std::span<const std::uint8_t> bytes, std::int64_t arrival_ns) {
  bytes_.insert(bytes_.end(), bytes.begin(), bytes.end());
  std::size_t at = 0;
  while (bytes_.size() - at > kFrame) {
    const bool framed = bytes_[at] == 0x5a && bytes_[at + kFrame] == 0x5a;
    if (!framed) {
      counts_.damaged += bytes_[at] == 0x5a;
      ++at;
      continue;
    }
    take_frame(&bytes_[at], arrival_ns);
    at += kFrame;
  }
  bytes_.erase(bytes_.begin(), bytes_.begin() + static_cast<std::ptrdiff_t>(at));
}

void MoteusBurst::take_frame(const std::uint8_t* frame, std::int64_t arrival_ns) {
  const auto word = [&](int i) { return static_cast<std::uint16_t>(frame[i] | frame[i + 1] << 8); };
  // The device cuts a current towards zero: it is half a step further from zero, in the mean.
  const auto amperes = [&](int i) {
    const auto steps = static_cast<std::int16_t>(word(i));
    const double centre = steps + 0.5 * ((steps > 0) - (steps < 0));
    return centre * (100.0 / 32767);
  };
  ++counts_.frames;
  info_ = DriveInfo{.name = "moteus debug UART", .f_s_Hz = drive_.rates.f_s_Hz};
  const double raw = word(1);
  if (raw_ >= 0) turns_ += std::remainder(raw - raw_, 65536.0) / 65536.0;
  if (raw_ < 0) turns_ = raw / 65536.0;
  raw_ = raw;
  DriveSample s;
  s.arrival_ns = arrival_ns;
  Measurement& m = s.m;
  m.k = ++k_;
  s.time_us = clock_.take(
      static_cast<std::uint32_t>(std::llround(1e6 * static_cast<double>(k_) * drive_.T_s())),
      arrival_ns);
  m.theta_m = kTwoPi * turns_ + bridge_.theta_e_offset / drive_.machine.n_p;
  m.i_abc = inverse_clarke(inverse_park({amperes(3), amperes(5)}, drive_.machine.n_p * m.theta_m));
  m.signals = kPhaseCurrents | kPosition;
  samples_.push_back(s);
}

std::optional<DriveSample> MoteusBurst::next() {
  return taken(samples_);
}

}  // namespace twinrate
