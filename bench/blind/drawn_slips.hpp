// Mistakes of a user on a log with nothing missing: a column or a key of the drive file says what it
// does not mean. An effect named under `traced` is then a false claim, but for one that says the same
// of the drive file: an R_s of the file twice too large is a `resistance` of minus a half.
#pragma once
#include <string>
#include <vector>

#include "bench/blind/drawn_log.hpp"

namespace twinrate::blind {

struct Slip {
  const char* name;
  std::vector<std::string> same;  // kinds that say the same
  // Changes the log or what the drive file declares; false: this log has no such column.
  bool (*make)(DrawnMachine& declared, DrawnLog& log);
};

const std::vector<Slip>& slips();

}  // namespace twinrate::blind
