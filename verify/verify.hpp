// Verifies the extended model on held-out data: rms errors with the declared and with the extended
// model.
//
//   one step     one-step prediction by the plant model from a logged state, with the logged
//                voltage and load: currents over one sample, speed over 5 ms
//   free run     free run over windows of 0.2 s from the logged state at their start; the state of
//                a load behind a shaft comes from the log before (drive_log/followed_log.hpp)
//   estimator    replay of the log through the estimator: innovations, and the angle error if the
//                angle is measured
//   closed loop  simulation of the extended plant at constant speed and load; estimator and
//                controller compensate the effects of the declared or of the extended model: angle
//                error, speed ripple, load estimate
//
// The errors are those of readings: the model's readings contain its sensing effects and delays,
// but no clipped or missing samples.
#pragma once
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "core/config.hpp"
#include "model/signals.hpp"
#include "trace/record.hpp"

namespace twinrate {

// A log for the tracer (record) and for an estimator (measurements). `held_out`: for each row of
// the record.
struct VerifyLog {
  std::string path;
  Record record;
  std::vector<char> held_out;
  std::vector<Measurement> measurements;
};

struct BeforeAfter {
  double before = 0, after = 0;
};

// Error of the plant model on a log. Currents in A, speed in rad/s.
struct ModelError {
  BeforeAfter i_d, i_q, omega_m;
  std::size_t runs = 0;
};

struct EstimatorError {
  std::vector<BeforeAfter> innovation;  // for each output of the filter
  std::optional<BeforeAfter> theta_e;   // rad; if the angle is measured and estimated
  std::int64_t ticks = 0;               // held-out ticks
  bool over_lcm = false;                // the extended estimator ran as processes on the bus
  std::int64_t different = 0;           // estimates over LCM that differ from those in process
  std::int64_t repeats = 0;             // measurements sent again
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
  std::vector<std::string> notes;  // reasons for missing levels
  double window_s = 0, speed_horizon_s = 0;
};

struct VerifySettings {
  double window_s = 0.2, speed_horizon_s = 5e-3;
  double loop_s = 2;  // length of the closed-loop window, after settling
  bool over_lcm = true;
  std::string url;
};

// `declared` and `extended` differ only in their model effects. `window_s` 0: one step.

ModelError model_error(const std::vector<VerifyLog>& logs, Config& declared, Config& extended,
                       double window_s, double speed_horizon_s);
EstimatorError estimator_error(const std::vector<VerifyLog>& logs, Config& declared,
                               Config& extended, const VerifySettings& settings);
LoopError closed_loop_error(const Config& declared, const Config& extended, double loop_s);

// Throws Stopped (core/percent_line.hpp) after Ctrl-C.
Verification verify(const std::vector<VerifyLog>& logs, const Config& declared,
                    const Config& extended, const VerifySettings& settings);
// Lines for the user: errors that rise significantly with the extended model; levels without
// change.
std::vector<std::string> remarks(const Verification& v);
std::string to_json(const Verification& v);
std::string table(const Verification& v);

}  // namespace twinrate
