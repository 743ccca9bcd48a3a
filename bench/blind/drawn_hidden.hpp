// Effects that no kind of the catalogue describes, in the plant of a drawn case: a torque and a
// voltage as functions of the true state, held for a tick, and errors of the readings.
#pragma once
#include <functional>
#include <string>
#include <vector>

#include "bench/blind/drawn_machine.hpp"

namespace twinrate::blind {

struct HiddenPoint {
  double t = 0, theta_m = 0, omega_m = 0;  // s, rad, rad/s
  Vec2 i_dq = Vec2::Zero();                // A
};

// An empty function adds nothing.
struct HiddenEffect {
  std::string name;
  std::string depends_on;               // right axes of the residual, as in `where`
  std::vector<std::string> parts = {};  // kinds that describe a part of it
  std::function<double(const HiddenPoint&)> torque_Nm = {};  // opposes positive speed
  std::function<Vec2(const HiddenPoint&)> voltage_V = {};    // added to the winding, in d, q
  std::function<double(const HiddenPoint&)> angle_rad = {};  // error of the reading
  std::function<double(double)> current_A = {};              // reading of a phase
};

int hidden_count();
// Number `which` of them, with a size drawn in proportion to the machine.
HiddenEffect draw_hidden(int which, Draw& d, const DrawnMachine& drawn);

}  // namespace twinrate::blind
