// The product's closed loop with access to its last tick, and the figures of docs/conventions.md
// over [settle_s, end].
#pragma once
#include <algorithm>
#include <cmath>
#include <limits>

#include "loop/closed_loop.hpp"
#include "tests/support/angles.hpp"
#include "tests/support/drives.hpp"

namespace twinrate::test {

class ClosedLoop {
 public:
  explicit ClosedLoop(Config config) : drive_(config.drive()), loop_(config) {}

  void tick() { tick_ = &loop_.step(); }

  // Of the last tick; gain() of the last snapshot.
  const Measurement& measurement() const { return tick_->measurement; }
  const Truth& truth() const { return tick_->truth; }
  const Estimate& estimate() const { return tick_->estimate; }
  const Reference& reference() const { return tick_->reference; }
  const Command& command() const { return tick_->command; }
  const ControllerEvent& event() const { return tick_->event; }
  const Gain& gain() const { return tick_->gain; }
  const DriveConfig& drive() const { return drive_; }
  double t_s() const { return static_cast<double>(measurement().k) * drive_.T_s(); }
  bool tripped() const { return loop_.plant().tripped(); }
  double angle_error() const {
    return wrap_pi(estimate().theta_e - drive_.machine.n_p * truth().theta_m);
  }

 private:
  DriveConfig drive_;
  twinrate::ClosedLoop loop_;
  const TickRecord* tick_ = nullptr;
};

struct Figures {
  bool locked = true;      // synchronism
  bool speed_held = true;  // off its reference by more than 20 % for less than 20 ms in total
  bool held() const { return locked && speed_held; }
  double angle_error_rms = 0, angle_error_max = 0;
  double speed_mean = 0;  // true, mechanical
  double P44_min = std::numeric_limits<double>::infinity(), P44_max = 0;
  // Of the whole run, not of the window: the first time the speed is below zero; infinite if never.
  double reversed_at_s = std::numeric_limits<double>::infinity();
  double speed_end = 0;
};

enum class Until { kEnd, kLost };  // kLost: a run ends at the tick by which it is lost

// Runs duration_s and forms the figures over [settle_s, end].
inline Figures run(ClosedLoop& loop, Until until = Until::kEnd) {
  const DriveConfig& drive = loop.drive();
  const auto settle = static_cast<std::int64_t>(std::llround(drive.run.settle_s / drive.T_s()));
  Figures figures;
  double square_sum = 0, speed_sum = 0, off_speed_s = 0;
  std::int64_t count = 0;
  for (std::int64_t k = 0; k < drive.steps(); ++k) {
    loop.tick();
    const double omega_m = loop.truth().omega_m, omega_m_ref = loop.reference().omega_m_ref;
    // In the first 0.1 s the rotor may oscillate backwards.
    if (loop.t_s() > 0.1 && omega_m * omega_m_ref < 0)
      figures.reversed_at_s = std::min(figures.reversed_at_s, loop.t_s());
    if (k < settle) continue;
    const double error = loop.angle_error();
    ++count;
    square_sum += error * error;
    speed_sum += omega_m;
    figures.angle_error_max = std::max(figures.angle_error_max, std::abs(error));
    if (std::abs(omega_m - omega_m_ref) > 0.2 * std::abs(omega_m_ref)) off_speed_s += drive.T_s();
    if (!loop.estimate().x_hat.allFinite() || !std::isfinite(omega_m)) figures.locked = false;
    figures.P44_min = std::min(figures.P44_min, loop.gain().P(3, 3));
    figures.P44_max = std::max(figures.P44_max, loop.gain().P(3, 3));
    if (until == Until::kLost && !(std::abs(error) <= kPi / 2)) break;
  }
  figures.speed_end = loop.truth().omega_m;
  figures.angle_error_rms = std::sqrt(square_sum / static_cast<double>(count));
  figures.speed_mean = speed_sum / static_cast<double>(count);
  if (!(figures.angle_error_max <= kPi / 2) || loop.tripped()) figures.locked = false;
  figures.speed_held = off_speed_s < 0.020;
  return figures;
}

inline Figures run(const std::string& preset, const Overrides& overrides = {},
                   Until until = Until::kEnd) {
  ClosedLoop loop(load(preset, overrides));
  return run(loop, until);
}

}  // namespace twinrate::test
