// Changes of a drive within a log: an effect begins, ends or changes.
//
// Two sets of effects, S_1 and S_2, are compared over the rows of one record. They are traced from
// the rows before a moment and from the rows after it. e_1, e_2: the whitened residuals under them.
//
//   suspicion   the coefficients of a candidate with columns x differ before and after a moment:
//               W = (b_2 - b_1)' (C_1 + C_2)^-1 (b_2 - b_1) > kSuspicious per coefficient. C is the
//               sum of the scatter of kBlocks blocks and of the covariance from white noise.
//               Columns that hold noise of the residual itself are left out: their bias changes
//               with the excitation
//   proof       each side is traced alone (its claims pass the gate there). On rows that no fit has
//               read, the error under S_1 is smaller before the moment and the error under S_2 is
//               smaller after it, both by Wilcoxon's signed-rank test over pieces. Otherwise no
//               change is reported. Neither is one if an effect passes its period too fast for the
//               rows of a side, which then show an alias, or if one side differs by a load alone: a
//               load step of the whole record
//   date        t = argmin_t sum_{k < t} e_1^2 + sum_{k >= t} e_2^2, with e not whitened, because
//               whitening would spread a step. Its range is where the sum is within kLikely of the
//               minimum, in units of the noise's square, plus the reach of the low-pass. Both sides
//               are traced again without the rows of that range and must prove the change again
//
// The proof is symmetric: an effect that the other side merely does not excite (rotor at rest, no
// current) is no change.
#pragma once
#include <string>
#include <vector>

#include "trace/tracer.hpp"

namespace twinrate {

struct Change {
  double t_s = 0, from_s = 0, to_s = 0;  // in the file's time; the range that contains it
  std::string between;                   // "a.csv and b.csv" if it is the border of two files
  std::string file;                      // set if there are several
  std::size_t first = 0, end = 0;        // rows of that range
};

// True if both sides are the same but for loads, by their kinds.
bool differ_by_a_load(const Effects& one, const Effects& two);

// As trace_record(). If the drive changes within the record, the result is that of the longest
// part: errors, pictures and stop-gaps are those of that part, and its effects have from_s and to_s
// (or files). The effects of the other parts are added.
TraceResult trace_with_changes(const Record& record, const DriveConfig& drive, const Health& health,
                               const TraceSettings& settings, std::vector<char> held_out);

}  // namespace twinrate
