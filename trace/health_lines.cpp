#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "trace/health.hpp"

namespace twinrate {
namespace {

// Number of faults of each signal, and the first.
std::string by_signal(const std::vector<SignalFault>& faults) {
  std::vector<std::string> parts;
  for (std::size_t c = 0; c < raw_columns().size(); ++c) {
    const auto here = [&](const SignalFault& fault) { return fault.column == c; };
    const auto first = std::find_if(faults.begin(), faults.end(), here);
    if (first == faults.end()) continue;
    parts.push_back(fmt::format("{} in {} (the first at {:.6g} s)",
                                std::count_if(faults.begin(), faults.end(), here),
                                raw_columns()[c].name, first->t_begin));
  }
  return fmt::format("{}", fmt::join(parts, ", "));
}

}  // namespace

std::vector<std::string> Health::lines() const {
  std::vector<std::string> lines;
  if (no_angle)
    lines.emplace_back("no angle in the log: the rotor is assumed at standstill at theta_m = 0");
  if (i_q_alone) lines.emplace_back("no i_d in the log: assumed 0");
  if (!constant.empty()) {
    std::vector<std::string> names;
    for (std::size_t c : constant) names.emplace_back(raw_columns()[c].name);
    lines.push_back(fmt::format("the same value in every row: {}", fmt::join(names, ", ")));
  }
  if (angle.lsb > 0)
    lines.push_back(fmt::format("theta_m has {} counts a turn{}", angle.counts(),
                                angle.centre > 0
                                    ? "; a reading is taken for the centre of its count, half a "
                                      "count above where a counter leaves it"
                                    : ", read at their centres"));
  if (!glitches.empty()) lines.push_back(fmt::format("glitches: {}; bridged", by_signal(glitches)));
  if (!frozen.empty()) {
    double longest = 0;
    for (const SignalFault& fault : frozen)
      longest = std::max(longest, fault.t_end - fault.t_begin);
    lines.push_back(
        fmt::format("frozen signals: {}; up to {:.3g} s, left out", by_signal(frozen), longest));
  }
  for (const Pause& pause : pauses)
    lines.push_back(fmt::format("no rows from {:.6g} to {:.6g} s", pause.t_begin, pause.t_end));
  if (stray)
    lines.push_back(fmt::format(
        "time stamps jitter by {:.3g} us rms; rows are treated as even, every {:.6g} us",
        1e6 * jitter * T_s, 1e6 * T_s));
  if (uneven)
    lines.push_back(
        fmt::format("uneven sampling, intervals differ by {:.3g} us rms; resampled to every {:.6g} "
                    "us: voltage as its mean, other signals interpolated",
                    1e6 * jitter * T_s, 1e6 * T_s));
  if (speed_lag > 0)
    lines.push_back(
        fmt::format("omega_m lags theta_m by {:.3g} ms; no equation uses it", 1e3 * speed_lag));
  if (speed_scale != 1)
    lines.push_back(fmt::format("omega_m is {:.4g} times the speed of theta_m; no equation uses it",
                                speed_scale));
  return lines;
}

}  // namespace twinrate
