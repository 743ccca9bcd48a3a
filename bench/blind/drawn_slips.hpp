// Slips of a user on a log with nothing missing: a column or a key of the drive file has another
// meaning than its name. An effect named under `traced` is then a false claim, unless it describes
// the same error of the drive file: if R_s in the file is twice the true value, a `resistance` of
// minus half the file's value is right.
#pragma once
#include <string>
#include <vector>

#include "bench/blind/drawn_log.hpp"

namespace twinrate::blind {

struct Slip {
  const char* name;
  std::vector<std::string> same;  // kinds that describe the same error
  // Changes the log or the declared machine; false: this log has no such column.
  bool (*make)(DrawnMachine& declared, DrawnLog& log);
};

const std::vector<Slip>& slips();

}  // namespace twinrate::blind
