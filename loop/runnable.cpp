#include "loop/runnable.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "controller/make_controller.hpp"
#include "core/bus_parameters.hpp"
#include "core/field_list.hpp"
#include "core/steering.hpp"
#include "estimator/make_filter.hpp"
#include "loop/bandwidths.hpp"
#include "loop/closed_floquet.hpp"
#include "loop/demand.hpp"
#include "loop/runnable_bridge.hpp"
#include "loop/stale_gain.hpp"
#include "loop/unused_keys.hpp"
#include "model/effects/undo.hpp"
#include "model/math.hpp"
#include "model/per_unit.hpp"
#include "plant_sim/plant.hpp"

namespace twinrate {
namespace {

// Angle error of a filter without saliency, rad: (L_q - L_d) i/psi_f. 10 deg are no matter.
constexpr double kSaliencyMax = 0.17;
// docs/ipmsm-drive.md: active_flux runs with a speed loop of 15 Hz behind its low-pass of 10 Hz.
constexpr double kSpeedLoopOverLowpass = 1.5;

// A loop around a filter of this bandwidth, a lag of first order, keeps a phase margin of 45 deg.
constexpr double kSpeedLoopOverFilter = 1;

// After the ramp of a start: the latest agreement of bench/direct_starts comes 0.15 s after the first tick.
constexpr double kStartSettles_s = 1;

// In t_align_s.
constexpr double kAlignTimeConstants = 5;

// Share of the limit; the remainder is for other swings of the ramp.
constexpr double kSwingMargin = 0.7;

// Largest n that the search for the first loss tries; it takes up to 0.5 s. Beyond it the trial of the run
// (loop/trial_run.hpp) shows a loss, within few periods.
constexpr int kSearchedMax = 50;

bool is_sensorless(const std::string& kind) {
  return kind != "ekf_disturbance" && kind != "ekf_harmonic";
}

// Predictions of theory about one drive.
class Theory {
 public:
  Theory(Config& config, std::shared_ptr<const Filter> filter)
      : config_(config),
        d_(config.drive()),
        base_(per_unit(d_.machine, d_.inverter.v_dc, d_.T_s())),
        filter_(std::move(filter)) {
    read("estimator." + d_.estimator.kind, filter_builder(d_.estimator.kind, d_));
    read("controller." + d_.controller.kind, controller_builder(d_.controller.kind, d_));
    const Profile& profile =
        d_.reference.in_rpm ? d_.reference.speed_rpm : d_.reference.omega_e_rad_s;
    const double to_omega_e = d_.reference.in_rpm ? kTwoPi / 60 * d_.machine.n_p : 1;
    for (const ProfileStep& step : profile.steps())
      if (step.value != 0) speeds_.push_back(std::abs(step.value) * to_omega_e);
  }

  // A gain that does not belong to this motor.
  void refuse_integral() const {
    if (is_sensorless(d_.estimator.kind)) return;
    const std::string key = "estimator." + d_.estimator.kind + ".L_Nm_rad";
    const double most = d_.machine.J / (d_.T_s() * d_.T_s());
    if (-value(key) <= most) return;
    throw BadInput(
        fmt::format("{}: {}: {:.4g} is unstable on this rotor, -J f_s^2 = {:.4g} to 0 allowed",
                    config_.where(key), key, value(key), -most));
  }

  std::vector<Warning> warnings() const {
    std::vector<Warning> list;
    const auto add = [&](const std::string& key, const std::string& what,
                         Expects expects = Expects::kLoss,
                         double shows_by_s = std::numeric_limits<double>::infinity()) {
      if (!what.empty())
        list.push_back(
            {fmt::format("{}: {}: {}", config_.where(key), key, what), expects, shows_by_s});
    };
    const auto add_of_start = [&](const std::string& key, const std::string& what) {
      add(key, what, Expects::kLoss, start_shows_by_s());
    };
    add("start", start_too_long());
    add_of_start("load.T_load_Nm", load_during_the_ramp());
    if (!feeds_back_an_estimate()) return list;
    add(d_.reference.in_rpm ? "reference.speed_rpm" : "reference.omega_e_rad_s", too_slow(),
        Expects::kLossIfWarm);
    add("estimator.kind", beyond_the_model());
    add("estimator.kind", speed_loop_too_fast());
    add("estimator.kind", filter_too_slow());
    add_of_start("start", hand_over_too_slow());
    add_of_start("plant.theta_e_start_rad", starts_elsewhere());
    add_of_start("start", cannot_start());
    add("rates.n", too_few_gains());
    return list;
  }

