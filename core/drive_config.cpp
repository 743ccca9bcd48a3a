#include "core/drive_config.hpp"

#include <algorithm>
#include <cmath>

#include "model/discretise.hpp"
#include "model/effects/delayed.hpp"

namespace twinrate {
namespace {

constexpr const char* kCovarianceFormNames[] = {"joseph", "paper", "sequential", "auto"};
constexpr const char* kEngineChoice[] = {"erk", "cvode"};
constexpr const char* kSaliencyChoice[] = {"rotor", "fixed_axes"};
constexpr const char* kInverterChoice[] = {"averaged", "switched"};

}  // namespace

void RateParameters::fields(FieldVisitor& f) {
  f.number("f_s_Hz", f_s_Hz, 100, 200e3, "control rate: fast loop, controller, plant",
           Presence::kRequired);
  f.integer("n", n, 1, 100000, "f_s/f_b: the background runs every n-th tick");
  f.number("f_b_Hz", f_b_Hz, 0, 200e3,
           "background rate instead of n; f_s/f_b must be a whole number; 0: use n");
  f.number("n_from_s", n_from_s, 0, 1e5,
           "drive time from which on the background runs every n-th tick, and every tick before");
}

void GainParameters::fields(FieldVisitor& f) {
  choice(f, "policy", policy, kGainPolicyNames,
         "gain policy: the ticks in which a gain is used, and its rotation");
  f.integer("max_age_ticks", max_age_ticks, 0, 1000000000,
            "realtime: a gain whose snapshot is older gives way to the gain tabulated over speed; "
            "0: 4 n");
  f.number("speed_span_rad_s", speed_span, 1, 1e5,
           "policy propagated: largest change of the electrical speed while a gain is in use");
}

void EstimatorChoice::fields(FieldVisitor& f) {
  f.text("kind", kind, "filter of the fast loop and the background");
  f.choice("prediction", prediction, kPredictionNames, "discretisation of the state prediction");
  f.choice("covariance", covariance, kCovarianceFormNames,
           "form of the covariance update; auto: sequential if R is small, else joseph");
}

void ControllerChoice::fields(FieldVisitor& f) {
  f.text("kind", kind, "controller");
  choice(f, "angle_source", angle_source, kAngleSourceNames,
         "source of angle and speed for the controller");
  f.choice_profile("compensation", compensation, kCompensationNames, "disturbance compensation");
}

void PlantParameters::fields(FieldVisitor& f) {
  f.choice("engine", engine, kEngineChoice, "integrator of the simulated plant");
  f.choice("inverter", inverter, kInverterChoice, "inverter model: mean voltage, or edge by edge");
  f.choice("saliency", saliency, kSaliencyChoice,
           "rotor: L_d and L_q turn with the rotor; fixed_axes: the "
           "idealised machine of Kim et al., L_q on alpha and L_d on beta");
  f.integer("erk_steps", erk_steps, 1, 1000, "fixed steps of the erk engine per tick");
  f.integer("delay_samples", delay_samples, 0, 4,
            "computation delay: COMMAND(k) acts from t_{k+delay}");
  f.integer("hold_ticks", hold_ticks, 1, 100000,
            "realtime: number of ticks without a command for which the last voltage is held");
  f.number("theta_e_start_rad", theta_e_start, -100, 100, "electrical rotor angle at t = 0");
}

void ReferenceParameters::fields(FieldVisitor& f) {
  f.profile("omega_e_rad_s", omega_e_rad_s, -1e5, 1e5, "speed reference, electrical");
  f.profile("speed_rpm", speed_rpm, -1e6, 1e6,
            "speed reference, mechanical; instead of omega_e_rad_s");
  f.profile("i_d_A", i_d_A, -1e4, 1e4, "d-axis current reference");
  f.number("slew_rad_s2", slew_rate_rad_s2, 0, 1e9,
           "slew limit of the speed reference, electrical; 0: none");
  f.boolean("from_bus", from_bus, "wait for DRIVE_REFERENCE from another process");
}

void LoadParameters::fields(FieldVisitor& f) {
  f.profile("T_load_Nm", T_load_Nm, -1e6, 1e6, "external load torque, opposes positive speed");
  f.number("slew_Nm_s", slew_Nm_s, 0, 1e9,
           "slew limit of the load, which then starts from 0; 0: none");
}

void RunParameters::fields(FieldVisitor& f) {
  f.number("duration_s", duration_s, 1e-3, 1e5, "drive time of a run");
  f.number("settle_s", settle_s, 0, 1e5, "start of the window for the figures of the summary");
  f.integer("seed", seed, 0, 2147483647, "seed of every noise stream");
}

void BusParameters::fields(FieldVisitor& f) {
  f.number("peer_timeout_s", peer_timeout_s, 0.05, 3600,
           "longest wait for another process; beyond it the process reports and stops");
  f.number("repeat_after_ms", repeat_after_ms, 0.1, 10000,
           "lock-step: time after which an unanswered message is sent again");
  f.integer("window_ticks", window_ticks, 16, 8192,
            "lock-step: number of ticks by which the plant can lead the log");
  f.number("drop_rate", drop_rate, 0, 0.5,
           "fraction of the datagrams that each receiver drops (for tests)");
  f.boolean("pin", pin,
            "pin plant, estimator and controller to one CPU, the other processes to the others");
  f.boolean("split_ports", split_ports, "use one UDP port per link instead of one for all");
  f.boolean("filter", filter,
            "filter channels without a subscription in the kernel, before they wake a process");
  f.number("log_rotate_MB", log_rotate_MB, 0.1, 1e6,
           "size of a log file at which the logger begins the next one");
}

void MonitorParameters::fields(FieldVisitor& f) {
  f.boolean("enabled", enabled, "start twinrate-monitor with the set");
  f.boolean("auto_add", auto_add, "add the traced effects to the running estimator and controller");
  f.number("learn_s", learn_s, 0.5, 1000,
           "time from run.settle_s on in which the monitor learns the level of the residuals");
  f.number("block_s", block_s, 0.05, 100, "length of one block");
  f.number("gather_s", gather_s, 0.5, 1000,
           "length of the data after a misfit before the first trace");
  f.number("window_s", window_s, 0.5, 1000,
           "length of the rolling window, the longest stretch for a trace");
}

std::int64_t DriveConfig::t_ns(std::int64_t k) const {
  return std::llround(static_cast<double>(k) * 1e9 / rates.f_s_Hz);
}

std::int64_t DriveConfig::steps() const {
  return std::llround(run.duration_s * rates.f_s_Hz);
}

Reference DriveConfig::reference_at(std::int64_t k) const {
  const double t = static_cast<double>(k) * T_s();
  Reference r;
  r.k = k;
  r.t_ns = t_ns(k);
  r.omega_m_ref = reference.in_rpm ? reference.speed_rpm.at(t) * kTwoPi / 60
                                   : reference.omega_e_rad_s.at(t) / machine.n_p;
  r.i_d_ref = reference.i_d_A.at(t);
  return r;
}

BackgroundRate DriveConfig::background_rate() const {
  const auto from = static_cast<std::int64_t>(std::ceil(rates.n_from_s * rates.f_s_Hz / rates.n));
  return {rates.n, from * rates.n};
}

bool DriveConfig::sends_gain(std::int64_t k) const {
  return has_background(gain.policy) && is_snapshot(k, background_rate());
}

std::int64_t DriveConfig::gains_between(std::int64_t first, std::int64_t last) const {
  const BackgroundRate rate = background_rate();
  return has_background(gain.policy) ? snapshots_up_to(last, rate) - snapshots_up_to(first, rate)
                                     : 0;
}

double DriveConfig::omega_m_limit() const {
  double fastest = std::max(machine.omega_m_rated, 10.0);
  for (const ProfileStep& step : reference.omega_e_rad_s.steps())
    fastest = std::max(fastest, std::abs(step.value) / machine.n_p);
  for (const ProfileStep& step : reference.speed_rpm.steps())
    fastest = std::max(fastest, std::abs(step.value) * kTwoPi / 60);
  return 2 * fastest;
}

double DriveConfig::omega_m_start() const {
  return start == Start::kFlying ? reference_at(0).omega_m_ref : 0;
}

Effects DriveConfig::plant_effects() const {
  Effects some;
  for (const ConfiguredEffect& e : effects)
    if (e.used_in != UsedIn::kModel) some.push_back(delayed(e.effect, e.from_s));
  return some;
}

Effects DriveConfig::model_effects() const {
  Effects some;
  for (const ConfiguredEffect& e : effects)
    if (e.used_in != UsedIn::kPlant) some.push_back(delayed(e.effect, e.from_s));
  return some;
}

DriveFacts DriveConfig::facts() const {
  return {machine, inverter.v_dc, inverter.f_pwm > 0 ? inverter.f_pwm : rates.f_s_Hz,
          1 / rates.f_s_Hz};
}

}  // namespace twinrate
