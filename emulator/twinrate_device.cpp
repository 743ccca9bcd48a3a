#include "emulator/twinrate_device.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "model/inverter.hpp"

namespace twinrate {

std::uint32_t TwinrateDevice::now_us() const {
  const auto us = std::llround(static_cast<double>(k_ - first_k_) * options_.T_s * 1e6);
  return static_cast<std::uint32_t>(us);
}

void TwinrateDevice::send(twp_frame& f) {
  Bytes wire(TWP_MAX_WIRE);
  wire.resize(twp_write(&f, wire.data()));
  sent_.push_back(std::move(wire));
}

void TwinrateDevice::take(std::span<const std::uint8_t> bytes) {
  for (const std::uint8_t byte : bytes) {
    twp_frame f{};
    const twp_result result = twp_receive(&receiver_, byte, &f);
    if (result < 0) ++bad_frames_;
    if (result != TWP_FRAME) continue;
    switch (f.header.type) {
      case TWP_HELLO:
        lockstep_ = (f.body.hello.abilities & TWP_LOCKSTEP) != 0 && drive_.takes_commands();
        flags_ = TWP_ALL_GROUPS;
        if (f.body.hello.abilities & TWP_CAN_FLOAT64) flags_ |= TWP_FLOAT64;
        command_seq_ = f.header.seq;  // a new host restarts the count
        knows_host_ = true;
        has_command_ = false;
        send_info(f.header.seq);
        break;
      case TWP_CLEAR:
        if (f.body.clear.reason == static_cast<int>(drive_.latched()) && drive_.clear()) {
          coming_.clear();
          has_command_ = false;
          lease_ = {};
        }
        send_info(f.header.seq);
        break;
      case TWP_COMMAND:
        if (drive_.takes_commands()) take_command(f);
        break;
      default:
        break;
    }
  }
}

void TwinrateDevice::take_command(const twp_frame& f) {
  if (!std::exchange(knows_host_, true)) command_seq_ = f.header.seq - 1;
  const std::int32_t step = twp_difference(f.header.seq, command_seq_);
  if (step <= 0) {  // repeated or late; in lock-step the host asks for the sample again
    repeat();
    return;
  }
  lost_frames_ += step - 1;
  command_seq_ = f.header.seq;
  const twp_command& c = f.body.command;
  // The command answers a sample of the future, or one from before a restart.
  if (c.enable != 0 && c.sample_seq > k_ - first_k_) {
    ++bad_frames_;
    return;
  }
  answered_ = std::max<std::int64_t>(answered_, c.sample_seq);
  if (c.enable == 0) {
    coming_.clear();
    lease_ = {};
    if (options_.faults.keeps_last) return;
    if (has_command_) drive_.switch_off(Reason::kNone);
    has_command_ = false;
    return;
  }
  if (drive_.latched() != Reason::kNone) return;  // only CLEAR ends the latched state
  const auto lease_max = static_cast<std::uint32_t>(std::llround(1e6 * options_.lease_max_s));
  twp_lease_take(&lease_, now_us(), c.lease_us, lease_max);
  ++leased_;
  leased_k_ = k_;
  Command command;
  command.k = c.sample_seq;
  command.mode = static_cast<Mode>(std::min<int>(c.mode, static_cast<int>(Mode::kSafe)));
  const Measurement* now = drive_.sample();
  command.u_alphabeta_ref =
      c.kind == TWP_COMMAND_DUTIES
          ? mean_voltage({c.duty_abc[0], c.duty_abc[1], c.duty_abc[2]}, now ? now->v_dc : 0)
          : Vec2(c.u_alphabeta[0], c.u_alphabeta[1]);
  command.theta_ctrl = c.theta_ctrl;
  coming_.push_back(command);
}

void TwinrateDevice::send_info(std::uint32_t question) {
  twp_frame f{};
  f.header.type = TWP_INFO;
  f.header.seq = question;
  f.header.time_us = now_us();
  twp_info& info = f.body.info;
  info.f_s_Hz = 1 / options_.T_s;
  info.lease_max_us = static_cast<std::uint32_t>(std::llround(1e6 * options_.lease_max_s));
  int abilities = TWP_CAN_FLOAT64;
  if (drive_.takes_commands()) abilities |= TWP_LOCKSTEP | TWP_WATCHDOG | TWP_CAN_DUTIES;
  if (drive_.takes_commands() && options_.takes_voltage) abilities |= TWP_CAN_VOLTAGE;
  info.abilities = static_cast<std::uint16_t>(abilities);
  info.bad_frames = static_cast<std::uint16_t>(bad_frames_);
  info.lost_frames = static_cast<std::uint16_t>(lost_frames_);
  info.reason = static_cast<std::uint16_t>(drive_.latched());
  const std::size_t size = std::min<std::size_t>(options_.name.size(), TWP_NAME_BYTES);
  std::memcpy(info.name, options_.name.data(), size);
  send(f);
}

void TwinrateDevice::send_sample() {
  const Measurement* m = drive_.sample();
  if (!m) return;
  twp_frame& f = last_sample_ = {};
  f.header.type = TWP_SAMPLE;
  f.header.flags = flags_;
  f.header.seq = static_cast<std::uint32_t>(k_ - first_k_);
  f.header.time_us = now_us();
  twp_sample& s = f.body.sample;
  s.command_seq = command_seq_;
  s.signals = static_cast<std::uint16_t>(m->signals);
  s.reason = static_cast<std::uint16_t>(drive_.latched());
  s.state = static_cast<std::uint8_t>(drive_.latched() != Reason::kNone ? DriveState::kSafe
                                                                        : drive_.state());
  s.mode = static_cast<std::uint8_t>(m->mode);
  s.bad_frames = static_cast<std::uint16_t>(bad_frames_);
  for (int i = 0; i < 3; ++i) s.i_abc[i] = m->i_abc[i], s.duty_abc[i] = m->duty_abc[i];
  s.u_alphabeta[0] = m->u_alphabeta[0];
  s.u_alphabeta[1] = m->u_alphabeta[1];
  s.v_dc = m->v_dc;
  s.theta_m = m->theta_m;
  s.omega_m = m->omega_m;
  s.theta_forced = m->theta_forced;
  send(f);
}

bool TwinrateDevice::waits() const {
  return lockstep_ && sampled_ == k_ - first_k_ && answered_ < sampled_;
}

void TwinrateDevice::repeat() {
  if (lockstep_ && sampled_ >= 0) send(last_sample_);
}

// The newest command that is due.
const Command* TwinrateDevice::in_force() {
  const std::int64_t due = k_ - first_k_ - options_.delay;
  while (!coming_.empty() && coming_.front().k <= due) {
    command_ = coming_.front();
    coming_.pop_front();
    has_command_ = true;
  }
  return has_command_ ? &command_ : nullptr;
}

void TwinrateDevice::restart() {
  was_reset_ = true;
  receiver_ = {};
  drive_.switch_off(Reason::kNone);
  first_k_ = k_;
  sampled_ = answered_ = -1;
  command_seq_ = 0;
  knows_host_ = false;
  bad_frames_ = lost_frames_ = 0;
  coming_.clear();
  has_command_ = lockstep_ = false;
  lease_ = {};
}

// The voltage of a sample is that of the interval before it.
void TwinrateDevice::note_outputs() {
  const Measurement* m = drive_.sample();
  if (!m || leased_k_ < 0) return;
  const bool on = m->u_alphabeta.norm() > 0;
  if (was_on_ && !on) {
    ++off_times_;
    off_ticks_most_ = std::max(off_ticks_most_, k_ - leased_k_);
  }
  was_on_ = on;
}

std::string TwinrateDevice::account() const {
  const char* latched = reason_name(static_cast<int>(drive_.latched()));
  return fmt::format(
      "{} commands taken; frames refused {}, missing {}; {}; outputs {}, off {} times, at most "
      "{:.1f} "
      "ms of drive time after the last command",
      leased_, bad_frames_, lost_frames_,
      drive_.latched() == Reason::kNone ? "nothing latched"
                                        : fmt::format("latched: {}", latched ? latched : "?"),
      was_on_ ? "on" : "off", off_times_,
      1e3 * options_.T_s * static_cast<double>(off_ticks_most_));
}

void TwinrateDevice::tick() {
  note_outputs();
  const bool resets = static_cast<double>(k_) * options_.T_s >= options_.faults.reset_at_s;
  if (resets && !was_reset_) restart();
  if (sampled_ < k_ - first_k_) {
    send_sample();
    sampled_ = k_ - first_k_;
    if (lockstep_) return;  // the command decides
  }
  if (waits()) return;
  if (twp_lease_ended(&lease_, now_us()) && !options_.faults.keeps_last) {
    ++leases_ended_;
    drive_.switch_off(Reason::kCommandLost);
    coming_.clear();
    has_command_ = false;
  }
  drive_.advance(in_force());
  ++k_;
}

}  // namespace twinrate