  // Alignment, ramp and agreement, of either controller.
  double start_takes_s() const {
    const std::string startup = "controller." + d_.controller.kind + ".startup.";
    return 2 * value(startup + "t_align_s") +
           value(startup + "omega_e_handover_rad_s") / value(startup + "acceleration_rad_s2") +
           value(startup + "t_agree_s");
  }

 private:
  template <class Builder>
  void read(const std::string& path, const Builder& builder) {
    const auto fields = [&](FieldVisitor& f) { builder->fields(f); };
    config_.read_table(path, fields);
    for (const FieldRow& row : list_fields(fields)) rows_[path + "." + row.key] = row;
  }
  double value(const std::string& key) const {
    const auto row = rows_.find(key);
    return row == rows_.end() ? 0 : row->second.value;
  }
  bool feeds_back_an_estimate() const {
    return is_sensorless(d_.estimator.kind) && !speeds_.empty();
  }

  // Largest voltage that the inverter loses and the model does not know, at rated current.
  double unknown_drop(double omega_e) const {
    Effects unknown;
    for (const ConfiguredEffect& e : d_.effects)
      if (e.used_in == UsedIn::kPlant) unknown.push_back(e.effect);
    unknown = acting_on(unknown, kOnVoltage);
    double sum = 0;
    constexpr int kAngles = 12;
    for (int i = 0; i < kAngles && !unknown.empty(); ++i) {
      const double theta_e = kTwoPi * (i + 0.5) / kAngles;
      sum += predicted_drop(unknown, {.i_dq = {0, base_.i},
                                      .v_dc = d_.inverter.v_dc,
                                      .omega_m = omega_e / d_.machine.n_p,
                                      .theta_m = theta_e / d_.machine.n_p,
                                      .theta_e = theta_e})
                 .norm();
    }
    return sum / kAngles;
  }

  std::string too_slow() const {
    const double omega_e = *std::min_element(speeds_.begin(), speeds_.end());
    const double hidden = kResistanceError * d_.machine.R_s * base_.i + unknown_drop(omega_e);
    const double emf = omega_e * d_.machine.psi_f;
    if (const auto least = filter_->load_speed_min(hidden))
      return load_hidden(omega_e, hidden, *least);
    if (emf >= hidden) return "";
    return fmt::format(
        "{} may lose synchronism: the EMF at {:.4g} rad/s electrical is {:.3g} V, and "
        "{:.3g} V are uncertain at rated current (20 % of R_s, unknown inverter "
        "losses); it needs {:.4g} rad/s",
        d_.estimator.kind, omega_e, emf, hidden, hidden / d_.machine.psi_f);
  }

  // Below the limit angle and load follow the unknown voltage.
  std::string load_hidden(double omega_e, double hidden, double least) const {
    if (omega_e >= least) return "";
    return fmt::format(
        "{} may lose synchronism: below {:.4g} rad/s electrical the load is not observable "
        "with {:.3g} V uncertain at rated current (20 % of R_s, unknown inverter losses); the "
        "slowest speed is {:.4g} rad/s",
        d_.estimator.kind, least, hidden, omega_e);
  }

  std::string beyond_the_model() const {
    const MachineParameters& m = d_.machine;
    const bool on_stator = d_.plant.saliency == Saliency::kFixedAxes;
    const bool without_saliency = d_.estimator.kind == "ekf_sensorless" ||
                                  (d_.estimator.kind == "backemf_printed" && !on_stator);
    const double angle = std::abs(m.L_q - m.L_d) * base_.i / m.psi_f;
    if (!without_saliency || angle <= kSaliencyMax) return "";
    return fmt::format(
        "{} may lose synchronism: its model does not have this rotor's saliency, its "
        "angle is wrong by about {:.0f} deg at rated current",
        d_.estimator.kind, math::atan(angle) * 180 / kPi);
  }

