// The voltage of a row in a log that has not every tick: the mean up to the next row, or a tick's.
#pragma once
#include <string>

#include "trace/scale_factors.hpp"

namespace twinrate {

// What the voltage of a row is, in a log that has not every tick of the controller. Taken for the mean
// from row to row, which the voltage equation needs, a tick's voltage has the frame of half an
// interval later: an angle with another zero, or a voltage that acts late.
struct VoltageMeaning {
  std::string doubt;     // why it is not that mean; empty: it is, or it hardly matters
  double open_e = 0;     // rad, electrical: turn of an interval too short to tell the two apart
  bool of_tick = false;  // where that is open: a tick's fits better
};
VoltageMeaning voltage_meaning(const Record& record, const DriveFacts& facts);
// The record with each tick's voltage turned to the middle of its interval: a slow rotor's mean.
Record with_mean_of_ticks(const Record& record, const DriveFacts& facts);
// The scales with the one or the other, as it fits better.
ScaleFactors scales_of(const Record& record, const DriveFacts& facts, Reading as = {});

}  // namespace twinrate
