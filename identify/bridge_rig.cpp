#include "identify/bridge_rig.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/machine_error.hpp"
#include "identify/experiment.hpp"

namespace twinrate {
namespace {

constexpr double kGreet_s = 5, kFirstSample_ms = 1000, kAskAgain_ms = 20;

BridgeParameters parameters(Config& drive) {
  const auto bridge = drive.read<BridgeParameters>();
  if (bridge.protocol != DriveProtocol::kTwinrate)
    throw BadInput(fmt::format(
        "bridge.protocol: identify asks for voltages under a watchdog in the drive: twinrate "
        "allowed, found {}",
        kDriveProtocolNames[static_cast<int>(bridge.protocol)]));
  if (bridge.port.empty())
    throw BadInput(
        "bridge.port: missing: a serial device or udp://HOST:PORT (--port), or "
        "bridge.emulate = true");
  return bridge;
}

double ms_since(std::int64_t then_ns) {
  return 1e-6 * static_cast<double>(now_ns() - then_ns);
}

}  // namespace

BridgeRig::BridgeRig(Config& drive, RigPace pace, std::function<bool()> stop)
    : bridge_(parameters(drive)),
      talk_(bridge_, drive.drive()),
      guard_(drive, bridge_),
      stop_(std::move(stop)) {
  const DriveConfig& d = drive.drive();
  facts_ = {.T_s = d.T_s(),
            .delay_ticks = d.plant.delay_samples,
            .encoder_counts = d.sensors.encoder_counts,
            .v_dc = d.inverter.v_dc};
  const DriveInfo& info = talk_.greet(pace != RigPace::kRealtime, kGreet_s);
  expect_fit(drive, info);
  lockstep_ = pace != RigPace::kRealtime && info.lockstep;
  if (pace == RigPace::kLockstep && !lockstep_)
    throw BadInput("--pace lockstep: the drive sets its own pace: realtime allowed");
  first_sample(drive);
}

void BridgeRig::expect_fit(const Config& drive, const DriveInfo& info) {
  if (!info.takes_voltage && !info.takes_duties)
    throw BadInput(bridge_.port +
                   ": the drive takes no voltage and no duties: identify cannot run on it");
  if (!info.watchdog)
    throw BadInput(bridge_.port +
                   ": the drive has no watchdog: identify does not run on it, for nothing would "
                   "switch it off if the host ended");
  if (info.reason == 0) return;
  const char* name = reason_name(info.reason);
  throw MachineError(fmt::format(
      "{}: the drive is off, latched: {}; clear it by hand: twinrate bridge probe {} "
      "--port {} --clear {}",
      bridge_.port, name ? name : "unknown reason", drive.drive().name, bridge_.port, info.reason));
}

// Checks the signals that the drive sends, and that its bus voltage is that of the drive file.
void BridgeRig::first_sample(const Config& drive) {
  constexpr double kOtherBus = 0.2;
  std::optional<DriveSample> sample;
  for (const std::int64_t begun = now_ns(); !sample;) {
    if (ms_since(begun) > kFirstSample_ms || !talk_.link().is_open())
      throw MachineError(fmt::format("{}: the drive answers, but sends no sample within {:g} s",
                                     bridge_.port, 1e-3 * kFirstSample_ms));
    talk_.pump(5);
    sample = talk_.next();
  }
  const Measurement& m = sample->m;
  std::string lacks;
  const auto need = [&](int signal, const char* name) {
    if ((m.signals & signal) == 0) lacks += (lacks.empty() ? "" : ", ") + std::string(name);
  };
  need(kPhaseCurrents, "the phase currents");
  need(kVoltage, "the applied voltage");
  need(kPosition, "the angle of an encoder");
  if (!lacks.empty())
    throw BadInput(fmt::format("{}: the samples of the drive lack {}: identify needs it",
                               bridge_.port, lacks));
  if ((m.signals & kBusVoltage) != 0) {
    if (!(std::abs(m.v_dc / facts_.v_dc - 1) < kOtherBus))
      throw BadInput(fmt::format("{}: inverter.v_dc_V: the drive reads {:.4g} V, found {:g}",
                                 drive.where("inverter.v_dc_V"), m.v_dc, facts_.v_dc));
    facts_.v_dc = std::min(facts_.v_dc, m.v_dc);
  }
  theta_raw_ = m.theta_m;
  take(*sample);
  rows_.clear();
  k_ = last_.k;
}

std::string BridgeRig::where() const {
  return fmt::format("{}, {}", bridge_.port, lockstep_ ? "lock-step" : "realtime");
}

void BridgeRig::fail(const std::string& why) {
  talk_.off();
  throw RunFailed(why);
}

void BridgeRig::expect_on() {
  for (const GuardEvent& event : guard_.take_events()) why_off_ = event.text;
  if (guard_.is_off()) fail("the drive is switched off: " + why_off_);
}

// Interpolates missing samples between their neighbours. The voltage up to tick k is that of
// COMMAND(k - 1 - delay), or of the last command if that one was not sent.
void BridgeRig::put_in(std::int64_t gap, const RigRow& after) {
  const RigRow before = last_.row;
  for (std::int64_t j = 1; j < gap; ++j) {
    const double share = static_cast<double>(j) / static_cast<double>(gap);
    const std::int64_t age = std::max<std::int64_t>(0, k_ - (last_.k + j - 1 - facts_.delay_ticks));
    const auto at = static_cast<std::size_t>(age);
    const Vec2 u = at < asked_.size() ? asked_[asked_.size() - 1 - at] : after.u_alphabeta;
    rows_.push_back({last_.k + j,
                     {before.i_abc + share * (after.i_abc - before.i_abc), u,
                      before.theta_m + share * (after.theta_m - before.theta_m)}});
    ++missing_;
  }
}

void BridgeRig::take(const DriveSample& sample) {
  const std::int64_t resets = talk_.protocol().counts().resets;
  if (resets > resets_) guard_.restarted();
  resets_ = resets;
  const Measurement m =
      guard_.take(sample, paused_ ? Arrival::kNotDue : Arrival::kInTime, Mode::kRun);
  expect_on();
  const bool read = (m.signals & kPhaseCurrents) != 0 && (m.signals & kPosition) != 0;
  predicted_in_a_row_ = read ? 0 : predicted_in_a_row_ + 1;
  predicted_ += read ? 0 : 1;
  if (predicted_in_a_row_ > kLongestGap)
    fail(fmt::format("{} samples in a row have no usable current or angle", predicted_in_a_row_));
  if (m.theta_m - theta_raw_ > kPi) turned_ -= kTwoPi;
  if (m.theta_m - theta_raw_ < -kPi) turned_ += kTwoPi;
  theta_raw_ = m.theta_m;
  const RigRow row{m.i_abc, m.u_alphabeta, m.theta_m + turned_};
  const std::int64_t gap = paused_ ? 1 : sample.m.k - last_.k;
  if (gap - 1 > kLongestGap)
    fail(fmt::format(
        "{} samples in a row did not come: the line or this host is too slow for {:g} Hz (twinrate "
        "bridge probe)",
        gap - 1, 1 / facts_.T_s));
  put_in(gap, row);
  last_ = {sample.m.k, row};
  rows_.push_back(last_);
  ++taken_;
  constexpr std::int64_t kJudged = 1000;
  if (taken_ > kJudged && static_cast<double>(missing_ + predicted_) >
                              kMostMissing * static_cast<double>(taken_ + missing_))
    fail(fmt::format(
        "{:.2g} % of the samples are missing or unusable, up to {:g} % allowed "
        "(twinrate bridge probe)",
        100 * static_cast<double>(missing_ + predicted_) / static_cast<double>(taken_ + missing_),
        100 * kMostMissing));
}

void BridgeRig::wait() {
  if (stop_ && stop_()) fail("stopped");
  talk_.pump(1);
  while (const auto sample = talk_.next()) take(*sample);
  guard_.silent_for(talk_.link().is_open() ? talk_.silent_ms() : 1e9);
  expect_on();
  if (lockstep_ && rows_.empty() && ms_since(sent_ns_) > kAskAgain_ms) {
    talk_.repeat();
    sent_ns_ = now_ns();
  }
}

// Drops the samples of the pause, which belong to no experiment. In lock-step the drive waits with
// its first sample.
void BridgeRig::resume() {
  if (!lockstep_) {
    while (talk_.pump(0)) {
      while (const auto sample = talk_.next()) take(*sample);
    }
    rows_.clear();
    while (rows_.empty()) wait();
    rows_.clear();
    k_ = last_.k;
  }
  paused_ = false;
}

RigRow BridgeRig::step(const Vec2& u_alphabeta_ref, double theta_e) {
  if (!u_alphabeta_ref.allFinite()) fail("a voltage that is not a finite number");
  if (paused_) resume();
  Command command;
  command.k = k_;
  command.u_alphabeta_ref = u_alphabeta_ref;
  command.theta_ctrl = theta_e;
  talk_.command({.command = command,
                 .sample_k = k_,
                 .lease_us = static_cast<std::uint32_t>(1e3 * bridge_.lease_ms)});
  sent_ns_ = now_ns();
  asked_.push_back(u_alphabeta_ref);
  if (asked_.size() > 64) asked_.pop_front();
  while (rows_.empty()) wait();
  const Arrived next = rows_.front();
  rows_.pop_front();
  k_ = next.k;
  return next.row;
}

void BridgeRig::pause() {
  if (lockstep_ || paused_) return;
  talk_.off();
  paused_ = true;
}

int BridgeRig::late_ticks() const {
  const std::int64_t most = talk_.protocol().counts().answer_ticks_most;
  return static_cast<int>(std::max<std::int64_t>(0, most - std::max(1, facts_.delay_ticks)));
}

std::vector<std::string> BridgeRig::notes() const {
  std::vector<std::string> list;
  const LinkCounts& counts = talk_.protocol().counts();
  if (missing_ + predicted_ > 0)
    list.push_back(fmt::format(
        "link: {} of {} rows were missing and {} unusable; they lie between their neighbours",
        missing_, taken_ + missing_, predicted_));
  constexpr double kMaterial = 0.05;
  if (!lockstep_ && counts.answered > 0 &&
      static_cast<double>(counts.command_late) > kMaterial * static_cast<double>(counts.answered))
    list.push_back(
        fmt::format("link: commands acted {:.2f} ticks after their sample on average, {} at most, "
                    "plant.delay_samples = {}; the current loop was slower than meant",
                    counts.answer_ticks_mean(), counts.answer_ticks_most, facts_.delay_ticks));
  return list;
}

}  // namespace twinrate
