// ripple_table: the speed ripple of Niewiara's drive, without compensation and with every one, with its
// encoder and without: the table of docs/ripple-reduction.md.
//
//   ripple_table [DRIVE]          default: docs/sensorless-ripple-drive.toml
//
// With encoder: preset niewiara2020, compensation off, the paper's, the paper's with L = -3000, harmonic
// states of the load, and adaptive feed-forward over the angle. Without: DRIVE (ekf_joint), compensation
// off and "paper", a gain every n = 1, 5, 10 ticks. rad/s rms of the true speed over 6 turns; "lost" if
// the angle error exceeds 90 deg. The turns begin 3 s after the start; what learns over turns
// (harmonic, angle domain) has 30 turns before them.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iostream>

#include "core/config.hpp"
#include "core/report_error.hpp"
#include "loop/closed_loop.hpp"

namespace twinrate {
namespace {

using Overrides = std::vector<std::string>;

constexpr std::array<double, 4> kSpeeds_rpm{10, 20, 30, 50};
constexpr double kFrom_s = 3;
constexpr int kTurns = 6, kLearningTurns = 30;

struct Ripple {
  double rms = 0;              // of omega_m, rad/s
  double angle_error_max = 0;  // rad, 0 with an encoder
  bool lost = false;
};

class Sum {
 public:
  void add(double value) {
    ++count_;
    const double off = value - mean_;
    mean_ += off / count_;
    square_ += off * (value - mean_);
  }
  double rms_about_mean() const { return std::sqrt(square_ / count_); }

 private:
  double count_ = 0, mean_ = 0, square_ = 0;
};

Ripple ripple(const std::string& drive, double speed_rpm, double turns_before,
              Overrides overrides) {
  const double from_s = kFrom_s + 60 / speed_rpm * turns_before;
  overrides.push_back(fmt::format("reference.speed_rpm={}", speed_rpm));
  Config config = Config::load(drive, overrides);
  const DriveConfig d = config.drive();
  ClosedLoop loop(config);
  Ripple found;
  Sum speed;
  double from_rad = NAN;
  for (;;) {
    const TickRecord& tick = loop.step();
    const double error = wrap_pi(tick.estimate.theta_e - d.machine.n_p * tick.truth.theta_m);
    found.lost = std::abs(error) > kPi / 2 || !std::isfinite(tick.truth.omega_m);
    if (found.lost) return found;
    const double t_s = static_cast<double>(tick.measurement.k) * d.T_s();
    found.lost = t_s > from_s + 4 * kTurns * 60 / speed_rpm;  // it does not turn
    if (found.lost) return found;
    if (t_s < from_s) continue;
    if (std::isnan(from_rad)) from_rad = tick.truth.theta_m;
    if (tick.truth.theta_m - from_rad >= kTwoPi * kTurns) break;
    if (!(tick.estimate.status & kMeasuredAngle))
      found.angle_error_max = std::max(found.angle_error_max, std::abs(error));
    speed.add(tick.truth.omega_m);
  }
  found.rms = speed.rms_about_mean();
  return found;
}

void print_row(const std::string& name, const std::string& drive, const Overrides& overrides,
               double turns_before = 0) {
  fmt::print("{:<34}", name);
  double angle_error_max = 0;
  for (const double speed_rpm : kSpeeds_rpm) {
    const Ripple r = ripple(drive, speed_rpm, turns_before, overrides);
    fmt::print(" {:>7}", r.lost ? "lost" : fmt::format("{:.4f}", r.rms));
    std::cout.flush();
    angle_error_max = std::max(angle_error_max, r.angle_error_max);
  }
  fmt::print("  {}\n",
             angle_error_max > 0 ? fmt::format("{:.1f} deg", angle_error_max * 180 / kPi) : "-");
}

void print_table(const std::string& sensorless) {
  fmt::print("{:<34}", "rpm");
  for (const double speed_rpm : kSpeeds_rpm) fmt::print(" {:>7}", speed_rpm);
  fmt::print("  largest angle error\n");
  const std::string encoder = "niewiara2020", paper = "controller.compensation=paper";
  print_row("encoder, off", encoder, {"controller.compensation=off"});
  print_row("encoder, paper, L = -700", encoder, {paper});
  print_row("encoder, paper, L = -3000", encoder,
            {paper, "estimator.ekf_disturbance.L_Nm_rad=-3000"});
  print_row("encoder, harmonic, n = 10", encoder,
            {paper, "estimator.kind=ekf_harmonic", "rates.n=10"}, kLearningTurns);
  print_row("encoder, angle domain", encoder, {"controller.compensation=angle_domain"},
            kLearningTurns);
  print_row("ekf_joint, off, n = 1", sensorless, {"controller.compensation=off"});
  for (const int n : {1, 5, 10})
    print_row(fmt::format("ekf_joint, paper, n = {}", n), sensorless,
              {paper, fmt::format("rates.n={}", n)});
}

}  // namespace
}  // namespace twinrate

int main(int argc, char** argv) try {
  twinrate::print_table(argc > 1 ? argv[1] : "docs/sensorless-ripple-drive.toml");
} catch (...) {
  return twinrate::report_error("ripple_table");
}
