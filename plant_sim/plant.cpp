#include "plant_sim/plant.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "model/per_unit.hpp"

namespace twinrate {
namespace {

constexpr double kShortestStep = 1e-9;  // of an interval: an integrator has nothing to do in less

// The effects by place: in the switched inverter, on samples, elsewhere.
struct PlantEffects {
  Effects in_equations;
  LegFacts legs;
  SamplingFacts sampling;
  bool spoils_samples = false;
};
PlantEffects effects_of(const DriveConfig& config) {
  PlantEffects split;
  const bool switched = config.plant.inverter == InverterModel::kSwitched;
  for (const auto& effect : config.plant_effects()) {
    if (effect->describe_sampling(split.sampling))
      split.spoils_samples = true;
    else if (!switched || !effect->describe_legs(split.legs))
      split.in_equations.push_back(effect);
  }
  return split;
}

std::optional<SampleErrors> sample_errors(const DriveConfig& config) {
  const PlantEffects effects = effects_of(config);
  if (!effects.spoils_samples) return {};
  return SampleErrors(effects.sampling, config.T_s(), static_cast<std::uint64_t>(config.run.seed));
}

std::optional<LateState> late_state(const DriveConfig& config, SamplingFacts::Signal signal,
                                    const PlantState& x) {
  const double delay = effects_of(config).sampling.delay[signal];
  if (delay <= 0) return {};
  return LateState(delay, config.T_s(), x);
}

// Filters whose angle is that of the position sensor, and controllers that use it.
bool needs_position(const DriveConfig& config) {
  const std::string& kind = config.estimator.kind;
  return config.controller.angle_source == AngleSource::kMeasured || kind == "ekf_disturbance" ||
         kind == "ekf_harmonic";
}

std::optional<SwitchedInverter> switched_inverter(const DriveConfig& config) {
  if (config.plant.inverter != InverterModel::kSwitched) return {};
  const double t_d = effects_of(config).legs.dead_time;
  const double L = std::min(config.machine.L_d, config.machine.L_q);
  const double i_zero = std::max(1e-9, 0.5 * config.inverter.v_dc * t_d / L);
  return SwitchedInverter(1 / config.facts().f_pwm, t_d, i_zero);
}

}  // namespace

bool is_finite(const Command& command) {
  return command.u_alphabeta_ref.allFinite() && std::isfinite(command.theta_ctrl);
}

Plant::Plant(Config& config)
    : Plant(config, config.read<PlantParameters>(), config.read<SafetyParameters>()) {
  const auto planned = planned_emergencies(config.drive(), steering_of(config));
  planned_.assign(planned.begin(), planned.end());
}

Plant::Plant(const Config& file, const PlantParameters& parameters, const SafetyParameters& safety)
    : config_(file.drive()),
      T_s_(config_.T_s()),
      parameters_(parameters),
      model_(config_.machine, effects_of(config_).in_equations, config_.inverter.v_dc,
             parameters.saliency),
      integrator_(make_integrator(parameters.engine, model_, parameters.erk_steps)),
      switched_(switched_inverter(config_)),
      current_sensors_(config_.sensors, static_cast<std::uint64_t>(config_.run.seed)),
      errors_(sample_errors(config_)),
      x_(0, 0, config_.omega_m_start(), parameters.theta_e_start / config_.machine.n_p),
      keeps_rows_(errors_ || parameters.fault.kind == MadeFault::kCurrentStuck),
      safety_(safety_limits(file, safety, parameters.hold_ticks)),
      current_limit_(current_limit(config_)),
      winding_(parameters.winding,
               per_unit(config_.machine, config_.inverter.v_dc, config_.T_s()).i, config_.T_s()),
      watch_(sensor_limits(config_, safety_.limits())),
      watches_(safety.watch_sensors),
      needs_position_(needs_position(config_)),
      T_load_(config_.load.slew_Nm_s > 0 ? 0 : config_.load.T_load_Nm.at(0)) {
  if (switched_ && parameters.fault.kind == MadeFault::kBusVoltage)
    throw BadInput(file.where("plant.fault.kind") +
                   ": plant.fault.kind: bus_voltage allowed with plant.inverter = averaged");
  const auto& off = safety_.limits().off;
  if (parameters.fault.kind == MadeFault::kBusVoltage &&
      std::find(off.begin(), off.end(), Off::kOpen) != off.end())
    throw BadInput(file.where("plant.fault.kind") +
                   ": plant.fault.kind: bus_voltage allowed with safety.off = short: the diodes of "
                   "open gates are at the nominal bus voltage");
  input_.T_load = T_load_;
  v_dc_ = model_.bus_voltage(x_, input_, 0);
  shaft_ = model_.shaft_at_rest(0, x_[2], T_load_);
  late_currents_ = late_state(config_, SamplingFacts::kCurrent, x_);
  late_angle_ = late_state(config_, SamplingFacts::kAngle, x_);
  applied_ = svpwm(Vec2::Zero(), v_dc_);
  acting_duty_ = applied_.duty_abc;
  reading_ = model_.sensing_at(x_, input_, 0);
  sense_currents();
  theta_m_meas_ = sample_angle(config_.sensors, sensed_angle());
  omega_m_meas_ = x_[2];
  take_row();
}

void Plant::begin_at(std::int64_t k, double theta_m) {
  k_ = k;
  x_[3] += theta_m;
  late_currents_ = late_state(config_, SamplingFacts::kCurrent, x_);
  late_angle_ = late_state(config_, SamplingFacts::kAngle, x_);
  sense_currents();
  theta_m_meas_ = sample_angle(config_.sensors, sensed_angle());
  watch_ = SensorWatch(sensor_limits(config_, safety_.limits()));
  take_row();
}

bool Plant::makes(MadeFault kind) const {
  const FaultParameters& fault = parameters_.fault;
  if (fault.kind != kind) return false;
  const double t = static_cast<double>(k_) * T_s_ + 1e-9 - fault.at_s;
  return t >= 0 && t < fault.for_s;
}

void Plant::spoil_reading(Measurement& m) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  if (makes(MadeFault::kCurrentNan)) m.i_abc[0] = kNan;
  if (makes(MadeFault::kCurrentStuck) && k_ > 0) m.i_abc[0] = row_.i_abc[0];
  if (makes(MadeFault::kCurrentJump)) m.i_abc[0] += parameters_.fault.value;
  if (makes(MadeFault::kPositionNan)) m.theta_m = kNan;
  if (makes(MadeFault::kPositionJump)) m.theta_m += parameters_.fault.value;
}

