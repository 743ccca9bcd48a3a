// The drive behind an emulated device: gives measurements tick by tick, and applies commands.
//
//   PlantDrive       the simulated plant, for a host that closes the loop
//   OwnControlDrive  the whole closed loop, for a host that listens
//   RecordedDrive    rows of a measured file, at the ticks of its control rate
#pragma once
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/config.hpp"
#include "core/reason.hpp"
#include "loop/closed_loop.hpp"
#include "plant_sim/plant.hpp"

namespace twinrate {

class EmulatedDrive {
 public:
  virtual ~EmulatedDrive() = default;
  // The measurement at t_k; null: nothing is sampled at this tick.
  virtual const Measurement* sample() const = 0;
  // Advances from t_k to t_{k+1} with this command; null: none is in force.
  virtual void advance(const Command* command) = 0;
  // True after the last tick of the drive.
  virtual bool ended() const { return false; }
  virtual bool takes_commands() const { return false; }

  // Switches the outputs off from the next advance() on; a reason latches that.
  virtual void switch_off(Reason) {}
  // Latched by the drive itself or by switch_off(); kNone: not.
  virtual Reason latched() const { return Reason::kNone; }
  virtual DriveState state() const { return DriveState::kRun; }
  // Leaves the latched state; false if its cause persists.
  virtual bool clear() { return false; }
};

class PlantDrive final : public EmulatedDrive {
 public:
  explicit PlantDrive(Config& config);
  const Measurement* sample() const override { return &plant_.sample(); }
  void advance(const Command* command) override;
  bool takes_commands() const override { return true; }
  void switch_off(Reason reason) override;
  Reason latched() const override { return latched_; }
  // A reset of the plant takes effect at its next tick.
  DriveState state() const override {
    const DriveState state = plant_.safety().state();
    return state == DriveState::kSafe && latched_ == Reason::kNone ? DriveState::kIdle : state;
  }
  bool clear() override;
  const Plant& plant() const { return plant_; }

 private:
  Plant plant_;
  int delay_;
  Reason latched_ = Reason::kNone;
  bool off_ = false;  // requested, not latched
};

class OwnControlDrive final : public EmulatedDrive {
 public:
  explicit OwnControlDrive(Config& config) : loop_(config), steps_(config.drive().steps()) {}
  const Measurement* sample() const override { return &loop_.plant().sample(); }
  void advance(const Command*) override { loop_.step(); }
  bool ended() const override { return loop_.k() >= steps_; }
  DriveState state() const override { return loop_.plant().safety().state(); }

 private:
  ClosedLoop loop_;
  std::int64_t steps_;
};

class RecordedDrive final : public EmulatedDrive {
 public:
  // A drive log CSV as `twinrate import` reads it: with canonical names, or through the map in the file
  // `map`. Throws BadInput.
  RecordedDrive(const std::string& path, const std::string& map, const DriveConfig& drive);
  const Measurement* sample() const override;
  void advance(const Command*) override;
  bool ended() const override { return next_ >= rows_.size(); }

 private:
  std::vector<Measurement> rows_;
  std::size_t next_ = 0;
  std::int64_t k_ = 0;
};

}  // namespace twinrate
