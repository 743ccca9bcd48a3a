// The smallest drive file, line by line, and a parse of it.
#pragma once
#include <string>
#include <vector>

#include "core/config.hpp"

namespace twinrate::test {

inline std::string drive_text() {
  return "[machine]\n"               // line 1
         "R_s_Ohm = 1.2\n"           // 2
         "L_d_H = 0.5e-3\n"          // 3
         "L_q_H = 0.5e-3\n"          // 4
         "psi_f_Wb = 0.007\n"        // 5
         "n_p = 4\n"                 // 6
         "J_kgm2 = 1e-5\n"           // 7
         "B_Nms = 1e-5\n"            // 8
         "[inverter]\n"              // 9
         "v_dc_V = 24.0\n"           // 10
         "[rates]\n"                 // 11
         "f_s_Hz = 5000.0\n"         // 12
         "[reference]\n"             // 13
         "omega_e_rad_s = 400.0\n";  // 14
}

inline Config parse(const std::string& text, const std::vector<std::string>& overrides = {}) {
  return Config::parse(text, "drive.toml", overrides);
}

}  // namespace twinrate::test
