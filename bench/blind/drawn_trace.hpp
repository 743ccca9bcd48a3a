// The blind test on drawn machines: draws logs, runs `twinrate trace` on each and compares.
#pragma once
#include <cstdint>
#include <string>

namespace twinrate::blind {

struct DrawnOptions {
  std::string set;  // A: to set thresholds, B: to ablate them, C: once a release; "": first_seed
  std::uint64_t first_seed = 1;
  int logs = 0;  // 0: those of the set
  int threads = 1;
  std::string only;     // text of the name
  std::string keep;     // directory for drive files, logs and truths; "": they are removed
  bool traced = false;  // take the traces that `keep` holds
  std::string out;      // JSON
  std::string tracer;   // the program twinrate
};

int run_drawn(const DrawnOptions& options);

}  // namespace twinrate::blind
