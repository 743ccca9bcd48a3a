// A drawn machine, motion and logger for the foreign plant, and the effects and errors of readings
// that its drive file lacks.
#pragma once
#include <array>
#include <functional>

#include "bench/blind/drawn_case.hpp"
#include "bench/blind/foreign_plant.hpp"

namespace twinrate::blind {

// Errors of the readings.
struct ForeignSensors {
  std::array<double, 3> offset_A{}, gain{};
  double clip_A = 0;
  double offset_rad = 0, eccentric_rad = 0, eccentric_phase = 0;
  double late_current_s = 0, late_angle_s = 0;
  double stale = 0, missing = 0;  // shares of rows
  bool stale_currents_only = false;
};

struct ForeignCase {
  DrawnCase header;  // machine, profile, mode, kinds
  ForeignEffects plant;
  ForeignSensors sensors;
  bool decoupled = true;
  double dither_V = 0, integral = 0.3, before_s = 0;
};

// References in time.
struct Motion {
  std::function<double(double)> speed, i_d = [](double) { return 0.0; };
  std::function<double(double)> load = [](double) { return 0.0; };
  bool jumps = true;                // the reference is slewed; false: it is followed as it is
  double turn_around = 0, i_q = 0;  // of profile torque: rad/s, A
};

// Half of the seeds have no effect, the others one to three.
ForeignCase draw_foreign_case(Draw& d, std::uint64_t seed, int attempt);
Motion draw_motion(Draw& d, ForeignCase& which);

}  // namespace twinrate::blind
