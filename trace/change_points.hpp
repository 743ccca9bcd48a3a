// A drive that is not the same throughout a log: something begins, ends or changes.
//
// Two sets of effects are compared over the rows of one record, S_1 and S_2, the answers of the
// rows before a moment and of those behind it. e_1, e_2: the whitened residuals under them.
//
//   suspicion   of a candidate with columns x: its coefficients before and behind a moment differ,
//               W = (b_2 - b_1)' (C_1 + C_2)^-1 (b_2 - b_1) > kSuspicious for each of them, C from
//               the scatter of kBlocks blocks and from white noise. Columns that hold noise of the
//               residual itself are not asked: their bias goes with the excitation
//   proof       each side is traced for itself (its claims pass the gate there), and on rows that
//               no fit has read the error under S_1 is smaller before and under S_2 behind, both by
//               Wilcoxon's signed-rank test over pieces. Else no change is told
//   date        t = argmin_t sum_{k < t} e_1^2 + sum_{k >= t} e_2^2, e not whitened, which would
//               spread a step; its range is where that sum is within kLikely of the least, in units
//               of the noise's square, and the low-pass's reach. Both sides are then traced again
//               without the rows of that range, and have to prove the change once more
//
// The proof is symmetric: an effect that the other side would only not show (rotor at rest, no
// current) is no change.
#pragma once
#include <string>
#include <vector>

#include "trace/tracer.hpp"

namespace twinrate {

struct Change {
  double t_s = 0, from_s = 0, to_s = 0;  // in the file's time; the range that it may lie in
  std::string between;                   // "a.csv and b.csv" where it is the border of two files
  std::string file;                      // where there are several
  std::size_t first = 0, end = 0;        // rows of that range
};

// As trace_record(). Where the drive changes within the record, the longest part makes up the
// result: errors, pictures and stop-gaps are its own, effects have from_s and to_s (or files), and
// those of the other parts stand beside them.
TraceResult trace_with_changes(const Record& record, const DriveConfig& drive, const Health& health,
                               const TraceSettings& settings, std::vector<char> held_out);

}  // namespace twinrate