// SensorReadings that are predicted count as not measured.
void Plant::mark_faults(Measurement& m) const {
  if (faults_ & kBusNotFinite) m.signals &= ~kBusVoltage;
  if (faults_ & kAnyPositionFault) m.signals &= ~(kPosition | kSpeed);
  const bool row_lost =
      (faults_ & kAnyCurrentFault) || (needs_position_ && (faults_ & kAnyPositionFault));
  if (row_lost) m.signals &= kVoltage | kBusVoltage;
  if (is_open()) m.signals &= ~kVoltage;
}

// Reads the row at t_k, with the drive's own processing.
void Plant::take_row() {
  Measurement& m = sample_;
  read_row(m);
  spoil_reading(m);
  if (keeps_rows_) row_ = m;
  faults_ = 0;
  if (watches_) {
    SensorReadings r{{m.i_abc[0], m.i_abc[1], m.i_abc[2]}, m.v_dc, m.theta_m, m.omega_m};
    const bool measured = (m.signals & kPhaseCurrents) != 0;
    const Vec2& u = applied_.u_alphabeta;
    const double amplitude = std::sqrt(u[0] * u[0] + u[1] * u[1]);
    faults_ = watch_.check(r, {amplitude, applied_command_.theta_ctrl}, measured);
    if (measured) {
      m.i_abc = {r.i_abc[0], r.i_abc[1], r.i_abc[2]};
      m.v_dc = r.v_dc, m.theta_m = r.theta_m, m.omega_m = r.omega_m;
    }
  }
  mark_faults(m);
}

