// Faults of one signal alone: values that leave and return at once, and constant stretches.
//
//   glitch  one to three rows far from the parabola through the rows on each side: by far more than
//           those rows, more than rows usually are, and more than the signal's steps. A step, an
//           edge or an impact moves the rows after it as well and is no glitch. Nor is a voltage to
//           which the current responds, or that responds to a current reading.
//   frozen  the value is constant for 32 rows or more and then leaps by more than any of the
//           following rows, which change. A rotor that starts and a coarse converter do not leap
//           so.
#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "trace/health.hpp"

namespace twinrate {

// Usual distance of rows from the parabola, for any number of rows in little memory: a histogram
// with bins of a quarter octave.
class Spread {
 public:
  void add(double distance);
  double sigma() const;  // from the 95 % quantile, as of a normal distance; 0 before the first row

 private:
  std::array<std::uint32_t, 512> bins_{};
  std::size_t count_ = 0;
};

class GlitchScan {
 public:
  // Checks rows [first, end) of `raw` with the neighbours that it holds. Marks glitches in `bad`,
  // which has one entry a row.
  void look(const RawLog& raw, const std::vector<char>& stale, std::size_t first, std::size_t end,
            double T_s, std::vector<char>& bad);
  std::vector<SignalFault> found() const;

 private:
  struct Signal {
    Spread spread;
    double recently = 0;        // mean distance of the latest rows, bounded
    double step = 0;            // smallest change from row to row
    double bad_until = -1e300;  // s, last row of the latest glitch
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
    SignalFault run;                  // the current constant run
    std::size_t rows = 0;             // of the run
    double step = 0;                  // smallest change
    std::optional<SignalFault> left;  // the run that ended
    double leap = 0, largest = 0;     // change at its end, largest change since
    int since = 0, changed = 0;       // rows since, and those of them that changed
  };
  void judge(Signal& signal);

  std::vector<Signal> signals_ = std::vector<Signal>(raw_columns().size());
  std::vector<SignalFault> found_;
};

}  // namespace twinrate
