// Steering: the changeable values of a running drive, and the drive file that results from changes.
//
// A request is a text of KEY=VALUE lines that hold from one tick on (core/arbiter.hpp chooses it):
//
//   speed_rpm, omega_e_rad_s   speed reference, up to the fastest of rated speed and references
//   load_Nm                    load of the simulated plant, up to steering.load_max_Nm
//   n, policy                  background every n ticks, gain policy (core/rate_history.hpp)
//   compensation               as controller.compensation
//   stop, start                without value: the speed reference goes to 0, or back to its earlier
//                              value, in steps of at most 10 ms with steering.ramp_rad_s2
//
// Each process keeps a SteeredDrive and uses its part of it. A value becomes a step of the profile
// of its key and replaces all later steps. The steps are half a period before their tick, so that
// rounding does not move them to another tick. A drive file with these profiles is the steered run:
// `twinrate set --save` writes it.
#pragma once
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/config.hpp"
#include "core/rate_history.hpp"

namespace twinrate {

// Position 0: the policy of gain.policy.
inline constexpr const char* kSteeredPolicyNames[] = {"gain.policy", "paper",     "immediate",
                                                      "extrapolate", "rotate",    "rotor_frame",
                                                      "scheduled",   "propagated"};

inline constexpr const char* kEmergencyNames[] = {"none", "stop", "reset"};

struct SteeringParameters {
  static constexpr const char* kTable = "steering";
  double hold_s = 1, ramp_rad_s2 = 200, load_max = 0;
  Profile n;          // 0: rates.n
  Profile policy;     // positions in kSteeredPolicyNames
  Profile emergency;  // positions in kEmergencyNames
  void fields(FieldVisitor& f);
};

// Reads [steering]. Throws BadInput if a step of steering.n is not an integer.
SteeringParameters steering_of(Config& config);
RateHistory rate_history(const DriveConfig& drive, const SteeringParameters& steering);
inline RateHistory rate_history(Config& config) {
  return rate_history(config.drive(), steering_of(config));
}

// A step of steering.emergency: off before the plant leaves tick k, or from SAFE to IDLE at tick k.
struct PlannedEmergency {
  std::int64_t k = 0;
  bool reset = false;
};
std::vector<PlannedEmergency> planned_emergencies(const DriveConfig& drive,
                                                  const SteeringParameters& steering);
// The ticks of its resets.
std::vector<std::int64_t> planned_resets(Config& config);

class SteeredDrive {
 public:
  explicit SteeredDrive(Config& config);

  // Changes the drive from tick k on. Throws BadInput, with one line, and changes nothing then.
  void apply(std::string_view lines, std::int64_t k);
  // Drops steps that no tick from k on reads: the memory of a long run stays small.
  void forget_before(std::int64_t k);

  const DriveConfig& drive() const { return drive_; }
  const SteeringParameters& steering() const { return steering_; }
  RateHistory rates() const { return rate_history(drive_, steering_); }
  // The policies and compensations of the steps from tick k on.
  std::vector<GainPolicy> policies_from(std::int64_t k) const;
  std::vector<Compensation> compensations_from(std::int64_t k) const;
  // As overrides of the drive file, "key.path=value".
  std::vector<std::string> overrides() const;

 private:
  void set(std::string_view key, std::string_view value, std::int64_t k);
  void set_speed(double omega_e, std::string_view key, std::string_view value, std::int64_t k);
  void set_load(std::string_view value, std::int64_t k);
  void ramp(double to, std::int64_t k);
  void stop(std::int64_t k);
  void start(std::int64_t k);
  Profile& speed();
  double speed_factor() const;  // value of the profile over omega_e
  double t_of(std::int64_t k) const { return (static_cast<double>(k) - 0.5) * drive_.T_s(); }
  void add_step(Profile& profile, std::int64_t k, double value) const;

  DriveConfig drive_;
  SteeringParameters steering_;
  double omega_m_max_, load_max_;
  std::optional<double> stopped_from_;  // speed reference before a stop, electrical
};

// The load that the lines of a request set, if any.
std::optional<double> steered_load(std::string_view lines);

// A finite number with no further text. Throws BadInput naming the key.
double steered_number(std::string_view key, std::string_view value);

struct AppliedSteering {
  std::int64_t k = 0;
  std::string lines;
};
struct RunLog;
std::vector<AppliedSteering> steering_in(const RunLog& log);
// True if a request set n or the gain policy.
bool requests_rates(const RunLog& log);
// The reason why request i of the log was never applied: the run, of which `last_k` is the last
// tick, ended before its tick, or a later request for an earlier tick replaced all of its keys. ""
// if it was applied.
std::string why_not_applied(const std::vector<AppliedSteering>& requests, std::size_t i,
                            std::int64_t last_k);
bool was_steered(const RunLog& log);  // or stopped, or reset
// For a run, from the drive file in its log and the applied requests. Throws BadInput.
RateHistory rate_history(const RunLog& log, const DriveConfig& drive);
// The overrides that make the drive file of a steered run from that of its log, for `ticks` ticks.
std::vector<std::string> steered_overrides(Config& config, const RunLog& log, std::int64_t ticks);

}  // namespace twinrate
