#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "model/frames.hpp"
#include "trace/keys.hpp"
#include "trace/measured_result.hpp"
#include "trace/motion.hpp"
#include "trace/winding_voltage.hpp"

namespace twinrate {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

using Logs = std::vector<const PositionLog*>;

// Everything that the logs gave, before it is put into words.
struct Found {
  const MachineParameters& machine;
  Logs at_rest, in_motion;  // that train
  HoldingTorque holding;
  SpinUp spin;
  bool lag_is_of_current = false;
  SpeedLag speed_lag;
  WindingVoltage voltage;

  double gain() const { return spin.gain > 0 ? spin.gain : machine.torque_constant() / machine.J; }
  double J() const { return machine.torque_constant() / gain(); }
  double T_C() const { return holding.both_directions ? holding.T_C : spin.T_C; }
  double sigma_T_C() const { return holding.both_directions ? holding.sigma_T_C : spin.sigma_T_C; }
  MotionModel declared() const { return {.gain = gain(), .B = machine.B, .machine = machine}; }
  MotionModel model() const {
    MotionModel m = declared();
    m.holding = &holding;
    m.T_C = T_C();
    m.speed_lag = speed_lag;
    return m;
  }
};

// Sums over logs, rms in the end.
struct Errors {
  double no_change = 0, before = 0, after = 0, rows = 0;
  void add(double nothing, double declared, double found, double n) {
    no_change += n * nothing * nothing;
    before += n * declared * declared;
    after += n * found * found;
    rows += n;
  }
  static double rms(double sum, double n) { return n > 0 ? std::sqrt(sum / n) : kNone; }
};

// Current that the rows of `ok` hold, less the model and the mean of the rest.
double holding_error(const PositionLog& log, const std::vector<double>& model,
                     const std::vector<char>& ok, std::size_t& rows) {
  double sum = 0, squares = 0;
  rows = 0;
  for (std::size_t k = 0; k < log.size(); ++k)
    if (ok[k]) {
      const double rest = log.i_q[k] - model[k];
      sum += rest;
      squares += rest * rest;
      ++rows;
    }
  const double n = std::max<double>(1, static_cast<double>(rows));
  return std::sqrt(std::max(0.0, squares / n - sum / n * sum / n));
}

// What the error is taken of.
class Judge {
 public:
  Judge(const std::vector<PositionLog>& logs, const MachineParameters& machine, double horizon)
      : horizon_(horizon) {
    const bool unseen = std::any_of(logs.begin(), logs.end(), [](auto& l) { return l.held_out; });
    for (const PositionLog& log : logs)
      if (!is_quasi_static(log, machine) && log.held_out == unseen) by_speed_ = true;
    for (const PositionLog& log : logs)
      if (by_speed_ == !is_quasi_static(log, machine)) logs_.push_back(&log);
    if (by_speed_ && horizon_ <= 0) horizon_ = 5 * sample_interval(*logs_.front());
    if (!by_speed_) horizon_ = 0;
  }
  // Training runs that cogging found elsewhere makes worse: their angle starts from another zero,
  // so where it stands is not known there. A held-out run gets no such choice.
  void find_other_zeros(const Found& found) {
    if (!by_speed_) return;
    MotionModel without = found.model();
    without.holding = nullptr;
    for (const PositionLog* log : logs_)
      if (!log->held_out && speed_change(*log, without, horizon_).error <
                                0.95 * speed_change(*log, found.model(), horizon_).error)
        other_zero_.push_back(log);
  }
  const Logs& other_zero() const { return other_zero_; }
  bool by_speed() const { return by_speed_; }
  double horizon() const { return horizon_; }
  const Logs& logs() const { return logs_; }

