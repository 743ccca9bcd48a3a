#include "emulator/moteus_device.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "bridge/moteus_codec.hpp"

namespace twinrate {
namespace {

constexpr std::size_t kMaxLine = 512;
constexpr double kCurrentBandwidth = kTwoPi * 200;  // rad/s
constexpr double kDefaultTimeout_s = 0.1;

Vec2 currents_of(const Measurement& m, int n_p) {
  return park(clarke(m.i_abc), n_p * m.theta_m);
}

}  // namespace

void MoteusDevice::take(std::span<const std::uint8_t> bytes) {
  for (const std::uint8_t byte : bytes) {
    if (byte == '\n' || byte == '\r') {
      if (!line_.empty()) take_line(line_);
      line_.clear();
    } else if (line_.size() < kMaxLine) {
      line_.push_back(static_cast<char>(byte));
    }
  }
}

void MoteusDevice::take_line(const std::string& line) {
  const auto reply = [this](const std::string& text) {
    sent_.emplace_back(text.begin(), text.end());
  };
  const auto can = parse_can_line(line, "can send");
  if (!can) return reply("ERR unknown command\n");
  reply("OK\n");
  if ((can->id & 0x7f) != options_.moteus_id) return;
  const MoteusFrame frame = parse_moteus(can->bytes);
  if (frame.bad) return;
  heard_s_ = static_cast<double>(k_) * options_.T_s;
  if (const auto mode = frame.writes.find(kMoteusMode); mode != frame.writes.end())
    enter(static_cast<int>(mode->second));  // resets the command: before the values
  for (const auto& [reg, value] : frame.writes) write(reg, value);
  if (!(can->id & 0x8000) || frame.reads.empty()) return;
  Bytes answer;
  for (std::size_t i = 0; i < frame.reads.size();) {
    std::vector<float> values;
    const int first = frame.reads[i];
    while (i < frame.reads.size() && frame.reads[i] == first + static_cast<int>(values.size()))
      values.push_back(static_cast<float>(read(frame.reads[i++])));
    put_moteus_reply(answer, first, values);
  }
  pad_moteus(answer);
  reply(can_line("rcv", options_.moteus_id << 8 | (can->id >> 8 & 0x7f), answer) + " E B F\n");
}

void MoteusDevice::enter(int mode) {
  const bool latched = mode_ == kMoteusModeFault || mode_ == kMoteusModeTimeout;
  if (latched && mode != kMoteusStopped) return;  // only mode stopped ends it
  if (mode_ == kMoteusModeFault && !drive_.clear()) return;
  if (mode == kMoteusStopped && mode_ != kMoteusStopped) drive_.switch_off(Reason::kNone);
  if (mode != mode_) integral_.setZero();
  mode_ = mode;
  torque_ = 0;
  u_dq_.setZero();
  kp_scale_ = kd_scale_ = 1;
  timeout_s_ = kDefaultTimeout_s;
}

void MoteusDevice::write(int reg, double value) {
  switch (reg) {
    case kMoteusCommandTorque:
      torque_ = value;
      break;
    case kMoteusKpScale:
      kp_scale_ = value;
      break;
    case kMoteusKdScale:
      kd_scale_ = value;
      break;
    case kMoteusTimeout:
      timeout_s_ = value;
      break;
    case kMoteusCommandDVoltage:
      u_dq_[0] = value;
      break;
    case kMoteusCommandQVoltage:
      u_dq_[1] = value;
      break;
    default:
      break;
  }
}

const Measurement* MoteusDevice::at_last_tick() const {
  return last_tick_ ? &*last_tick_ : drive_.sample();
}

double MoteusDevice::read(int reg) const {
  const Measurement *m = at_last_tick(), *now = drive_.sample();
  if (!m) return std::nan("");
  const Vec2 i_dq = currents_of(*m, machine_.n_p);
  const Vec3 u_abc = inverse_clarke(0.5 * (m->u_alphabeta + (now ? now : m)->u_alphabeta));
  switch (reg) {
    case kMoteusMode:
      return mode_;
    case kMoteusPosition:
      return m->theta_m / kTwoPi;
    case kMoteusVelocity:
      return m->omega_m / kTwoPi;
    case kMoteusTorque:
      return 1.5 * machine_.n_p * machine_.psi_f * i_dq[1];
    case kMoteusQCurrent:
      return i_dq[1];
    case kMoteusDCurrent:
      return i_dq[0];
    case kMoteusVoltage:
      return m->v_dc;
    case kMoteusPhaseA:
    case kMoteusPhaseA + 1:
    case kMoteusPhaseA + 2:
      return u_abc[reg - kMoteusPhaseA];
    case kMoteusMillisecond:
      return std::floor(1e3 * static_cast<double>(last_tick_ ? k_ - 1 : k_) * options_.T_s);
    default:
      return 0;
  }
}

// PI on d and q, with the EMF and the coupling fed forward.
Vec2 MoteusDevice::current_control(const Vec2& i_dq, double i_q_ref, double omega_e) {
  const Vec2 error = Vec2(0, i_q_ref) - i_dq;
  integral_ += machine_.R_s * kCurrentBandwidth * options_.T_s * error;
  const Vec2 coupling(-omega_e * machine_.L_q * i_dq[1],
                      omega_e * (machine_.L_d * i_dq[0] + machine_.psi_f));
  return Vec2(machine_.L_d * error[0], machine_.L_q * error[1]) * kCurrentBandwidth + integral_ +
         coupling;
}

bool MoteusDevice::control(Command& command) {
  const Measurement* m = drive_.sample();
  if (!m || (mode_ != kMoteusModePosition && mode_ != kMoteusModeVoltageDq)) return false;
  const double theta_e = machine_.n_p * m->theta_m;
  Vec2 u_dq = u_dq_;
  if (mode_ == kMoteusModePosition) {
    // The position loop of this emulator has zero gains: only the torque acts.
    const double i_q_ref = torque_ / (1.5 * machine_.n_p * machine_.psi_f);
    u_dq = current_control(currents_of(*m, machine_.n_p), i_q_ref, machine_.n_p * m->omega_m);
  }
  command.u_alphabeta_ref = inverse_park(u_dq, theta_e);
  command.theta_ctrl = theta_e;
  return true;
}

void MoteusDevice::tick() {
  const double now_s = static_cast<double>(k_) * options_.T_s;
  if (drive_.latched() != Reason::kNone) mode_ = kMoteusModeFault;
  const bool watched = mode_ == kMoteusModePosition || mode_ == kMoteusModeStayWithin;
  if (watched && now_s - heard_s_ > timeout_s_) {
    mode_ = kMoteusModeTimeout;
    drive_.switch_off(Reason::kNone);
  }
  Command command;
  const bool drives = control(command);
  if (const Measurement* m = drive_.sample()) last_tick_ = *m;
  drive_.advance(drives ? &command : nullptr);
  ++k_;
}

void MoteusBurstDevice::tick() {
  if (const Measurement* m = drive_.sample()) {
    const Vec2 i_dq = currents_of(*m, machine_.n_p);
    const double turns = m->theta_m / kTwoPi;
    const auto raw = static_cast<std::uint16_t>(std::lround(65536 * (turns - std::floor(turns))));
    const auto scaled = [](double amperes) {
      return static_cast<std::uint16_t>(
          static_cast<std::int16_t>(std::clamp(32767.0 * amperes / 100, -32768.0, 32767.0)));
    };
    const std::array words = {raw, scaled(i_dq[0]), scaled(i_dq[1])};
    Bytes frame = {0x5a};
    for (const std::uint16_t word : words) {
      frame.push_back(static_cast<std::uint8_t>(word & 0xff));
      frame.push_back(static_cast<std::uint8_t>(word >> 8));
    }
    sent_.push_back(std::move(frame));
  }
  drive_.advance(nullptr);
  ++k_;
}

}  // namespace twinrate
