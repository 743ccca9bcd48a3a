// The blind test on drawn machines: draws logs, runs `twinrate trace` on each and compares the
// result with the truth.
//
// `spoilt` adds to logs with no effect of the catalogue
//   slips    a slip of the user each (bench/blind/drawn_slips.hpp), all of them on each machine
//   hidden   an effect outside the catalogue each (bench/blind/drawn_hidden.hpp), each on a new
//            machine
// `foreign` draws the logs from a plant, a control and motions that share no code with the project's.
// Which effects such a log can show is not known: all count as shown.
//
// A kind named under `traced` is then false, unless it describes the slip, or a part of the effect.
#pragma once
#include <cstdint>
#include <string>

namespace twinrate::blind {

struct DrawnOptions {
  std::string set;  // A: to set thresholds, B: to ablate them, C: once a release; "": first_seed
  std::uint64_t first_seed = 1;
  int logs = 0;  // 0: those of the set
  int threads = 1;
  std::string only;                 // text that the name contains
  std::string spoilt;               // slips, hidden; "": logs as drawn
  std::string profile, mode, kind;  // only cases of these; "": any
  std::string keep;      // directory for drive files, logs and truths; "": they are removed
  bool foreign = false;  // logs of a plant that shares no code with the project's (foreign_log.hpp)
  bool traced = false;   // take the traces that `keep` holds
  std::string out;       // JSON
  std::string tracer;    // the program twinrate
};

int run_drawn(const DrawnOptions& options);

}  // namespace twinrate::blind
