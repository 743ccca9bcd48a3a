// The demand of a drive file on machine, inverter and rates.
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "core/config.hpp"
#include "model/frames.hpp"

namespace twinrate {

// Largest values of reference and load, and the limits. Electrical speed, peak phase values.
//   i_dq     = [0; T/K_t], or the MTPA point of T if the controller has current_angle = "mtpa",
//              T = T_load + B omega_m
//   u_needed = |R_s i_dq + omega_e [-L_q i_q; L_d i_d + psi_f]|
struct Demand {
  double omega_e = 0, emf = 0, u_needed = 0, u_max = 0, T_load = 0;
  Vec2 i_dq = Vec2::Zero();
  bool at_mtpa = false;
  std::optional<double> i_max, T_max;  // of the controller, if it has one: current and its torque
  std::optional<double> current_Hz, speed_Hz;  // bandwidths of the controller, if it has them
};
Demand demand_of(Config& config);

// One line for each demand beyond a limit, with file:line of its key.
std::vector<std::string> warnings_of(const Config& config, const Demand& demand);

}  // namespace twinrate
