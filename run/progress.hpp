// Progress of a run: a line redrawn in place on a terminal, JSON lines with --json.
#pragma once
#include <chrono>
#include <string>

#include "core/drive_config.hpp"

namespace twinrate {

struct LiveCounters {
  std::int64_t losses = 0, misses = 0, repeats = 0;
};

class Progress {
 public:
  Progress(const DriveConfig& drive, bool json);
  // Cheap until the next line is due.
  void show(const Truth& truth, const Estimate& estimate, const LiveCounters& counters);
  void end();
  bool visible() const { return json_ || terminal_; }

 private:
  using Clock = std::chrono::steady_clock;
  void print(const Truth& truth, const Estimate& estimate, const LiveCounters& counters);

  int n_p_;
  double duration_s_, T_s_;
  bool endless_;
  bool json_, terminal_, drawn_ = false;
  std::int64_t calls_ = 0, k_then_ = 0;
  Clock::time_point last_;
};

// "2s", "500ms", "2" -> "2", "0.5", "2". Throws BadInput.
std::string seconds_text(const std::string& text);

// The override of run.duration_s. Throws BadInput, also for a time that a run cannot take.
std::string duration_override(const std::string& text);

// A run without an end of its own: --duration inf.
inline constexpr const char* kEndless = "inf";
inline constexpr double kEndless_s = 1e9;  // the longest run.duration_s
inline bool is_endless(const DriveConfig& drive) {
  return drive.run.duration_s >= kEndless_s;
}

}  // namespace twinrate
