// A log as one model of the drive takes it, row by row: what every stretch of it starts from and
// what acts along it.
#pragma once
#include <vector>

#include "core/drive_config.hpp"
#include "model/effects/shaft.hpp"
#include "trace/record.hpp"

namespace twinrate {

struct FollowedLog {
  // Readings less what the model's sensors add. A late one stands where it was true.
  std::vector<Vec2> i_alphabeta;
  std::vector<double> theta_m, omega_m;  // the latter the angle's slope
  std::size_t rows_late = 0;             // of the latest one, whole rows
  std::vector<Vec2> u_alphabeta;         // the logged voltage as it acts, which may be late, too
  std::vector<double> T_load;            // declared, 0 where the log has none
  std::vector<ShaftState> load_mass;     // followed behind the angle; empty without a shaft
};

// Currents that are measured one by one: with two the third is -(i_a + i_b). The log may show two
// where the drive file says three.
int current_sensors(const Record& record, const DriveConfig& drive);
FollowedLog followed(const Record& record, const DriveConfig& drive);

// Of a straight line through the rows around k; fewer near the ends.
inline constexpr int kSlopeRows = 10;  // its half-width, rows
double slope(const std::vector<double>& x, std::size_t k, double T_s);

}  // namespace twinrate
