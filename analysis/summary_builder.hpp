// Computes the figures of a run from its ticks, one after the other: for summarise() from a log in
// memory, for summarise_log() from a log of any length. Memory does not grow with the run, except
// for 8 bytes a turn of the rotor.
#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "analysis/summary.hpp"
#include "core/rate_history.hpp"

namespace twinrate {

inline constexpr double kSpeedTolerance = 0.2;  // relative to the reference
inline constexpr int kUnevenSides = 6;
inline constexpr double kSlopeSpan_s = 0.01;  // of the measured position

// Facts about the whole run that the figures need before its first tick.
struct RunOutline {
  // First and last tick of a channel, number of its messages and of its distinct ticks.
  struct Span {
    std::int64_t first = -1, last = -1, distinct = 0, count = 0;
    void add(std::int64_t k);
  };
  bool has_position = false, uses_position = false;  // kPosition; kMeasuredAngle
  bool last_is_forced = false;
  double begin_s = 0, end_s = 0;        // first and last row
  std::optional<double> handed_over_s;  // first row after the first forced ones
  bool was_forced = false;
  std::int64_t rows = 0, first_k = -1;
  std::array<Span, kChannelCount> spans;

  // A row, in order of time.
  void add(const TickRow& row);
  void add(Channel channel, std::int64_t k) { spans[static_cast<std::size_t>(channel)].add(k); }
  const Span& span(Channel channel) const { return spans[static_cast<std::size_t>(channel)]; }
  bool has_truth() const { return span(Channel::kTruth).count > 0; }
  // Resolves kAuto; kNone if the log does not hold the wanted reference.
  AngleReference resolve(AngleReference wanted) const;
};

// The true speed against a constant reference: time off it, largest deviations, unevenness a turn.
class SpeedFigures {
 public:
  explicit SpeedFigures(double T_s) : T_s_(T_s) {}
  void note_reference(const TickRow& row);
  void add(const TickRow& row, double omega_m);
  void write(Summary& summary);

 private:
  struct Turn {
    double begin = 0, least = 0, greatest = 0, sum = 0;
    std::int64_t count = 0;
  };
  bool held() const;
  // `theta_m` and `omega_m` in the direction of the reference.
  void add_to_turn(double theta_m, double omega_m);

  double T_s_;
  bool known_ = false, judged_ = false, reached_ = false;
  double omega_m_ref_ = 0, changed_s_ = 0;
  std::int64_t ticks_ = 0;
  double below_ = 0, above_ = 0;
  int side_ = 0, sides_ = 0;  // the side of the last excursion, and the number of changes of side
  Turn turn_;
  std::vector<double> unevenness_;
};

class SummaryBuilder {
 public:
  // Speed ripple: of the last ticks of the window.
  static constexpr std::size_t kRippleTicks = 1 << 20;

  // `head`: path, events and drive file of the log.
  SummaryBuilder(const RunLog& head, const RunOutline& outline, const DriveConfig& config,
                 AngleReference wanted);
  // The rows in order of time. omega_m: as computed by reference_speed().
  void add(const TickRow& row, double omega_m);
  Summary finish();

 private:
  struct Squares {
    double sum = 0;
    std::int64_t count = 0;
    void add(double value);
    std::optional<double> rms() const;
  };
  bool in_window(const TickRow& row) const;
  void set_trip(const RunLog& head);
  // `error`: of the angle.
  void judge_lock(const TickRow& row, double error);
  void add_errors(const TickRow& row, double error, double omega_m);
  void add_ripple(const TickRow& row);
  void add_gain(const TickRow& row);
  void set_lock();
  void set_ripple();
  void set_lost_messages();

  const RunOutline outline_;
  const DriveConfig config_;
  const RateHistory rates_;
  Summary summary_;
  double settled_s_ = 0;  // start of the window
  bool any_ = false, lost_ = false;
  SpeedFigures speed_;
  Squares angle_errors_, speed_errors_;
  double angle_max_ = 0;
  std::vector<double> theta_m_, omega_m_;  // of the window, with truth; a ring when full
  std::size_t oldest_ = 0;
  std::int64_t last_gain_ = -1, gains_sent_ = 0;
};

}  // namespace twinrate