  // Of FOC, or of a state feedback from bandwidths; 0 if unknown.
  double speed_bandwidth() const {
    if (d_.controller.kind == "foc") return value("controller.foc.speed_bandwidth_Hz");
    const auto gains = rows_.find("controller.lqr.gains"),
               row = rows_.find("controller.lqr.bandwidth_q_Hz");
    if (gains == rows_.end() || row == rows_.end() || gains->second.value_text != "bandwidths")
      return 0;
    const std::string& list = row->second.value_text;  // "[current, speed, integral]"
    return std::strtod(list.c_str() + list.find(',') + 1, nullptr);
  }
  std::string speed_loop_too_fast() const {
    const std::string table = "estimator." + d_.estimator.kind + ".";
    const auto from = rows_.find(table + "speed_from");
    if (from == rows_.end() || from->second.value_text != "angle_rate") return "";
    const double most = kSpeedLoopOverLowpass * value(table + "lowpass_Hz");
    if (speed_bandwidth() <= most) return "";
    return fmt::format(
        "{} may lose synchronism: its speed is low-passed at {:.3g} Hz, the speed loop "
        "has {:.3g} Hz, up to {:.3g} Hz allowed",
        d_.estimator.kind, value(table + "lowpass_Hz"), speed_bandwidth(), most);
  }

  // The slowest pole of the filter's error at the slowest speed, a gain every tick.
  std::string filter_too_slow() const {
    const double omega_e = *std::min_element(speeds_.begin(), speeds_.end());
    const auto bandwidth = filter_bandwidth(filter_, d_, omega_e);
    if (!bandwidth || speed_bandwidth() <= kSpeedLoopOverFilter * *bandwidth) return "";
    return fmt::format(
        "{} may lose synchronism: at {:.4g} rad/s electrical it follows the speed at {:.3g} Hz, "
        "the "
        "speed loop has {:.3g} Hz",
        d_.estimator.kind, omega_e, *bandwidth, speed_bandwidth());
  }

  // Below its low-pass the speed is not smoothed within a turn.
  std::string hand_over_too_slow() const {
    const std::string table = "estimator." + d_.estimator.kind + ".";
    const auto from = rows_.find(table + "speed_from");
    if (d_.start != Start::kAlignIf || from == rows_.end() ||
        from->second.value_text != "angle_rate")
      return "";
    const double omega_e =
        value("controller." + d_.controller.kind + ".startup.omega_e_handover_rad_s");
    const double lowpass = value(table + "lowpass_Hz");
    if (omega_e >= kTwoPi * lowpass) return "";
    return fmt::format(
        "{} may lose synchronism: its speed is low-passed at {:.3g} Hz, and the hand-over comes at "
        "{:.3g} Hz",
        d_.estimator.kind, lowpass, omega_e / kTwoPi);
  }

  std::string starts_elsewhere() const {
    const double within = filter_->direct_start_within();
    const double from = std::abs(wrap_pi(d_.plant.theta_e_start));
    if (d_.start != Start::kAligned || within == 0 || from <= within) return "";
    return fmt::format(
        "{} may lose synchronism: it starts at 0, the rotor {:.0f} deg away; start = "
        "align_if finds it",
        d_.estimator.kind, from * 180 / kPi);
  }
  // The hand-over has come or given up, or the first ramp has ended, and the run has settled.
  double start_shows_by_s() const {
    if (d_.start == Start::kAlignIf)
      return start_takes_s() + value("controller." + d_.controller.kind + ".startup.t_give_up_s") +
             kStartSettles_s;
    const Profile& profile =
        d_.reference.in_rpm ? d_.reference.speed_rpm : d_.reference.omega_e_rad_s;
    const double to_omega_e = d_.reference.in_rpm ? kTwoPi / 60 * d_.machine.n_p : 1;
    const double slew = d_.reference.slew_rate_rad_s2;
    for (const ProfileStep& step : profile.steps()) {
      if (step.value == 0) continue;
      const double ramp_s = slew > 0 ? std::abs(step.value) * to_omega_e / slew : 0;
      return step.t_s + ramp_s + kStartSettles_s;
    }
    return std::numeric_limits<double>::infinity();
  }
  std::string start_too_long() const {
    if (d_.start != Start::kAlignIf || start_takes_s() < d_.run.duration_s) return "";
    return fmt::format("alignment and ramp take {:.3g} s, the run ends at {:.3g} s",
                       start_takes_s(), d_.run.duration_s);
  }

