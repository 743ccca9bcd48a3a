// A generator of the speed reference as a process of its own (reference.from_bus = true).
//
//   MEASUREMENT(k) -> [omega_m_ref(t_k)] -> REFERENCE(k)
//
//   int main(int argc, char** argv) {
//     return twinrate::run_reference("my_profile", argc, argv,
//                                    [](const twinrate::DriveConfig&, double t_s) { return ..; });
//   }
#pragma once
#include <functional>

#include "core/drive_config.hpp"

namespace twinrate {

// Speed reference at drive time t_s, rad/s mechanical.
using SpeedReference = std::function<double(const DriveConfig& drive, double t_s)>;

// Reads the options of every process (--help lists them) and runs until the end of the drive.
// `program`: its name in messages. Returns the exit code.
int run_reference(const char* program, int argc, char** argv, const SpeedReference& omega_m_ref);

}  // namespace twinrate
