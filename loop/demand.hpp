// The demand of a drive file on machine, inverter and rates.
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "core/config.hpp"

namespace twinrate {

// Largest values of reference and load, and the limits. Electrical speed, peak phase values.
//   i_q      = (T_load + B omega_m)/K_t
//   u_needed = |[omega_e L_q i_q, omega_e psi_f + R_s i_q]|
struct Demand {
  double omega_e = 0, emf = 0, u_needed = 0, u_max = 0, T_load = 0, i_q = 0;
  std::optional<double> i_max, current_Hz, speed_Hz;  // of the controller, if it has them
};
Demand demand_of(Config& config);

// One line for each demand beyond a limit, with file:line of its key.
std::vector<std::string> warnings_of(const Config& config, const Demand& demand);

}  // namespace twinrate
