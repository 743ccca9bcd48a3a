#include "run/progress.hpp"

#include <fmt/format.h>
#include <poll.h>
#include <unistd.h>

#include <cstdio>

#include "core/config.hpp"

namespace twinrate {
namespace {

// A reader that stops reading (Ctrl-S, a full pipe) must not halt the process that watches the drive:
// in realtime the plant takes its silence for its end.
bool has_room(int file) {
  pollfd end{.fd = file, .events = POLLOUT};
  return poll(&end, 1, 0) > 0;  // also where nobody reads any more: a write ends the program then
}

}  // namespace

Progress::Progress(const DriveConfig& drive, bool json)
    : n_p_(drive.machine.n_p),
      duration_s_(drive.run.duration_s),
      T_s_(drive.T_s()),
      endless_(is_endless(drive)),
      json_(json),
      terminal_(isatty(STDERR_FILENO) != 0),
      last_(Clock::now()) {}

void Progress::show(const Truth& truth, const Estimate& estimate, const LiveCounters& counters) {
  if (!visible()) return;
  if ((++calls_ & 255) != 0) return;  // reads the clock once in 256 calls
  const double since = std::chrono::duration<double>(Clock::now() - last_).count();
  if (since < 0.2 || !has_room(json_ ? STDOUT_FILENO : STDERR_FILENO)) return;
  print(truth, estimate, counters);
}

void Progress::print(const Truth& truth, const Estimate& estimate, const LiveCounters& counters) {
  const auto now = Clock::now();
  const double since = std::chrono::duration<double>(now - last_).count();
  const double rate = static_cast<double>(estimate.k - k_then_) / since;
  last_ = now;
  k_then_ = estimate.k;
  const double t_s = static_cast<double>(estimate.k) * T_s_;
  const bool has_truth = truth.k == estimate.k;
  const double error_deg = wrap_pi(estimate.theta_e - n_p_ * truth.theta_m) * 180 / kPi;
  if (json_) {
    fmt::print(
        "{{\"t_s\": {:.4f}, \"share\": {:.4f}, \"omega_m_rad_s\": {:.4f}, \"angle_error_rad\": {}, "
        "\"steps_per_s\": {:.0f}, \"misses\": {}, \"losses\": {}, \"repeats\": {}}}\n",
        t_s, endless_ ? 0 : t_s / duration_s_, estimate.omega_m,
        has_truth ? fmt::format("{:.5f}", error_deg * kPi / 180) : "null", rate, counters.misses,
        counters.losses, counters.repeats);
    std::fflush(stdout);
    return;
  }
  fmt::print(stderr,
             "\r\033[K{:6.2f} of {} s  speed {:7.1f} rad/s el.  angle error {}  {:6.0f} steps/s  "
             "misses {}  losses {}",
             t_s, endless_ ? kEndless : fmt::format("{:.2f}", duration_s_), estimate.omega_m * n_p_,
             has_truth ? fmt::format("{:6.2f} deg", error_deg) : "no truth", rate, counters.misses,
             counters.losses);
  std::fflush(stderr);
  drawn_ = true;
}

void Progress::end() {
  if (drawn_) fmt::print(stderr, "\r\033[K");
}

std::string seconds_text(const std::string& text) {
  std::size_t used = 0;
  double number = 0;
  try {
    number = std::stod(text, &used);
  } catch (const std::exception&) {
    used = 0;
  }
  const std::string unit = text.substr(used);
  if (used == 0 || (unit != "" && unit != "s" && unit != "ms" && unit != "min"))
    throw BadInput(fmt::format("--duration {}: a time such as 2s, 500ms or 5min allowed", text));
  const double scale = unit == "ms" ? 1e-3 : unit == "min" ? 60 : 1;
  return fmt::format("{}", number * scale);
}

std::string duration_override(const std::string& text) {
  const std::string seconds = seconds_text(text);
  const double number = std::stod(seconds);
  if (!(number >= 1e-3 && number <= kEndless_s))  // as run.duration_s
    throw BadInput(fmt::format("--duration {}: 0.001 to {:.0f} s allowed", text, kEndless_s));
  return "run.duration_s=" + seconds;
}

}  // namespace twinrate
