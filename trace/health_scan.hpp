// Health of a log of any length, collected piece by piece in little memory.
//
//   interval  mean of the steps of time within 30 % of their median (histogram of 1 % wide bins)
//   levels    of a current: the largest magnitude, the next one, and the number of samples at each
//   values    of a current: their number, as long as they are few enough to come from an ADC
#pragma once
#include <map>
#include <optional>
#include <unordered_map>

#include "trace/decimals.hpp"
#include "trace/health.hpp"
#include "trace/health_clock.hpp"
#include "trace/health_faults.hpp"
#include "trace/held_currents.hpp"
#include "trace/speed_against_angle.hpp"

namespace twinrate {

class SamplingInterval {
 public:
  void add(double step);
  double mean() const;  // 0 before the first step

 private:
  struct Bin {
    std::size_t count = 0;
    double sum = 0;
  };
  std::map<int, Bin> bins_;  // by logarithm of the step
  std::size_t count_ = 0;
};

// Finds a limit at which samples pile up.
class CurrentLevels {
 public:
  void add(double value);
  // 0: no limit. `times`: ratio of the samples at the limit to those just below it.
  double limit(double times = 5) const;
  double top() const { return top_; }
  std::size_t at_top() const { return at_top_; }
  std::size_t just_below() const { return at_next_; }
  std::size_t visits() const { return visits_; }  // of the top: runs of samples

 private:
  double top_ = 0, next_ = 0;                           // magnitudes
  std::size_t at_top_ = 0, at_next_ = 0, in_runs_ = 0;  // samples; in_runs: in runs of four or more
  std::size_t run_ = 0, visits_ = 0;
};

class CurrentValues {
 public:
  void add(double value);
  double step() const;  // between the values of a quantised signal; 0: not quantised

 private:
  std::unordered_map<std::int64_t, double> values_;  // by tenths of a uA
  std::size_t count_ = 0;
  bool quantised_ = true;
};

class HealthScan {
 public:
  // `encoder_counts`: of the drive file; 0: unknown.
  explicit HealthScan(int encoder_counts = 0) : angle_(encoder_counts) {}
  void add(const RawLog& piece);
  Health health() const;
  double T_s() const { return interval_.mean(); }

 private:
  void take(std::size_t end);  // rows of `ahead_` up to `end`
  void look_at_currents(std::size_t k);
  bool at_top(std::size_t k) const;
  void look_for_dead_signals(Health& health) const;
  Health result() const;

  SamplingInterval interval_;
  CurrentLevels a_, b_, any_;
  CurrentValues values_a_;
  AngleSteps angle_;
  HeldCurrents held_;
  SpeedAgainstAngle speed_;
  ClockScan clock_;
  GlitchScan glitches_;
  FrozenScan frozen_;
  struct Range {
    double lowest = 1e300, highest = -1e300;
    bool constant() const { return lowest == highest; }
  };
  std::vector<Range> ranges_ = std::vector<Range>(raw_columns().size());
  RawLog ahead_;           // rows whose neighbours have not arrived yet, and their neighbours
  std::size_t taken_ = 0;  // rows of it that were taken
  std::optional<double> t_before_, t_kept_;
  std::int64_t rows_since_kept_ = 0;
  std::size_t rows_ = 0, kept_ = 0, missing_ = 0, by_chance_ = 0;
  std::vector<Pause> gaps_, pauses_;  // the first of them
  std::size_t in_pauses_ = 0;         // rows
  std::map<int, std::size_t> stale_;  // rows, by logarithm of the missed angle
  double jitter_ = 0, i_sum_max_ = 0;
  Decimals decimals_;
};

}  // namespace twinrate