void Plant::read_row(Measurement& m) {
  m.k = k_;
  m.t_ns = config_.t_ns(k_);
  m.signals = kPhaseCurrents | kVoltage | kBusVoltage | kPosition | kSpeed;
  m.i_abc = current_sensors_.sample(i_abc_, k_);
  if (errors_) m.i_abc = errors_->converted(m.i_abc, config_.sensors.current_sensors);
  m.u_alphabeta[0] = applied_.u_alphabeta[0];
  m.u_alphabeta[1] = applied_.u_alphabeta[1];
  m.duty_abc = applied_.duty_abc;
  m.mode = applied_command_.mode;
  m.theta_forced = applied_command_.theta_ctrl;
  m.v_dc = v_dc_;
  m.theta_m = theta_m_meas_;
  m.omega_m = omega_m_meas_;
  if (errors_ && k_ > 0) errors_->spoil_row(m, before_);
}

Truth Plant::truth() const {
  Truth t;
  t.k = k_;
  t.t_ns = sample_.t_ns;
  t.i_dq[0] = x_[0];
  t.i_dq[1] = x_[1];
  t.omega_m = x_[2];
  t.theta_m = x_[3];
  t.T_em = model_.torque(x_.head<2>());
  t.T_load = model_.total_load(x_, input_, k_ > 0 ? T_s_ : 0);
  return t;
}

void Plant::take_command(const Command& received) {
  if (received.k < 0 || makes(MadeFault::kCommandMissing)) return;
  const auto at = static_cast<std::size_t>(received.k) % commands_.size();
  if (!is_finite(received) || makes(MadeFault::kCommandNan)) {
    not_finite_k_[at] = received.k;
    return;
  }
  Command& slot = commands_[at];
  if (received.k <= slot.k) return;  // an old one may arrive again
  slot = received;
  if (makes(MadeFault::kCommandTooLarge)) slot.u_alphabeta_ref *= parameters_.fault.value;
}

bool Plant::command_is_missing() const {
  const std::int64_t due = k_ - parameters_.delay_samples;
  return !safety_.is_off() && due >= 0 && !has(due) && !was_not_finite(due);
}

bool Plant::contradicts(const Command& command) const {
  if (command.k < 0) return false;
  const Command& there = commands_[static_cast<std::size_t>(command.k) % commands_.size()];
  return there.k == command.k &&
         (there.u_alphabeta_ref != command.u_alphabeta_ref || there.mode != command.mode ||
          there.theta_ctrl != command.theta_ctrl);
}

std::string Plant::reset(std::int64_t k) {
  if (!safety_.is_off()) return "the drive is not off";
  if (!safety_.may_reset()) return "the cause is still there";
  reset_k_ = std::max(k, k_);
  return "";
}

bool Plant::has(std::int64_t k) const {
  return commands_[static_cast<std::size_t>(k) % commands_.size()].k == k;
}
bool Plant::was_not_finite(std::int64_t k) const {
  return not_finite_k_[static_cast<std::size_t>(k) % not_finite_k_.size()] == k;
}

Arrival Plant::take_due_command(std::int64_t due) {
  if (due < 0) return Arrival::kNotDue;
  if (!has(due) && was_not_finite(due)) return Arrival::kNotFinite;
  const Command* newest = &applied_command_;
  if (has(due) && due > newest->k) {
    newest = &commands_[static_cast<std::size_t>(due) % commands_.size()];
  } else {
    for (const Command& c : commands_)
      if (c.k <= due && c.k > newest->k) newest = &c;
  }
  if (newest == &applied_command_ || due - newest->k > safety_.limits().hold_ticks)
    return Arrival::kMissing;
  const double turned = wrap_pi(newest->theta_ctrl - applied_command_.theta_ctrl);
  const auto ticks = static_cast<double>(newest->k - applied_command_.k);
  frame_turns_ = applied_command_.k >= 0 ? turned / (ticks * T_s_) : 0;
  applied_command_ = *newest;
  return Arrival::kInTime;
}

// One step of the state machine with the readings of t_k and the command in force.
void Plant::protect(Arrival arrival, bool clamped) {
  SafetyInput in;
  in.reset = reset_k_ >= 0 && k_ >= reset_k_;
  if (in.reset) {
    emergency_stop_ = supervisor_silent_ = stop_was_planned_ = false;
    reset_k_ = -1;
  }
  in.arrival = arrival;
  in.asked = applied_command_.mode == Mode::kSafe  ? Asked::kSafe
             : applied_command_.mode == Mode::kRun ? Asked::kRun
                                                   : Asked::kForcedAngle;
  in.clamped = clamped;
  in.faulty = needs_position_ ? faults_ : faults_ & ~kAnyPositionFault;
  const Vec2 i = clarke(sample_.i_abc);
  in.i = std::sqrt(i[0] * i[0] + i[1] * i[1]);
  in.v_dc = sample_.v_dc;
  in.omega_m = sample_.omega_m;
  in.has_temperature = safety_.limits().temperature_max > 0;
  in.temperature = sensed_temperature();
  in.emergency_stop = emergency_stop_;
  in.supervisor_silent = supervisor_silent_;
  safety_.step(in);
}

