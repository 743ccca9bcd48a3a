// Does the extended model do better on data that it was not traced from? Error with the declared
// and with the extended model, side by side:
//
//   one step     states of the log carried on by the plant model under the logged voltage and load:
//                currents over one sample, speed over 5 ms
//   free run     the same over windows of 0.2 s, from the logged state at their beginning; a load
//                behind a shaft starts as it was followed up to there
//                (drive_log/followed_log.hpp)
//   estimator    the log replayed through the estimator: innovations, angle where it is measured
//   closed loop  simulated on the extended plant: angle error, speed ripple, load estimate, of a
//                drive at constant speed and load whose estimator and controller know the declared
//                model, and the extended one
//
// Errors of readings, rms. Model readings hold the sensing effects that the model knows, late
// signals among them; clipped or missing samples are not simulated.
#pragma once
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "core/config.hpp"
#include "model/signals.hpp"
#include "trace/record.hpp"

namespace twinrate {

// A log as the tracer and as an estimator sees it. `held_out`: of each row of the record.
struct VerifyLog {
  std::string path;
  Record record;
  std::vector<char> held_out;
  std::vector<Measurement> measurements;
};

struct BeforeAfter {
  double before = 0, after = 0;
};

// Of the plant model against a log. Currents in A, speed in rad/s.
struct ModelError {
  BeforeAfter i_d, i_q, omega_m;
  std::size_t runs = 0;
};

struct EstimatorError {
  std::vector<BeforeAfter> innovation;      // by output of the filter
  std::optional<BeforeAfter> theta_e;       // rad; where the angle is measured and estimated
  std::int64_t ticks = 0;                   // held-out ones
  bool over_lcm = false;                    // the extended estimator ran as processes on the bus
  std::int64_t different = 0, repeats = 0;  // estimates over LCM that differ from in-process ones
};

struct LoopError {
  BeforeAfter theta_e, speed_ripple, T_load;  // rad, rad/s, Nm
  bool has_load = false;                      // the filter estimates a load
  double duration_s = 0;
};

struct Verification {
  std::optional<ModelError> one_step, free_run;
  std::optional<EstimatorError> estimator;
  std::optional<LoopError> closed_loop;
  std::vector<std::string> notes;  // why a level is missing
  double window_s = 0, speed_horizon_s = 0;
};

struct VerifySettings {
  double window_s = 0.2, speed_horizon_s = 5e-3;
  double loop_s = 2;  // of the closed loop, once it has settled
  bool over_lcm = true;
  std::string url;
};

// `declared` and `extended` differ in their model effects only.
ModelError model_error(const std::vector<VerifyLog>& logs, Config& declared, Config& extended,
                       double window_s, double speed_horizon_s);
EstimatorError estimator_error(const std::vector<VerifyLog>& logs, Config& declared,
                               Config& extended, const VerifySettings& settings);
LoopError closed_loop_error(const Config& declared, const Config& extended, double loop_s);

// Throws Stopped (core/percent_line.hpp) after Ctrl-C.
Verification verify(const std::vector<VerifyLog>& logs, const Config& declared,
                    const Config& extended, const VerifySettings& settings);
// One line each: figures that get plainly worse and by how much; levels at which nothing changes.
std::vector<std::string> remarks(const Verification& v);
std::string to_json(const Verification& v);
std::string table(const Verification& v);

}  // namespace twinrate