  void add(const PositionLog& log, const Found& declared_of, const MotionModel& model,
           Errors& errors) const {
    if (by_speed_) {
      const SpeedChange before = speed_change(log, declared_of.declared(), horizon_);
      MotionModel used = model;
      if (std::find(other_zero_.begin(), other_zero_.end(), &log) != other_zero_.end())
        used.holding = nullptr;
      const SpeedChange after = speed_change(log, used, horizon_);
      errors.add(before.no_change, before.error, after.error, static_cast<double>(after.rows));
      return;
    }
    const HoldingTorque none;
    const std::vector<char> ok = holding_rows(log, 5 * declared_of.holding.lag);
    std::size_t rows = 0;
    const double before = holding_error(log, std::vector<double>(log.size(), 0), ok, rows);
    const HoldingTorque& holding = model.holding ? *model.holding : none;
    const double after =
        holding_error(log, holding_current(log, holding, declared_of.machine), ok, rows);
    errors.add(before, before, after, static_cast<double>(rows));
  }
  Errors over(const Found& found, const MotionModel& model, bool held_out) const {
    Errors errors;
    for (const PositionLog* log : logs_)
      if (log->held_out == held_out) add(*log, found, model, errors);
    return errors;
  }
  // Held-out rest, or that of the training logs where none is held out.
  double error(const Found& found, const MotionModel& model) const {
    const bool unseen =
        std::any_of(logs_.begin(), logs_.end(), [](auto* l) { return l->held_out; });
    const Errors e = over(found, model, unseen);
    return Errors::rms(e.after, e.rows);
  }