double Plant::sensed_temperature() const {
  return makes(MadeFault::kTemperature) ? parameters_.fault.value : winding_.temperature();
}

Vec2 Plant::voltage_in_force() const {
  const Command& c = applied_command_;
  if (safety_.state() != DriveState::kDerate) return c.u_alphabeta_ref;
  // The frame at t_k, and in the middle of the interval.
  const double turned = frame_turns_ * T_s_;
  const double theta_e = c.theta_ctrl + parameters_.delay_samples * turned;
  const Vec2 i_dq = park(clarke(sample_.i_abc), theta_e);
  const Vec2 u_dq = park(c.u_alphabeta_ref, theta_e + 0.5 * turned);
  const auto u = current_limit_.limited({u_dq[0], u_dq[1]}, {i_dq[0], i_dq[1]}, frame_turns_,
                                        safety_.current_share() * safety_.limits().i_derate);
  return inverse_park({u[0], u[1]}, theta_e + 0.5 * turned);
}

bool Plant::apply_due_command() {
  const std::int64_t due = k_ - parameters_.delay_samples;
  const Arrival arrival = take_due_command(due);
  const bool in_time = applied_command_.k == due;
  svpwm(applied_command_.u_alphabeta_ref, v_dc_, applied_);
  protect(arrival, applied_.limited);
  if (safety_.is_off()) applied_command_ = Command{.mode = Mode::kSafe};
  if (applied_command_.mode == Mode::kSafe) applied_command_.u_alphabeta_ref.setZero();
  const bool as_asked = applied_command_.mode != Mode::kSafe;
  if (!as_asked || safety_.state() == DriveState::kDerate)
    svpwm(voltage_in_force(), v_dc_, applied_);
  return arrival == Arrival::kNotDue || in_time;
}

void Plant::do_what_is_planned() {
  while (!planned_.empty()) {
    const auto [k, is_reset] = planned_.front();
    if (k_ < (is_reset ? k - 1 : k)) return;
    is_reset ? void(reset(k)) : emergency_stop();
    stop_was_planned_ = !is_reset;
    planned_.pop_front();
  }
}

[[gnu::flatten]] bool Plant::advance() {
  do_what_is_planned();
  if (errors_) before_ = row_;
  bus_share_ = makes(MadeFault::kBusVoltage) ? parameters_.fault.value / config_.inverter.v_dc : 1;
  const bool in_time = apply_due_command();
  const double t_k = static_cast<double>(k_) * T_s_;
  T_load_ = slew(T_load_, config_.load.T_load_Nm.at(t_k), config_.load.slew_Nm_s, T_s_);
  acting_duty_ = errors_ ? errors_->acting_duty(applied_.duty_abc) : applied_.duty_abc;
  const Vec2 u_alphabeta = clarke(acting_duty_ * (bus_share_ * config_.inverter.v_dc));
  input_.t_k = t_k;
  input_.u_alphabeta[0] = u_alphabeta[0];
  input_.u_alphabeta[1] = u_alphabeta[1];
  input_.T_load = T_load_;
  input_.rotor_axes = rotor_axes_;
  is_open() ? integrate_open() : integrate();
  winding_.step(x_.head<2>().norm());
  ++k_;
  read_sensors();
  take_row();
  return in_time;
}

void Plant::step(PlantState& x, ShaftState& shaft, const PlantInput& input, double T) {
  if (!model_.has_shaft()) {
    x = integrator_->advance(x, input, T);
    return;
  }
  TwoMassState both;
  both << x, shaft.delta, shaft.omega_load;
  both = integrator_->advance_two_masses(both, input, T);
  x = both.head<4>();
  shaft = {both[4], both[5]};
}

