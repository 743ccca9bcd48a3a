// How an effect is shown in the gallery (docs/effects-gallery.md): an example, the signal and the
// axis of its first picture, and three texts.
#pragma once

namespace twinrate {

struct Portrait {
  // Quantities of a tick, in the order of the gallery's table of signals.
  enum Signal : int {
    kNoSignal = -1,
    kIdTrue,
    kIqTrue,
    kId,
    kIq,
    kUd,
    kUq,
    kSpeed,
    kTo,
    kBus,
    kAngle
  };
  enum Over : int { kNoAxis = -1, kOverTurns, kOverTime, kOverSpeed };
  // 60 rpm against 2 Nm; or a reversal of the speed without load, in which a second mass shows.
  enum Drive : int { kSteady, kReversal };

  const char* parameters = "";  // of the example, TOML; further [[effect]] tables may follow
  Signal signal = kNoSignal;    // of the first two panels
  Over over = kNoAxis;          // axis of the first panel
  const char* equation = "";
  const char* shows = "";             // the signal in which it is visible
  const char* taken_for = "";         // other causes of the same picture
  int orders = 60;                    // of the spectrum
  bool switched = false;              // a second curve with the switched inverter
  double from_s = 3.48, to_s = 3.53;  // of kOverTime
  Drive drive = kSteady;
};

}  // namespace twinrate
