// Effects of a drawn machine, with sizes in proportion to it.
#pragma once
#include <string>
#include <vector>

#include "bench/blind/drawn_machine.hpp"

namespace twinrate::blind {

struct DrawnLogFacts {
  const DrawnMachine& drawn;
  double rate_Hz = 0;     // of the rows
  double duration_s = 0;  // of the log
};

// The kinds that the plant simulates and that such a log can contain. Lost and repeated rows are
// drawn only for logs with every tick.
std::vector<std::string> kinds_for(bool every_tick);
// [[effect]] table of `kind`.
std::string draw_effect(const std::string& kind, Draw& d, const DrawnLogFacts& facts);

}  // namespace twinrate::blind
