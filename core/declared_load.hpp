// The external load that a log declares for its drive.
#pragma once
#include <cstdint>
#include <string_view>
#include <vector>

#include "core/drive_config.hpp"

namespace twinrate {

// Follows the declared load of a drive from tick 0 on, as the simulated plant applies it: the load
// of the drive file, changed by the requests of a steered run.
class DeclaredLoad {
 public:
  explicit DeclaredLoad(const DriveConfig& drive)
      : steps_(drive.load.T_load_Nm.steps()), slew_Nm_s_(drive.load.slew_Nm_s), T_s_(drive.T_s()) {}
  // The lines of a request (core/steering.hpp), which hold from tick k on. In the order of the log.
  void steer(std::int64_t k, std::string_view lines);
  double at(double t_s);
  double now() const { return T_load_; }
  void go_on_from(double T_load) { T_load_ = T_load; }

 private:
  std::vector<ProfileStep> steps_;
  double slew_Nm_s_, T_s_, T_load_ = 0;
};

}  // namespace twinrate