  // A load step during the I/f ramp starts a swing that nothing damps:
  //
  //   delta   = asin(T/(K_t i_start)), omega_n^2 = n_p K_t i_start/J       about the vector
  //   A       = delta omega_n 2 sin(omega_n t_r/2)/(omega_n t_r)           speed, load within t_r
  //
  // A step during the alignment swings in the same way, and its swing decays: t_align_s is five of its time
  // constants (controller/scaled_tuning.cpp). The agreement asks for a speed within 30 % for t_agree_s: A up to
  // 0.3 omega_handover/sin(omega_n t_agree/2).
  std::string load_during_the_ramp() const {
    if (d_.start != Start::kAlignIf) return "";
    const MachineParameters& m = d_.machine;
    const std::string own = "controller." + d_.controller.kind + ".", up = own + "startup.";
    const double i_max = value(own + "i_max_A"), asked = value(up + "i_start_A");
    const double T_max = m.torque_constant() * (asked > 0 ? std::min(asked, i_max) : i_max);
    const double omega_n = std::sqrt(m.n_p * T_max / m.J);
    const double half = std::min(kPi / 2, 0.5 * omega_n * value(up + "t_agree_s"));
    const double most = 0.3 * value(up + "omega_e_handover_rad_s") / math::sin(half);
    double before = 0;
    for (const ProfileStep& step : d_.load.T_load_Nm.steps()) {
      const double T = std::abs(step.value - std::exchange(before, step.value));
      const double t_align = value(up + "t_align_s");
      if (step.t_s < t_align || step.t_s > start_takes_s()) continue;
      const double left = std::max(0.0, 2 * t_align - step.t_s);
      const double decayed = left > 0 ? math::exp(-kAlignTimeConstants * left / t_align) : 1;
      const double t_r = d_.load.slew_Nm_s > 0 ? T / d_.load.slew_Nm_s : 0;
      const double x = std::max(1e-3, 0.5 * omega_n * t_r);
      const double swing = decayed * math::asin(std::min(1.0, T / T_max)) * omega_n *
                           (x < kPi / 2 ? math::sin(x) : 1) / x;
      if (swing > kSwingMargin * most)
        return fmt::format(
            "the load step at {:.3g} s acts during alignment or I/f ramp, which last until {:.3g} "
            "s: the "
            "rotor's swing of {:.3g} rad/s may prevent the hand-over, up to {:.3g} rad/s allowed",
            step.t_s, start_takes_s(), swing, kSwingMargin * most);
    }
    return "";
  }

  std::string cannot_start() const {
    if (d_.start != Start::kAligned) return "";
    const double within = filter_->direct_start_within();
    if (within == 0) {
      // Their gain at standstill moves no speed: after the hand-over from I/f the speed stays at 0.
      const bool needs_paper =
          d_.gain.policy == GainPolicy::kScheduled || d_.gain.policy == GainPolicy::kPropagated;
      return fmt::format(
          "{} may lose synchronism: there is no EMF at standstill; start = align_if{} starts it",
          d_.estimator.kind, needs_paper ? " with gain.policy = paper" : "");
    }
    if (within == kPi && d_.rates.n > 1 && has_background(d_.gain.policy) && !d_.locks_first() &&
        d_.background_rate().from == 0)
      return fmt::format(
          "{} may lose synchronism: with a gain every {} ticks a direct start fails from some "
          "angles; rates.n_from = locked computes it every tick until the filter agrees with "
          "itself",
          d_.estimator.kind, d_.rates.n);
    return "";
  }

  // State feedback uses the filter's currents: its loop closes through the gains, and cannot be
  // faster than half their rate. A bound for drives that the analysis of the closed loop does not
  // cover.
  std::string gains_slower_than_the_feedback() const {
    const double half_f_b = 0.5 * d_.rates.f_s_Hz / d_.rates.n, bandwidth = current_bandwidth();
    if (bandwidth < half_f_b) return "";
    return fmt::format(
        "{} may lose synchronism: the current loop of the state feedback has {:.3g} Hz, the gains "
        "come at {:.3g} Hz, less than half of that allowed",
        d_.estimator.kind, bandwidth, 2 * half_f_b);
  }
  // Of a state feedback from bandwidths, q axis; 0 for others.
  double current_bandwidth() const {
    const auto gains = rows_.find("controller.lqr.gains"),
               row = rows_.find("controller.lqr.bandwidth_q_Hz");
    if (gains == rows_.end() || row == rows_.end() || gains->second.value_text != "bandwidths")
      return 0;
    return std::strtod(row->second.value_text.c_str() + 1, nullptr);
  }

