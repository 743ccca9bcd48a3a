#include "core/drive_config.hpp"

#include <algorithm>
#include <cmath>
#include <set>

#include "model/effects/delayed.hpp"
#include "model/math.hpp"

namespace twinrate {
// 31 years, and the drive time of their last tick fits into an int64 of nanoseconds.
constexpr double kEndless_s = 1e9;

void RateParameters::fields(FieldVisitor& f) {
  f.number("f_s_Hz", f_s_Hz, 100, 200e3, "control rate: fast loop, controller, plant",
           Presence::kRequired);
  f.integer("n", n, 1, 100000, "f_s/f_b: the background runs every n-th tick");
  f.number("f_b_Hz", f_b_Hz, 0, 200e3,
           "background rate instead of n; f_s/f_b must be a whole number; 0: use n");
  f.choice("n_from", n_from, kNFromNames,
           "locked: the background runs every tick until the filter agrees with itself, then every "
           "n-th; start: every n-th from n_from_s on");
  f.number(
      "n_from_s", n_from_s, 0, 1e5,
      "n_from = start: drive time from which on the background runs every n-th tick, and every "
      "tick before");
}

void GainParameters::fields(FieldVisitor& f) {
  f.choice("policy", policy, kGainPolicyNames,
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
  f.choice("angle_source", angle_source, kAngleSourceNames,
           "source of angle and speed for the controller");
  f.choice_profile("compensation", compensation, kCompensationNames, "disturbance compensation");
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
  f.number("duration_s", duration_s, 1e-3, kEndless_s, "drive time of a run");
  f.number("settle_s", settle_s, 0, 1e5, "start of the window for the figures of the summary");
  f.integer("seed", seed, 0, 2147483647, "seed of every noise stream");
}

std::int64_t DriveConfig::t_ns(std::int64_t k) const {
  return static_cast<std::int64_t>(math::round(static_cast<double>(k) * 1e9 / rates.f_s_Hz));
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

bool DriveConfig::locks_first() const {
  return rates.n_from == NFrom::kLocked && rates.n > 1 && has_background(gain.policy);
}

BackgroundRate DriveConfig::background_rate() const {
  if (rates.n_from == NFrom::kLocked) return {rates.n};
  const auto from = static_cast<std::int64_t>(std::ceil(rates.n_from_s * rates.f_s_Hz / rates.n));
  return {rates.n, from * rates.n};
}

bool DriveConfig::sends_gain(std::int64_t k, int estimate_status) const {
  return has_background(gain.policy) &&
         (estimate_status & kGainEveryTick || is_snapshot(k, background_rate()));
}

std::int64_t DriveConfig::gains_between(std::int64_t first, std::int64_t last,
                                        BackgroundRate rate) const {
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
    if (e.is_known_at(0)) some.push_back(delayed(e.effect, e.from_s));
  return some;
}

std::vector<std::int64_t> DriveConfig::model_changes() const {
  std::set<std::int64_t> ticks;
  for (const ConfiguredEffect& e : effects)
    for (const double t_s : {e.known_from_s, e.known_to_s})
      if (t_s > 0 && std::isfinite(t_s))
        ticks.insert(static_cast<std::int64_t>(std::ceil(t_s * rates.f_s_Hz - 1e-6)));
  return {ticks.begin(), ticks.end()};
}

DriveFacts DriveConfig::facts() const {
  return {machine, inverter.v_dc, inverter.f_pwm > 0 ? inverter.f_pwm : rates.f_s_Hz,
          1 / rates.f_s_Hz};
}

}  // namespace twinrate
