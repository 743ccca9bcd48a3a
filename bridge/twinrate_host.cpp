#include "bridge/twinrate_host.hpp"

#include <algorithm>

#include "model/inverter.hpp"

namespace twinrate {

void TwinrateHost::take(std::span<const std::uint8_t> bytes, std::int64_t arrival_ns) {
  for (const std::uint8_t byte : bytes) {
    twp_frame f{};
    const twp_result result = twp_receive(&receiver_, byte, &f);
    if (result == TWP_NOTHING) continue;
    if (result != TWP_FRAME) {
      ++counts_.damaged;
      continue;
    }
    ++counts_.frames;
    if (f.header.type == TWP_SAMPLE) take_sample(f, arrival_ns);
    if (f.header.type == TWP_INFO) take_info(f);
  }
}

void TwinrateHost::forget_info() {
  HostProtocol::forget_info();
  first_question_ = sent_ + 1;
}

void TwinrateHost::take_info(const twp_frame& f) {
  const std::uint32_t answered = f.header.seq;
  if (twp_difference(answered, first_question_) < 0 || twp_difference(sent_, answered) < 0)
    return;  // to an earlier question, or to another host
  if (!info_ && lockstep_) {
    // Samples before it are of a drive that kept its own pace; the next one waits for its command.
    samples_.clear();
    begun_ = false;
    counts_ = {};
  }
  const twp_info& i = f.body.info;
  const std::size_t size = std::find(i.name, i.name + TWP_NAME_BYTES, '\0') - i.name;
  info_ = DriveInfo{.name = std::string(i.name, size),
                    .f_s_Hz = i.f_s_Hz,
                    .lease_max_ms = 1e-3 * i.lease_max_us,
                    .lockstep = (i.abilities & TWP_LOCKSTEP) != 0,
                    .watchdog = (i.abilities & TWP_WATCHDOG) != 0,
                    .takes_voltage = (i.abilities & TWP_CAN_VOLTAGE) != 0,
                    .takes_duties = (i.abilities & TWP_CAN_DUTIES) != 0,
                    .float64 = (i.abilities & TWP_CAN_FLOAT64) != 0,
                    .reason = i.reason,
                    .bad_frames = i.bad_frames,
                    .lost_frames = i.lost_frames};
}

// True if a sample with this number is the next one; counts its errors.
bool TwinrateHost::in_order(std::uint32_t seq) {
  if (!begun_) {
    begun_ = true;
    last_seq_ = seq;
    k_ = seq;
    restarted_at_ = 0;
    return true;
  }
  const std::int32_t step = twp_difference(seq, last_seq_);
  if (step > 0) {
    counts_.lost += step - 1;
    k_ += step;
    last_seq_ = seq;
    old_in_a_row_ = 0;
    return true;
  }
  if (step == 0) {
    ++counts_.doubled;
    return false;
  }
  if (step >= -kReorder && ++old_in_a_row_ < kOldInARow) {
    ++counts_.late;
    counts_.lost = std::max<std::int64_t>(0, counts_.lost - 1);
    return false;
  }
  ++counts_.resets;
  clock_.restart();
  old_in_a_row_ = 0;
  last_seq_ = seq;
  restarted_at_ = ++k_ - seq;
  return true;
}

// The command of tick k acts in time if it is taken before SAMPLE(k + delay) leaves.
void TwinrateHost::note_answer(std::uint32_t command_seq) {
  const std::int32_t age = twp_difference(sent_, command_seq);
  if (first_command_ == 0 || twp_difference(command_seq, first_command_) < 0 || age < 0 ||
      age >= static_cast<std::int32_t>(kRemembered))
    return;
  const std::int64_t answers = sample_of_[command_seq % kRemembered];
  if (answers < 0 || answers > k_) return;
  const std::int64_t ticks = k_ - answers;
  ++counts_.answered;
  counts_.answer_ticks += ticks;
  counts_.answer_ticks_most = std::max(counts_.answer_ticks_most, ticks);
  counts_.command_late += ticks > due_ticks_;
}

void TwinrateHost::take_sample(const twp_frame& f, std::int64_t arrival_ns) {
  if (!in_order(f.header.seq)) return;
  const twp_sample& s = f.body.sample;
  DriveSample sample;
  sample.time_us = clock_.take(f.header.time_us, arrival_ns);
  last_time_us_ = f.header.time_us;
  sample.arrival_ns = arrival_ns;
  sample.command_seq = s.command_seq;
  note_answer(s.command_seq);
  sample.reason = s.reason;
  sample.off = s.state == TWP_SAFE;
  Measurement& m = sample.m;
  m.k = k_;
  m.signals = s.signals;
  m.i_abc = {s.i_abc[0], s.i_abc[1], s.i_abc[2]};
  m.u_alphabeta = {s.u_alphabeta[0], s.u_alphabeta[1]};
  if (f.header.flags & TWP_DUTIES) m.duty_abc = {s.duty_abc[0], s.duty_abc[1], s.duty_abc[2]};
  m.mode = static_cast<Mode>(std::min<int>(s.mode, static_cast<int>(Mode::kSafe)));
  m.theta_forced = s.theta_forced;
  m.v_dc = v_dc_ = s.v_dc;
  m.theta_m = s.theta_m;
  m.omega_m = s.omega_m;
  samples_.push_back(sample);
}

std::optional<DriveSample> TwinrateHost::next() {
  if (samples_.empty()) return {};
  DriveSample sample = samples_.front();
  samples_.pop_front();
  return sample;
}

Bytes TwinrateHost::written(twp_frame& f) {
  f.header.flags = float64_ ? TWP_FLOAT64 : 0;
  f.header.seq = ++sent_;
  sample_of_[sent_ % kRemembered] = -1;
  Bytes wire(TWP_MAX_WIRE);
  wire.resize(twp_write(&f, wire.data()));
  return wire;
}

Bytes TwinrateHost::hello(bool lockstep) {
  lockstep_ = lockstep;
  twp_frame f{};
  f.header.type = TWP_HELLO;
  f.body.hello.abilities =
      static_cast<std::uint16_t>((lockstep ? TWP_LOCKSTEP : 0) | (float64_ ? TWP_CAN_FLOAT64 : 0));
  Bytes wire{0};  // ends the remainder of a former host's bytes on the line
  const Bytes frame = written(f);
  wire.insert(wire.end(), frame.begin(), frame.end());
  return wire;
}

Bytes TwinrateHost::command(const DriveCommand& c) {
  twp_frame f{};
  f.header.type = TWP_COMMAND;
  f.header.time_us = last_time_us_;
  twp_command& body = f.body.command;
  body.sample_seq = static_cast<std::uint32_t>(c.sample_k - restarted_at_);
  body.lease_us = c.lease_us;
  body.enable = 1;
  body.mode = static_cast<std::uint8_t>(c.command.mode);
  if (info_ && info_->takes_duties && !info_->takes_voltage && v_dc_ > 0) {
    body.kind = TWP_COMMAND_DUTIES;
    const Vec3 duty_abc = svpwm(c.command.u_alphabeta_ref, v_dc_).duty_abc;
    for (int phase = 0; phase < 3; ++phase) body.duty_abc[phase] = duty_abc[phase];
  } else {
    body.u_alphabeta[0] = c.command.u_alphabeta_ref[0];
    body.u_alphabeta[1] = c.command.u_alphabeta_ref[1];
  }
  body.theta_ctrl = c.command.theta_ctrl;
  Bytes wire = written(f);
  sample_of_[sent_ % kRemembered] = c.sample_k;
  if (first_command_ == 0) first_command_ = sent_;
  return wire;
}

Bytes TwinrateHost::off() {
  twp_frame f{};
  f.header.type = TWP_COMMAND;
  f.header.time_us = last_time_us_;
  f.body.command.sample_seq = last_seq_;
  f.body.command.mode = static_cast<std::uint8_t>(Mode::kSafe);
  return written(f);
}

Bytes TwinrateHost::clear(int reason) {
  twp_frame f{};
  f.header.type = TWP_CLEAR;
  f.body.clear.reason = static_cast<std::uint16_t>(reason);
  return written(f);
}

}  // namespace twinrate
