#include "plant_sim/plant.hpp"

#include <algorithm>
#include <cmath>

namespace twinrate {
namespace {

constexpr double kShortestStep = 1e-9;  // of an interval: an integrator has nothing to do in less

// The effects, split: those that a switched inverter makes itself, those on samples, the others.
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

Plant::Plant(Config& config) : Plant(config.drive(), config.read<PlantParameters>()) {}

Plant::Plant(const DriveConfig& config, const PlantParameters& parameters)
    : config_(config),
      parameters_(parameters),
      model_(config.machine, effects_of(config).in_equations, config.inverter.v_dc,
             parameters.saliency),
      integrator_(make_integrator(parameters.engine, model_, parameters.erk_steps)),
      switched_(switched_inverter(config)),
      errors_(sample_errors(config)),
      x_(0, 0, config.omega_m_start(), parameters.theta_e_start / config.machine.n_p),
      T_load_(config.load.slew_Nm_s > 0 ? 0 : config.load.T_load_Nm.at(0)) {
  input_.T_load = T_load_;
  v_dc_ = model_.bus_voltage(x_, input_, 0);
  shaft_ = model_.shaft_at_rest(0, x_[2], T_load_);
  late_currents_ = late_state(config, SamplingFacts::kCurrent, x_);
  late_angle_ = late_state(config, SamplingFacts::kAngle, x_);
  applied_ = svpwm(Vec2::Zero(), v_dc_);
  acting_duty_ = applied_.duty_abc;
  reading_ = model_.sensing_at(x_, input_, 0);
  sense_currents();
  theta_m_meas_ = sample_angle(config.sensors, sensed_angle());
  omega_m_meas_ = x_[2];
}

Measurement Plant::sample() const {
  Measurement m;
  m.k = k_;
  m.t_ns = config_.t_ns(k_);
  m.signals = kPhaseCurrents | kVoltage | kBusVoltage | kPosition | kSpeed;
  m.i_abc =
      sample_currents(config_.sensors, i_abc_, static_cast<std::uint64_t>(config_.run.seed), k_);
  if (errors_) m.i_abc = errors_->converted(m.i_abc, config_.sensors.current_sensors);
  m.u_alphabeta = applied_.u_alphabeta;
  m.duty_abc = applied_.duty_abc;
  m.mode = applied_command_.mode;
  m.theta_forced = applied_command_.theta_ctrl;
  m.v_dc = v_dc_;
  m.theta_m = theta_m_meas_;
  m.omega_m = omega_m_meas_;
  if (errors_ && k_ > 0) errors_->spoil_row(m, before_);
  return m;
}

Truth Plant::truth() const {
  Truth t;
  t.k = k_;
  t.t_ns = config_.t_ns(k_);
  t.i_dq = x_.head<2>();
  t.omega_m = x_[2];
  t.theta_m = x_[3];
  t.T_em = model_.torque(x_.head<2>());
  t.T_load = model_.total_load(x_, input_, k_ > 0 ? config_.T_s() : 0);
  return t;
}

void Plant::take_command(const Command& command) {
  if (command.k < 0 || !is_finite(command)) return;
  Command& slot = commands_[static_cast<std::size_t>(command.k) % commands_.size()];
  if (command.k > slot.k)
    slot = command;  // an old one may arrive again: it must not displace a newer one
}

bool Plant::apply_due_command() {
  const std::int64_t due = k_ - parameters_.delay_samples;
  bool in_time = true;
  if (due >= 0) {
    const Command& command = commands_[static_cast<std::size_t>(due) % commands_.size()];
    in_time = command.k == due;
    if (in_time) applied_command_ = command;
    held_ticks_ = in_time ? 0 : held_ticks_ + 1;
    if (held_ticks_ > parameters_.hold_ticks) tripped_ = true;
  }
  if (tripped_) applied_command_ = Command{.mode = Mode::kSafe};
  applied_ = svpwm(applied_command_.u_alphabeta_ref, v_dc_);
  return in_time;
}

bool Plant::advance() {
  if (errors_) before_ = sample();
  const bool in_time = apply_due_command();
  const double T_s = config_.T_s();
  const double t_k = static_cast<double>(k_) * T_s;
  T_load_ = slew(T_load_, config_.load.T_load_Nm.at(t_k), config_.load.slew_Nm_s, T_s);
  acting_duty_ = errors_ ? errors_->acting_duty(applied_.duty_abc) : applied_.duty_abc;
  input_ = {
      .t_k = t_k, .u_alphabeta = clarke(acting_duty_ * config_.inverter.v_dc), .T_load = T_load_};
  integrate();
  ++k_;
  read_sensors();
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
    advance_part(input_, 0, config_.T_s());
    return;
  }
  const double f_pwm = config_.facts().f_pwm;
  const auto periods = static_cast<int>(std::lround(f_pwm * config_.T_s()));
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

void Plant::read_sensors() {
  const double T_s = config_.T_s();
  v_dc_ = model_.bus_voltage(x_, input_, T_s);
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
  i_abc_ = inverse_clarke(inverse_park(x.head<2>(), config_.machine.n_p * x[3]));
  if (!model_.currents_are_read_true())
    i_abc_ += late_currents_ ? model_.sensing_at(x, input_, config_.T_s()).i_abc : reading_.i_abc;
  if (errors_) i_abc_ = errors_->filtered_currents(i_abc_);
}

double Plant::sensed_angle() {
  const PlantState& x = late_angle_ ? late_angle_->seen() : x_;
  const double added =
      late_angle_ ? model_.sensing_at(x, input_, config_.T_s()).theta_m : reading_.theta_m;
  return errors_ ? errors_->filtered_angle(x[3] + added) : x[3] + added;
}

}  // namespace twinrate
