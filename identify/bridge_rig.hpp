// A real drive behind the bridge as a rig.
//
//   step(u)   COMMAND(k) with a lease -> drive -> SAMPLE(k+1) -> row
//
// Lock-step: an emulated drive waits for each command; the rows are those of simulated_rig.hpp, bit
// for bit. Realtime: the drive sets the pace. Waiting rows are taken one after the other, each with
// its command, until the host has caught up; a few missing samples are interpolated between their
// neighbours, with the voltage that was asked for.
//
// The outputs are off before the first step, during a pause, and after the end. The experiments end
// at a trip of the bridge's guard (limits of [safety], implausible readings, a silent link, a
// restart), of the drive itself (its lease, its limits), or at a longer gap in the samples.
#pragma once
#include <deque>
#include <functional>
#include <string>
#include <vector>

#include "bridge/conversation.hpp"
#include "bridge/guard.hpp"
#include "core/config.hpp"
#include "identify/rig.hpp"

namespace twinrate {

enum class RigPace { kAuto, kLockstep, kRealtime };  // auto: lock-step if the drive offers it

class BridgeRig final : public Rig {
 public:
  // Longest run of missing samples that is interpolated, and the largest share of missing samples.
  static constexpr int kLongestGap = 8;
  static constexpr double kMostMissing = 0.02;

  // Connects to the drive and checks its first sample. `stop`: asked while waiting for the drive.
  // Throws BadInput if the drive file or the drive is not suitable, MachineError if no drive
  // answers or the drive is latched.
  BridgeRig(Config& drive, RigPace pace, std::function<bool()> stop = {});

  const RigFacts& facts() const override { return facts_; }
  RigRow step(const Vec2& u_alphabeta_ref, double theta_e) override;
  void pause() override;
  // "udp://127.0.0.1:47001, lock-step"
  std::string where() const;
  int late_ticks() const override;
  // Faults of the link that the rows contain.
  std::vector<std::string> notes() const override;
  // One line: frames, their errors, delays of late commands.
  std::string account() const { return talk_.account(); }
  std::int64_t missing() const { return missing_; }

 private:
  void expect_fit(const Config& drive, const DriveInfo& info);
  void first_sample(const Config& drive);
  void resume();
  void wait();
  void take(const DriveSample& sample);
  void put_in(std::int64_t gap, const RigRow& after);
  void expect_on();
  void fail(const std::string& why);

  BridgeParameters bridge_;
  Conversation talk_;
  BridgeGuard guard_;
  std::function<bool()> stop_;
  RigFacts facts_;
  bool lockstep_ = false, paused_ = true;
  struct Arrived {
    std::int64_t k = -1;
    RigRow row;
  };
  std::deque<Arrived> rows_;
  Arrived last_;            // newest arrival
  std::int64_t k_ = -1;     // of the row given last
  double theta_raw_ = 0;    // rad, reading of the newest
  double turned_ = 0;       // rad, whole turns to add to it
  std::deque<Vec2> asked_;  // V, newest last
  std::int64_t sent_ns_ = 0, resets_ = 0;
  std::int64_t taken_ = 0, missing_ = 0, predicted_ = 0;
  int predicted_in_a_row_ = 0;
  std::string why_off_;
};

}  // namespace twinrate