void Plant::advance_part(const PlantInput& input, double from, double T) {
  for (std::optional<LateState>* late : {&late_currents_, &late_angle_}) {
    if (!*late) continue;
    const double moment = (*late)->moment();
    if (moment <= from || moment > from + T) continue;
    ShaftState shaft = shaft_;
    (*late)->caught() = x_;
    if (moment - from > kShortestStep * T) step((*late)->caught(), shaft, input, moment - from);
  }
  step(x_, shaft_, input, T);
}

void Plant::integrate() {
  if (!switched_) {
    advance_part(input_, 0, T_s_);
    return;
  }
  const double f_pwm = config_.facts().f_pwm;
  const auto periods = static_cast<int>(std::lround(f_pwm * T_s_));
  PlantInput input = input_;
  for (int period = 0; period < periods; ++period) {
    for (const Segment& segment : switched_->next_period(acting_duty_)) {
      const double from = period / f_pwm + segment.t_start;
      input.t_k = input_.t_k + period / f_pwm + segment.t_start;
      input.legs = segment.states;
      advance_part(input, from, segment.T);
    }
  }
}

// All switches off. Legs in dead time are their diodes: i_zero makes a blocking leg settle within
// one part of the interval. Once the current is zero it stays zero while the EMF is below the bus
// voltage: the terminals follow the EMF.
void Plant::integrate_open() {
  constexpr double kConducting = 0.01, kBlocking = 0.1;  // parts of an interval
  const MachineParameters& m = config_.machine;
  const double T_s = T_s_, v_dc = config_.inverter.v_dc * bus_share_;
  LegStates diodes{.legs = {Leg::kDead, Leg::kDead, Leg::kDead}};
  diodes.i_zero = v_dc * kConducting * T_s / (2 * std::min(m.L_d, m.L_q));
  for (double done = 0; done < 1 - 1e-9;) {
    PlantInput input = input_;
    input.t_k = input_.t_k + done * T_s;
    const double omega_e = m.n_p * x_[2];
    const bool blocks = std::numbers::sqrt3 * m.psi_f * std::abs(omega_e) < v_dc &&
                        x_.head<2>().norm() < 2 * diodes.i_zero;
    const double part = std::min(blocks ? kBlocking : kConducting, 1 - done);
    if (blocks) {
      x_.head<2>().setZero();
      input.u_alphabeta =
          inverse_park(Vec2(0, omega_e * m.psi_f), m.n_p * x_[3] + 0.5 * part * T_s * omega_e);
    } else {
      input.legs = diodes;
    }
    advance_part(input, done * T_s, part * T_s);
    if (blocks) x_.head<2>().setZero();
    done += part;
  }
}

void Plant::read_sensors() {
  const double T_s = T_s_;
  v_dc_ = model_.bus_voltage(x_, input_, T_s) * bus_share_;
  reading_ = model_.sensing_at(x_, input_, T_s);
  sense_currents();
  const double theta_m_meas = sample_angle(config_.sensors, sensed_angle());
  const bool exact = config_.sensors.encoder_counts == 0 && model_.angle_is_read_true() &&
                     !(errors_ && errors_->angle_is_late());
  omega_m_meas_ = (exact ? x_[2] : (theta_m_meas - theta_m_meas_) / T_s) + reading_.omega_m;
  if (errors_) omega_m_meas_ = errors_->late_speed(omega_m_meas_);
  theta_m_meas_ = theta_m_meas;
}

void Plant::sense_currents() {
  const PlantState& x = late_currents_ ? late_currents_->seen() : x_;
  rotor_axes_ = RotorAxes(config_.machine.n_p * x[3]);
  const auto [s, c] = rotor_axes_.at;
  i_abc_ = inverse_clarke({c * x[0] - s * x[1], s * x[0] + c * x[1]});
  if (!model_.currents_are_read_true())
    i_abc_ += late_currents_ ? model_.sensing_at(x, input_, T_s_).i_abc : reading_.i_abc;
  if (errors_) i_abc_ = errors_->filtered_currents(i_abc_);
}

double Plant::sensed_angle() {
  const PlantState& x = late_angle_ ? late_angle_->seen() : x_;
  const double added = late_angle_ ? model_.sensing_at(x, input_, T_s_).theta_m : reading_.theta_m;
  return errors_ ? errors_->filtered_angle(x[3] + added) : x[3] + added;
}

}  // namespace twinrate