 private:
  double horizon_;
  bool by_speed_ = false;
  Logs logs_, other_zero_;
};

struct Evidence {
  double z = 0;        // size over its standard deviation
  double freedom = 1;  // parameters: 1 or 2
  std::size_t rows = 0;
  double without = kNone, with = kNone;  // errors on what is held out
};

TracedEffect traced(std::shared_ptr<Effect> effect, std::string equation,
                    const std::map<std::string, double>& sigma, const Evidence& evidence,
                    const DriveFacts& facts) {
  effect->prepare(facts);
  TracedEffect e;
  e.parameters = traced_parameters(*effect, sigma);
  e.equation = std::move(equation);
  const double ratio = evidence.with / evidence.without;
  e.held_out_gain = 1 - ratio * ratio;
  const double z2 = evidence.z * evidence.z;
  e.delta_bic =
      -z2 + evidence.freedom * std::log(std::max<double>(2, static_cast<double>(evidence.rows)));
  e.p_value = evidence.freedom > 1 ? std::exp(-z2 / 2) : std::erfc(evidence.z / std::sqrt(2.0));
  e.materiality = effect->materiality(facts);
  e.effect = std::move(effect);
  return e;
}

std::shared_ptr<Effect> sine_effect(const char* kind, const Harmonic& h) {
  auto effect = make_effect(kind);
  set_key(*effect, "order", h.order);
  set_key(*effect, "amplitude_Nm", h.amplitude);
  set_key(*effect, "phase_rad", h.phase);
  return effect;
}

// What stands still in stator axes, or comes with the poles, shows at the same orders.
std::vector<std::string> aliases_of_order(int order, int n_p) {
  if (order == n_p) return {"current_offset"};
  if (order == 2 * n_p) return {"current_gain"};
  return {};
}

void add_periodic(const Found& found, const Judge& judge, const DriveFacts& facts, TraceResult& r) {
  const double with = judge.error(found, found.model());
  const auto add = [&](const char* kind, std::vector<Harmonic> HoldingTorque::*list) {
    for (std::size_t i = 0; i < (found.holding.*list).size(); ++i) {
      const Harmonic& h = (found.holding.*list)[i];
      HoldingTorque less = found.holding;
      (less.*list).erase((less.*list).begin() + static_cast<std::ptrdiff_t>(i));
      MotionModel model = found.model();
      model.holding = &less;
      r.effects.push_back(
          traced(sine_effect(kind, h), "mechanical",
                 {{"amplitude_Nm", h.sigma_amplitude}, {"phase_rad", h.sigma_phase}},
                 {.z = h.amplitude / h.sigma_amplitude,
                  .freedom = 2,
                  .rows = found.holding.rows,
                  .without = judge.error(found, model),
                  .with = with},
                 facts));
      r.effects.back().aliases = aliases_of_order(h.order, facts.machine.n_p);
    }
  };
  add("cogging", &HoldingTorque::cogging);
  add("friction_ripple", &HoldingTorque::friction_ripple);
}

void add_friction(const Found& found, const Judge& judge, const DriveFacts& facts, TraceResult& r) {
  const double T_C = found.T_C(), sigma = found.sigma_T_C();
  if (sigma > 0 && T_C > 5 * sigma) {
    auto effect = make_effect("coulomb_friction");
    set_key(*effect, "torque_Nm", T_C);
    HoldingTorque less = found.holding;
    less.T_C = 0;
    MotionModel model = found.model();
    model.holding = &less;
    model.T_C = 0;
    r.effects.push_back(traced(effect, "mechanical", {{"torque_Nm", sigma}},
                               {.z = T_C / sigma,
                                .rows = found.holding.rows + found.spin.windows,
                                .without = judge.error(found, model),
                                .with = judge.error(found, found.model())},
                               facts));
  }
  if (!found.at_rest.empty() && !found.holding.both_directions)
    r.ambiguous.push_back(
        {{"coulomb_friction", "constant_load", "current_offset"},
         "the position goes one way only: friction is a constant current, as an offset is",
         "the same sweep the other way: friction turns its sign, an offset does not"});
  const double drift = found.spin.T_C - T_C;
  if (found.holding.both_directions && found.spin.sigma_T_C > 0 &&
      std::abs(drift) > 5 * std::hypot(found.spin.sigma_T_C, sigma))
    r.ambiguous.push_back(
        {{"viscous_friction", "stribeck_friction", "coulomb_friction"},
         fmt::format(
             "friction is {:.2f} mNm at rest and {:.2f} mNm + {:.3g} uNms omega_m in motion; "
             "how it goes from the one to the other is not in the data",
             1e3 * T_C, 1e3 * found.spin.T_C, 1e6 * found.spin.B),
         "constant speeds from creeping to the fastest, both ways"});
}

void add_inertia(const Found& found, const Judge& judge, const DriveFacts& facts, TraceResult& r) {
  if (found.spin.gain <= 0) return;
  const double J = found.J(), sigma = J * found.spin.sigma_gain / found.spin.gain;
  r.identifiable.push_back(fmt::format(
      "K_t/J = {:.0f} +- {:.0f} rad/s^2 A; with the K_t declared J = {:.3g} kgm2 (declared {:.3g})",
      found.gain(), found.spin.sigma_gain, J, facts.machine.J));
  r.constants.push_back({"J", "kgm2", J, sigma, ""});
  const double change = J - facts.machine.J;
  if (std::abs(change) < 0.03 * facts.machine.J || std::abs(change) < 5 * sigma) return;
  auto effect = make_effect("inertia");
  const std::string key = numeric_keys(*effect).front().key;
  if (!set_key(*effect, key, change)) return;
  MotionModel declared = found.model();
  declared.gain = facts.machine.torque_constant() / facts.machine.J;
  r.effects.push_back(traced(effect, "mechanical", {{key, sigma}},
                             {.z = std::abs(change) / sigma,
                              .rows = found.spin.windows,
                              .without = judge.error(found, declared),
                              .with = judge.error(found, found.model())},
                             facts));
  r.effects.back().aliases = {"flux_linkage", "current_gain"};
}

std::shared_ptr<Effect> lag_effect(int signal, double lag, double delay_share) {
  auto effect = make_effect("signal_lag");
  set_key(*effect, "signal", signal);
  set_key(*effect, "form", delay_share >= 1 ? 0 : 1);
  set_key(*effect, "lag_s", lag);
  set_key(*effect, "delay_share", delay_share);
  return effect;
}

void add_lags(const Found& found, const Judge& judge, const DriveFacts& facts, TraceResult& r) {
  const SpeedLag& s = found.speed_lag;
  if (s.lag() > 5 * s.sigma && s.lag() > 0) {
    MotionModel model = found.model();
    model.speed_lag = {};
    r.effects.push_back(traced(lag_effect(SamplingFacts::kSpeed, s.lag(), s.delay / s.lag()),
                               "sensing", {{"lag_s", s.sigma}},
                               {.z = s.lag() / s.sigma,
                                .rows = found.in_motion.front()->size(),
                                .without = judge.error(found, model),
                                .with = judge.error(found, found.model())},
                               facts));
  }
  if (!found.lag_is_of_current) return;
  HoldingTorque less = found.holding;
  less.lag = 0;
  MotionModel model = found.model();
  model.holding = &less;
  r.effects.push_back(traced(lag_effect(SamplingFacts::kCurrent, found.holding.lag, 0), "sensing",
                             {{"lag_s", found.holding.sigma_lag}},
                             {.z = found.holding.lag / std::max(found.holding.sigma_lag, 1e-12),
                              .rows = found.holding.rows,
                              .without = judge.error(found, model),
                              .with = judge.error(found, found.model())},
                             facts));
  // Far longer than a current loop could stand: a filter of what is logged.
  r.effects.back().only_in_log = true;
}

void add_voltage(const Found& found, const DriveFacts& facts, TraceResult& r) {
  const WindingVoltage& v = found.voltage;
  if (v.sigma_R <= 0) return;
  const double R_s = facts.machine.R_s;
  std::string text = fmt::format("R_s = {:.3f} +- {:.3f} Ohm", v.R, v.sigma_R);
  if (v.R_at_rest > 0 && v.R_in_motion > 0)
    text += fmt::format(" (at rest {:.3f}, in motion {:.3f})", v.R_at_rest, v.R_in_motion);
  text += fmt::format(", declared {:.3f}", R_s);
  if (v.R_by_logged_speed > 0 && found.speed_lag.lag() > 0)
    text += fmt::format("; the logged speed, {:.2f} ms late, would make {:.3f} of it",
                        1e3 * found.speed_lag.lag(), v.R_by_logged_speed);
  r.identifiable.push_back(text);
  if (v.K_e > 0) r.constants.push_back({"psi_f", "Wb", v.K_e / facts.machine.n_p, {}, ""});
  if (v.K_e > 0)
    r.identifiable.push_back(fmt::format("psi_f = {:.4g} Wb from the EMF, declared {:.4g}",
                                         v.K_e / facts.machine.n_p, facts.machine.psi_f));
  auto effect = make_effect("resistance");
  const double change = v.R - R_s;
  set_key(*effect, "change_Ohm", change);
  r.constants.push_back({"R_s", "Ohm", v.R, v.sigma_R, ""});
  if (std::abs(change) > 0.02 * R_s && std::abs(change) > 3 * v.sigma_R)
    r.effects.push_back(traced(effect, "electrical", {{"change_Ohm", v.sigma_R}},
                               {.z = std::abs(change) / v.sigma_R, .rows = v.rows}, facts));
  const int n_p = facts.machine.n_p;
  for (const Harmonic& h : v.ripple) {
    const std::string why = fmt::format(
        "u_q at rest ripples {} times a turn ({} an electrical turn) by {:.1f} mV", h.order,
        h.order % n_p == 0 ? fmt::format("{}", h.order / n_p)
                           : fmt::format("{:.3g}", static_cast<double>(h.order) / n_p),
        1e3 * h.amplitude);
    const char* separate = "the same sweep with the phase currents and both voltages logged";
    if (h.order == n_p)
      r.ambiguous.push_back({{"inverter_offset", "current_offset"},
                             why +
                                 ": an offset that stands still in stator axes, of the inverter or "
                                 "of the current sensors",
                             separate});
    else if (h.order == 2 * n_p)
      r.ambiguous.push_back({{"phase_asymmetry", "current_gain"}, why, separate});
    else if (h.order % (3 * n_p) == 0)
      r.ambiguous.push_back({{"dead_time", "inverter_drop", "flux_harmonics"}, why, separate});
    else
      r.unexplained.push_back({.regressor = "theta_m",
                               .share = h.amplitude * h.amplitude / 2 /
                                        std::max(v.rest_declared * v.rest_declared, 1e-300),
                               .equation = "electrical",
                               .order = static_cast<double>(h.order),
                               .text = why});
  }
  EquationError e{.unit = "V", .before = {v.rest_declared, kNone}, .after = {v.rest, kNone}};
  e.no_change = e.noise_floor = e.whiteness_p_value = kNone;
  e.rows = v.rows;
  r.electrical = e;
}

void add_errors(const Found& found, const Judge& judge, TraceResult& r) {
  const Errors train = judge.over(found, found.model(), false);
  const Errors unseen = judge.over(found, found.model(), true);
  const auto rms = [](double sum, const Errors& e) { return Errors::rms(sum, e.rows); };
  EquationError e{.unit = judge.by_speed() ? "rad/s" : "A",
                  .before = {rms(train.before, train), rms(unseen.before, unseen)},
                  .after = {rms(train.after, train), rms(unseen.after, unseen)}};
  const Errors& shown = unseen.rows > 0 ? unseen : train;
  e.no_change = rms(shown.no_change, shown);
  e.noise_floor = e.whiteness_p_value = kNone;
  e.rows = static_cast<std::size_t>(shown.rows);
  r.mechanical = e;
  r.main_equation = "mechanical";
  r.horizon_s = judge.horizon();
  for (const PositionLog* log : judge.logs()) {
    Errors own;
    judge.add(*log, found, found.model(), own);
    r.files.push_back({log->path, log->held_out, e.unit, static_cast<std::size_t>(own.rows),
                       rms(own.no_change, own), rms(own.before, own), rms(own.after, own)});
  }
}

double turns_covered(const Logs& logs) {
  double most = 0;
  for (const PositionLog* log : logs) {
    const auto [low, high] = std::minmax_element(log->theta_m.begin(), log->theta_m.end());
    most = std::max(most, (*high - *low) / kTwoPi);
  }
  return most;
}

std::string sentence(const TraceResult& r, const Found& found, const Judge& judge) {
  std::vector<std::string> parts;
  if (!found.holding.cogging.empty()) {
    std::vector<int> orders;
    for (const Harmonic& h : found.holding.cogging) orders.push_back(h.order);
    const std::size_t shown = std::min<std::size_t>(orders.size(), 6);
    parts.push_back(fmt::format(
        "cogging of order {}{}",
        fmt::join(orders.begin(), orders.begin() + static_cast<std::ptrdiff_t>(shown), ", "),
        orders.size() > shown ? fmt::format(" and {} more", orders.size() - shown) : ""));
  }
  for (const TracedEffect& e : r.effects) {
    if (e.effect->kind() == "cogging") continue;
    if (e.effect->kind() == "coulomb_friction")
      parts.push_back(fmt::format("Coulomb friction {:.2f} mNm", 1e3 * found.T_C()));
    else if (e.effect->kind() == "signal_lag")
      parts.push_back(
          e.only_in_log
              ? fmt::format("a filter of {:.0f} ms in the logged current", 1e3 * found.holding.lag)
              : fmt::format("the logged speed {:.2f} ms late", 1e3 * found.speed_lag.lag()));
    else
      parts.emplace_back(e.effect->kind());
  }
  const EquationError& e = *r.mechanical;
  const bool unseen = std::isfinite(e.after.held_out);
  const double before = unseen ? e.before.held_out : e.before.train;
  const double after = unseen ? e.after.held_out : e.after.train;
  const std::string of =
      judge.by_speed() ? fmt::format("of the speed's change over {:.3g} ms", 1e3 * judge.horizon())
                       : std::string("of the holding current");
  return fmt::format(
      "{}{}; the error {} on {} data falls from {:.3g} to {:.3g} {} (no change: {:.3g}).",
      parts.empty() ? "Nothing is missing" : "The model lacks ", fmt::join(parts, ", "), of,
      unseen ? "unseen" : "training", before, after, e.unit, e.no_change);
}

}  // namespace

