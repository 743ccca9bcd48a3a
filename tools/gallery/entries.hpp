// What the gallery shows of each effect, and says of it.
#pragma once
#include <span>

namespace twinrate::gallery {

// Quantities of a tick, in the order of kSignals.
enum class Signal : int { kIdTrue, kIqTrue, kId, kIq, kUd, kUq, kSpeed, kTo, kBus, kAngle };

// What the first panel is drawn over.
enum class Over : int { kTurns, kTime, kSpeed };

struct Entry {
  const char* kind;        // of an effect, or a name for what a key of [sensors] does
  const char* parameters;  // of the example, TOML; further [[effect]] tables may follow
  Signal signal;           // first two panels
  Over over;
  const char* equation;
  const char* shows;
  const char* aliases;
  int orders = 60;                    // of the spectrum
  bool switched = false;              // a second curve with the switched inverter
  double from_s = 3.48, to_s = 3.53;  // of Over::kTime
  const char* setting = nullptr;      // key=value instead of an effect
  const char* drive = nullptr;        // TOML of the run, instead of 60 rpm against 2 Nm
};

std::span<const Entry> entries();

}  // namespace twinrate::gallery
