// The meaning of a row's voltage in a log without every tick: the mean up to the next row, or a
// tick's value.
#pragma once
#include <string>

#include "trace/scale_factors.hpp"

namespace twinrate {

// The meaning of a row's voltage in a log without every tick of the controller. If a tick's voltage
// is taken as the mean from row to row, which the voltage equation needs, its frame is half an
// interval late: this looks like another zero of the angle, or like a late voltage.
struct VoltageMeaning {
  std::string doubt;     // why it may be either; empty: it is one of them, or it hardly matters
  bool of_tick = false;  // a tick's value fits better
  // Remaining uncertainty: of the frame in rad, electrical (the turn of an interval too short to
  // distinguish the two, or of a tick), and of the moment in s. 0: none.
  double open_e = 0, open_s = 0;
  std::string told;  // the assumption; empty: the mean of the interval, and no uncertainty
};
VoltageMeaning voltage_meaning(const Record& record, const DriveFacts& facts);
// The record with the mean voltage up to the next row, from the ticks at both ends of the interval:
// half of each in rotor axes, in the middle of the interval, reduced by the factor that the mean of
// so many steps applies to a turning vector.
Record with_mean_of_ticks(const Record& record, const DriveFacts& facts);
// The scales with the meaning that fits better.
ScaleFactors scales_of(const Record& record, const DriveFacts& facts, Reading as = {});

}  // namespace twinrate