TraceResult trace_positions(const std::vector<PositionLog>& logs, const DriveFacts& facts,
                            const PositionSettings& settings) {
  TraceResult r;
  Found found{.machine = facts.machine};
  for (const PositionLog& log : logs) {
    const bool at_rest = is_quasi_static(log, facts.machine);
    (log.held_out ? r.held_out_sources : r.sources).push_back(log.path);
    r.health.push_back(fmt::format(
        "{}: {} rows, {}{}", log.path, log.size(),
        at_rest ? "the current holds the rotor" : "the current accelerates the rotor",
        log.has_time() ? fmt::format(", every {:.3g} ms (median)", 1e3 * sample_interval(log))
                       : std::string(", no time")));
    if (!log.held_out) (at_rest ? found.at_rest : found.in_motion).push_back(&log);
  }
  found.holding = trace_holding_torque(found.at_rest, facts.machine);
  found.spin = fit_spin_up(found.in_motion, facts.machine);
  found.lag_is_of_current = found.holding.lag > 0;
  if (found.lag_is_of_current && found.spin.gain > 0) {
    // Where the current moves the rotor without that lag, the lag was a slow controller's.
    const SpinUp late = fit_spin_up(found.in_motion, facts.machine, found.holding.lag);
    found.lag_is_of_current = late.rest / late.variation < found.spin.rest / found.spin.variation;
    if (found.lag_is_of_current) found.spin = late;
  }
  for (const PositionLog* log : found.in_motion)
    if (const SpeedLag lag = fit_speed_lag(*log); lag.lag() > found.speed_lag.lag())
      found.speed_lag = lag;
  found.voltage = trace_winding_voltage(found.at_rest, found.in_motion, facts.machine);

  Judge judge(logs, facts.machine, settings.horizon);
  if (!found.holding.cogging.empty()) judge.find_other_zeros(found);
  for (const PositionLog* log : judge.other_zero())
    r.health.push_back(log->path +
                       ": its angle has another zero than the logs that show the cogging; judged "
                       "without it");
  add_periodic(found, judge, facts, r);
  add_friction(found, judge, facts, r);
  add_inertia(found, judge, facts, r);
  add_lags(found, judge, facts, r);
  add_voltage(found, facts, r);
  add_errors(found, judge, r);
  if (found.at_rest.empty())
    r.not_identifiable.push_back({"cogging",
                                  "no log in which the current holds the rotor; a slow sweep of "
                                  "the position would show it"});
  if (found.in_motion.empty())
    r.not_identifiable.push_back({"inertia", "no log in which the current accelerates the rotor"});
  const double turns = turns_covered(found.at_rest);
  if (!found.at_rest.empty() && turns < 0.9)
    r.not_identifiable.push_back(
        {"cogging",
         fmt::format("the sweep covers {:.2f} of a turn; a whole one is needed", turns)});
  for (const char* kind : {"saturation", "dead_time", "phase_asymmetry", "iron_loss"})
    r.not_identifiable.push_back({kind, "phase currents and both voltages are not in the data"});
  r.verdict = !r.effects.empty()     ? "traced"
              : !r.ambiguous.empty() ? "ambiguous"
                                     : "nothing_missing";
  r.sentence = sentence(r, found, judge);
  if (r.effects.empty() && !found.at_rest.empty() && turns < 0.9) {
    r.verdict = "ambiguous";
    r.sentence = fmt::format(
        "Cannot tell: the sweep covers {:.2f} of a turn; a whole one is needed.", turns);
  }
  return r;
}

std::vector<PositionLog> hold_out(const std::vector<PositionLog>& logs, double share) {
  std::vector<PositionLog> all;
  for (const PositionLog& log : logs) {
    PositionLog train{.path = log.path}, unseen{.path = log.path, .held_out = true};
    const auto every = static_cast<std::size_t>(std::lround(1 / share));
    for (std::size_t k = 0; k < log.size(); ++k) {
      const bool late =
          log.has_time() ? static_cast<double>(k) >= (1 - share) * static_cast<double>(log.size())
                         : k % every == every - 1;
      PositionLog& to = late ? unseen : train;
      if (log.has_time()) to.t.push_back(log.t[k]);
      to.theta_m.push_back(log.theta_m[k]);
      to.i_q.push_back(log.i_q[k]);
      if (!log.omega_m.empty()) to.omega_m.push_back(log.omega_m[k]);
      if (!log.u_q.empty()) to.u_q.push_back(log.u_q[k]);
    }
    all.push_back(std::move(train));
    all.push_back(std::move(unseen));
  }
  return all;
}

}  // namespace twinrate
