#include "identify/spin_run.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace twinrate {
namespace {

constexpr double kVoltageShare = 0.6;  // of u_max: where the first run-up ends
constexpr double kCoastSpeeds[] = {1, 0.45, 0.2};

class Spinner {
 public:
  Spinner(Experiment& e, const Identified& found) : e_(e), found_(found) {
    e_.begin_control(Vec2::Zero());
    before_ = theta_e();
  }
  double omega_e() const { return omega_e_; }
  double u() const { return u_; }  // V, amplitude, smoothed like the speed

  void tick(double i_q) {
    // The angle is quantised, so its difference is smoothed over some fifty ticks. A reversal of
    // the current takes forty ticks: at 0.2 rad a tick the loop overshoots a sudden step of twice
    // the test current by more than half of it.
    constexpr double kShare = 0.02, kSlew = 0.05;
    i_ref_ += std::clamp(i_q - i_ref_, -kSlew * e_.i_max(), kSlew * e_.i_max());
    const Row& row = e_.control(Vec2(0, i_ref_), before_, omega_e_);
    const double now = found_.n_p * (row.theta - found_.theta_zero);
    omega_e_ += kShare * ((now - before_) / e_.T_s() - omega_e_);
    u_ += kShare * (row.u.norm() - u_);
    before_ = now;
  }
  // Runs until `done()`; false if the time ends first.
  template <class Done>
  bool run(double i_q, double longest_s, Done done) {
    for (int k = 0; k < e_.ticks(longest_s); ++k) {
      tick(i_q);
      if (done()) return true;
    }
    return false;
  }
  // Accelerates or brakes to an electrical speed.
  bool go_to(double omega_e, double i, double longest_s) {
    const bool up = omega_e > omega_e_;
    return run(up ? i : -i, longest_s,
               [&] { return up ? omega_e_ >= omega_e : omega_e_ <= omega_e; });
  }

 private:
  double theta_e() const { return found_.n_p * (e_.now().theta - found_.theta_zero); }

  Experiment& e_;
  const Identified& found_;
  double before_ = 0, omega_e_ = 0, u_ = 0, i_ref_ = 0;
};

// A voltage that acts m ticks late lags the EMF by m omega_e T_s in angle. Meanwhile the current
// grows by about
//   |u| omega_e (m T_s)^2/(2 L)
bool lateness_limits(const Experiment& e, const Spinner& spinner) {
  constexpr double kMost = 0.6;  // of i_max; at twice i_max the experiment ends
  const double late = (e.late_ticks() + (e.late_ticks() > 0 ? 1 : 0)) * e.T_s();
  return spinner.u() * std::abs(spinner.omega_e()) * late * late / (2 * e.inductance()) >
         kMost * e.i_max();
}

// The largest electrical speed of the runs.
double run_up(Experiment& e, Spinner& spinner, const Identified& found) {
  constexpr double kPatience_s = 15, kRelease_s = 0.1;
  const double limit = e.omega_m_max() > 0 ? found.n_p * e.omega_m_max() : INFINITY;
  const auto at_the_top = [&] {
    return spinner.u() > kVoltageShare * e.u_max() || spinner.omega_e() > 0.95 * limit ||
           lateness_limits(e, spinner);
  };
  spinner.run(0, kRelease_s, [] { return false; });  // decay of the current that held the rotor
  for (const double share : {0.3, 1.0})
    if (spinner.run(share * e.i_max(), kPatience_s, at_the_top)) return spinner.omega_e();
  if (spinner.omega_e() * e.T_s() < 1e-3)
    throw RunFailed(fmt::format("the shaft does not turn at {:.3g} A", e.i_max()));
  return spinner.omega_e();
}

// In a small speed range the ramps are too short for J and friction. These ramps have a lower
// current, for some 600 rows, down to a tenth of the smallest level.
void slow_ramps(Experiment& e, Spinner& spinner, double top, std::vector<SpinRun>& segments) {
  constexpr double kRows = 600, kLongest_s = 3, kLeast = 0.1;  // of the smallest level
  double rows = kRows;
  for (const SpinRun& s : segments)
    if (s.level == 0) rows = std::min(rows, static_cast<double>(s.rows.size()));
  const double i = kLevels[0] * e.i_max() * std::max(kLeast, rows / kRows);
  for (int repeat = 0; repeat < 3; ++repeat)
    for (const int sign : {-1, 1}) {
      SpinRun s;
      e.record(&s.rows);
      const bool there = spinner.go_to(sign * top, i, kLongest_s);
      e.record(nullptr);
      if (!there) spinner.go_to(sign * top, e.i_max(), kLongest_s);
      segments.push_back(std::move(s));
    }
}

constexpr double kLongestMove_s = 12;

void ramps(Experiment& e, Spinner& spinner, double top, std::vector<SpinRun>& segments) {
  constexpr double kEnough_s = 20;
  const double begin = e.seconds();
  for (int repeat = 0; repeat < 3; ++repeat) {
    if (repeat == 2 && e.seconds() - begin > kEnough_s) break;
    for (int level = 0; level < kLevelCount; ++level) {
      for (const int sign : {-1, 1}) {
        SpinRun s{.rows = {}, .level = level};
        e.record(&s.rows);
        const bool there = spinner.go_to(sign * top, kLevels[level] * e.i_max(), kLongestMove_s);
        e.record(nullptr);
        if (!there) spinner.go_to(sign * top, e.i_max(), kLongestMove_s);
        segments.push_back(std::move(s));
      }
    }
    e.show("spin", 0.6 + 0.08 * repeat);
  }
}

void coasts(Experiment& e, Spinner& spinner, double top, std::vector<SpinRun>& segments) {
  constexpr double kCoast_s = 6;
  for (const double share : kCoastSpeeds) {
    for (const int sign : {1, -1}) {
      spinner.go_to(sign * share * top, 0.5 * e.i_max(), kLongestMove_s);
      spinner.run(0, 2e-3, [] { return false; });
      SpinRun s;
      e.record(&s.rows);
      spinner.run(0, kCoast_s, [&] { return sign * spinner.omega_e() < 0.4 * share * top; });
      e.record(nullptr);
      segments.push_back(std::move(s));
    }
    e.show("coast", 0.85);
  }
}

}  // namespace

std::vector<SpinRun> run_spin(Experiment& e, Identified& found) {
  std::vector<SpinRun> segments;
  Spinner spinner(e, found);
  const double top = run_up(e, spinner, found);
  found.omega_m_max = top / found.n_p;
  const bool lateness_limited = lateness_limits(e, spinner);
  if (lateness_limited)
    found.notes.push_back(
        fmt::format("link: voltages acted up to {} ticks late, so the speed ended at {:.4g} rpm: "
                    "the figures of "
                    "the turning motor are less exact than they could be",
                    e.late_ticks(), found.omega_m_max * 60 / kTwoPi));
  ramps(e, spinner, top, segments);
  if (lateness_limited) slow_ramps(e, spinner, top, segments);
  coasts(e, spinner, top, segments);
  spinner.go_to(0, 0.5 * e.i_max(), kLongestMove_s);
  return segments;
}

double speed_about(const Rows& rows, std::size_t k, double T_s) {
  constexpr std::size_t kWindow = 8;
  const std::size_t a = k > kWindow ? k - kWindow : 0, b = std::min(rows.size() - 1, k + kWindow);
  return (rows[b].theta - rows[a].theta) / (static_cast<double>(b - a) * T_s);
}

}  // namespace twinrate
