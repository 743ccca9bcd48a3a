// Faults of one signal alone: values that leave and come back at once, and stretches that stand.
//
//   glitch  one to three rows that lie away from the parabola through the rows on each side: by far
//           more than those do, more than rows lie away as a rule, more than the signal's steps. A
//           step, an edge or an impact moves the rows behind it, too, and is none; nor is a voltage
//           that the current answers, or that answers a reading of it.
//   frozen  the value stands for 32 rows or more, then leaps: over more than any of the rows after
//           it goes, which change. A rotor that starts and a coarse converter do not leap so.
#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "trace/health.hpp"

namespace twinrate {

// How far rows lie away as a rule, of any number of rows in little memory: by quarters of an
// octave.
class Spread {
 public:
  void add(double distance);
  double sigma() const;  // from the 95 % quantile, as of a normal distance; 0 before the first one

 private:
  std::array<std::uint32_t, 512> bins_{};
  std::size_t count_ = 0;
};

class GlitchScan {
 public:
  // Looks at rows [first, end) of `raw`, whose neighbours are there as far as they go; marks them
  // in `bad`, one of each row.
  void look(const RawLog& raw, const std::vector<char>& stale, std::size_t first, std::size_t end,
            double T_s, std::vector<char>& bad);
  std::vector<SignalFault> found() const;

 private:
  struct Signal {
    Spread spread;
    double recently = 0;        // mean distance of the rows before, bounded
    double step = 0;            // smallest change from row to row
    double bad_until = -1e300;  // s, last row of the glitch before
  };
  struct Candidate {
    SignalFault fault;
    double distance = 0;
  };
  bool asked_for(const RawLog& raw, std::size_t k, double times_usual) const;
  bool answered(const RawLog& raw, std::size_t k, std::size_t rows) const;

  std::vector<Signal> signals_ = std::vector<Signal>(raw_columns().size());
  std::vector<Candidate> candidates_;
};

class FrozenScan {
 public:
  void add(const RawLog& raw, std::size_t k);
  const std::vector<SignalFault>& found() const { return found_; }

 private:
  static constexpr int kAfter = 8;  // rows that show whether the signal changes
  struct Signal {
    std::optional<double> before;
    SignalFault run;                  // that stands now
    std::size_t rows = 0;             // of it
    double step = 0;                  // smallest change
    std::optional<SignalFault> left;  // the one that was left, by
    double leap = 0, largest = 0;     // largest change since
    int since = 0, changed = 0;
  };
  void judge(Signal& signal);

  std::vector<Signal> signals_ = std::vector<Signal>(raw_columns().size());
  std::vector<SignalFault> found_;
};

}  // namespace twinrate
