// The voltage of a row in a log that has not every tick: the mean up to the next row, or a tick's.
#pragma once
#include <string>

#include "trace/scale_factors.hpp"

namespace twinrate {

// What the voltage of a row is, in a log that has not every tick of the controller. Taken for the mean
// from row to row, which the voltage equation needs, a tick's voltage has the frame of half an
// interval later: an angle with another zero, or a voltage that acts late.
struct VoltageMeaning {
  std::string doubt;     // why it is neither; empty: it is one of them, or it hardly matters
  bool of_tick = false;  // a tick's fits better
  // What is open of it: rad, electrical, of the frame (the turn of an interval too short to tell the
  // two apart; of a tick), and s of the moment. 0: nothing.
  double open_e = 0, open_s = 0;
  std::string told;  // what is assumed; empty: the mean of the interval, and nothing is open
};
VoltageMeaning voltage_meaning(const Record& record, const DriveFacts& facts);
// The record with the mean voltage up to the next row, by the ticks at both ends of the interval: in
// rotor axes half of each, in the middle of the interval, and less by what the mean of so many steps
// keeps of a vector that turns.
Record with_mean_of_ticks(const Record& record, const DriveFacts& facts);
// The scales with the one or the other, as it fits better.
ScaleFactors scales_of(const Record& record, const DriveFacts& facts, Reading as = {});

}  // namespace twinrate
