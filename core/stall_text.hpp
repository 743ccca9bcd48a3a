// The stalls of a realtime plant in the text of its events `overrun`: written by the plant, read by
// the report of the run.
#pragma once
#include <cstdint>
#include <optional>
#include <string>

namespace twinrate {

// Since the begin of the run.
struct StallCount {
  std::int64_t stalls = 0;
  double stood_s = 0;    // during which the plant's clock did not advance
  double longest_s = 0;  // by which a tick began late
};

// " (12 stalls, 0.043210 s in all, 0.012800 s at most)"
std::string stall_text(const StallCount& count);
// Of a text that ends with it.
std::optional<StallCount> stall_count_in(const std::string& text);

}  // namespace twinrate
