// A log corrected with one model of the drive, row by row: the start of every model run, and its
// inputs.
#pragma once
#include <vector>

#include "core/drive_config.hpp"
#include "model/effects/shaft.hpp"
#include "trace/record.hpp"

namespace twinrate {

struct FollowedLog {
  // Readings without the model's sensing effects; a delayed reading is moved back to its instant.
  std::vector<Vec2> i_alphabeta;
  std::vector<double> theta_m, omega_m;  // omega_m: slope of theta_m
  std::size_t rows_late = 0;             // largest delay of a reading, whole rows
  std::vector<Vec2> u_alphabeta;         // logged voltage with the model's voltage delay
  std::vector<double> T_load;            // declared; 0 without one in the log
  std::vector<ShaftState> load_mass;     // computed from theta_m; empty without a shaft
};

// Number of measured currents; with 2, i_c = -(i_a + i_b). The smaller number of log and drive
// file.
int current_sensors(const Record& record, const DriveConfig& drive);
FollowedLog followed(const Record& record, const DriveConfig& drive);

// Slope of the least-squares line through the rows k - h .. k + h; h <= kSlopeRows, smaller near
// the ends.
inline constexpr int kSlopeRows = 10;
double slope(const std::vector<double>& x, std::size_t k, double T_s);

}  // namespace twinrate