  std::string too_few_gains() const {
    const int n = d_.rates.n;
    if (n == 1 || !has_background(d_.gain.policy) || !filter_->steady_state(0)) return "";
    const double omega_e = *std::max_element(speeds_.begin(), speeds_.end());
    const Steady steady{filter_, d_.gain.policy, omega_e / d_.machine.n_p,
                        omega_e, d_.T_s(),       d_.gain.speed_span / d_.machine.n_p};
    const int limit = std::min(kSearchedMax, n);
    // The trial of the run (loop/trial_run.hpp) has the other loads of the profile.
    double T_load = d_.load.T_load_Nm.at(0);
    for (const ProfileStep& step : d_.load.T_load_Nm.steps())
      if (std::abs(step.value) < std::abs(T_load)) T_load = step.value;
    const auto closed = ClosedFloquet::of(config_, steady, T_load);
    // Upward from 1: beyond the first loss there are islands of stability.
    int held = closed ? closed->n_max(limit) : n_max_by_formula(steady, limit);
    if (!closed && held == 0) held = n_max_by_floquet(steady, limit);
    if (held >= limit) return closed && limit == n ? "" : gains_slower_than_the_feedback();
    return fmt::format(
        "{} may lose synchronism: at {:.4g} rad/s electrical a gain of policy {} holds up "
        "to n = {:.0f}",
        d_.estimator.kind, omega_e, kGainPolicyNames[static_cast<int>(d_.gain.policy)],
        static_cast<double>(held));
  }

  Config& config_;
  const DriveConfig& d_;
  const PerUnit base_;
  const std::shared_ptr<const Filter> filter_;
  std::map<std::string, FieldRow> rows_;
  std::vector<double> speeds_;  // electrical, of the profile, without 0
};

// A fixed step beyond the time constant of the winding leaves the region in which the method is stable:
// 3.3 L/R_s at standstill, less while the rotor turns.
void require_erk_steps(Config& config) {
  constexpr double kLongest = 2;  // in L/R_s
  const DriveConfig& d = config.drive();
  const auto plant = config.read<PlantParameters>();
  if (d.plant.kind != PlantKind::kSimulated || plant.engine != Engine::kErk ||
      plant.inverter == InverterModel::kSwitched)
    return;
  const double T_s_R_L = d.T_s() * d.machine.R_s / std::min(d.machine.L_d, d.machine.L_q);
  const double least = std::ceil(T_s_R_L / kLongest);
  if (plant.erk_steps >= least) return;
  throw BadInput(fmt::format(
      "{}: plant.erk_steps: {} is too few for this winding: a tick is {:.3g} L/R_s; at least {:g} "
      "allowed",
      config.where("plant.erk_steps"), plant.erk_steps, T_s_R_L, least));
}

// LCM itself has no authentication.
std::string anybody_may_command(Config& config) {
  if (config.read<BusParameters>().authenticate) return "";
  return fmt::format(
      "{}: bus.authenticate: LCM has no authentication: launch takes the messages of everybody who "
      "reaches its multicast group",
      config.where("bus.authenticate"));
}

}  // namespace

std::vector<std::string> texts_of(const std::vector<Warning>& warnings) {
  std::vector<std::string> texts;
  texts.reserve(warnings.size());
  for (const Warning& w : warnings) texts.push_back(w.text);
  return texts;
}

double start_takes_s(Config& config) {
  if (config.drive().start != Start::kAlignIf) return 0;
  return Theory(config, make_filter(config)).start_takes_s();
}

std::vector<Warning> check_runnable(Config& config) {
  refuse_unused_keys(config);
  steering_of(config);
  require_drivable(config);
  require_erk_steps(config);
  const auto filter = make_filter(config);
  require_policy(config, *filter);
  make_controller(config);
  const Plant plant(config);
  const Theory theory(config, filter);
  theory.refuse_integral();
  std::vector<Warning> list;
  for (std::string& text : warnings_of(config, demand_of(config)))
    list.push_back({std::move(text)});
  for (Warning& warning : theory.warnings()) list.push_back(std::move(warning));
  for (std::string& text : warnings_of_the_bridge(config)) list.push_back({std::move(text)});
  if (std::string open = anybody_may_command(config); !open.empty())
    list.push_back({std::move(open)});
  return list;
}

}  // namespace twinrate
