#include "plant_sim/plant.hpp"

#include <algorithm>

namespace twinrate {
namespace {

// What of the effects a switched inverter does itself, and the others.
struct PlantEffects {
  Effects in_equations;
  LegFacts legs;
};
PlantEffects effects_of(const DriveConfig& config) {
  PlantEffects split;
  const bool switched = config.plant.inverter == 1;
  for (const auto& effect : config.plant_effects())
    if (!switched || !effect->describe_legs(split.legs)) split.in_equations.push_back(effect);
  return split;
}

std::optional<SwitchedInverter> switched_inverter(const DriveConfig& config) {
  if (config.plant.inverter != 1) return {};
  const double t_d = effects_of(config).legs.dead_time;
  const double L = std::min(config.machine.L_d, config.machine.L_q);
  const double i_zero = std::max(1e-9, 0.5 * config.inverter.v_dc * t_d / L);
  return SwitchedInverter(1 / config.facts().f_pwm, t_d, i_zero);
}

}  // namespace

Plant::Plant(const DriveConfig& config)
    : config_(config),
      model_(config.machine, effects_of(config).in_equations, config.inverter.v_dc,
             static_cast<Saliency>(config.plant.saliency)),
      integrator_(make_integrator(static_cast<Engine>(config.plant.engine), model_,
                                  config.plant.erk_steps)),
      switched_(switched_inverter(config)),
      x_(0, 0, config.omega_m_start(), config.plant.theta_e_start / config.machine.n_p),
      T_load_(config.load.slew_Nm_s > 0 ? 0 : config.load.T_load_Nm.at(0)) {
  input_.T_load = T_load_;
  v_dc_ = model_.bus_voltage(x_, input_, 0);
  applied_ = svpwm(Vec2::Zero(), v_dc_);
  reading_ = model_.sensing_at(x_, input_, 0);
  theta_m_meas_ = sample_angle(config.sensors, x_[3] + reading_.theta_m);
  omega_m_meas_ = x_[2];
}

Measurement Plant::sample() const {
  Measurement m;
  m.k = k_;
  m.t_ns = config_.t_ns(k_);
  m.signals = kPhaseCurrents | kVoltage | kBusVoltage | kPosition | kSpeed;
  Vec3 i_abc = inverse_clarke(inverse_park(x_.head<2>(), config_.machine.n_p * x_[3]));
  if (!model_.currents_are_read_true()) i_abc += reading_.i_abc;
  m.i_abc =
      sample_currents(config_.sensors, i_abc, static_cast<std::uint64_t>(config_.run.seed), k_);
  m.u_alphabeta = applied_.u_alphabeta;
  m.duty_abc = applied_.duty_abc;
  m.mode = applied_command_.mode;
  m.theta_forced = applied_command_.theta_ctrl;
  m.v_dc = v_dc_;
  m.theta_m = theta_m_meas_;
  m.omega_m = omega_m_meas_;
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
  if (command.k < 0) return;
  Command& slot = commands_[static_cast<std::size_t>(command.k) % commands_.size()];
  if (command.k > slot.k)
    slot = command;  // an old one may arrive again: it must not displace a newer one
}

bool Plant::apply_due_command() {
  const std::int64_t due = k_ - config_.plant.delay_samples;
  bool in_time = true;
  if (due >= 0) {
    const Command& command = commands_[static_cast<std::size_t>(due) % commands_.size()];
    in_time = command.k == due;
    if (in_time) applied_command_ = command;
    held_ticks_ = in_time ? 0 : held_ticks_ + 1;
    if (held_ticks_ > config_.plant.hold_ticks) tripped_ = true;
  }
  if (tripped_) applied_command_ = Command{.mode = Mode::kSafe};
  applied_ = svpwm(applied_command_.u_alphabeta_ref, v_dc_);
  return in_time;
}

bool Plant::advance() {
  const bool in_time = apply_due_command();
  const double T_s = config_.T_s();
  const double t_k = static_cast<double>(k_) * T_s;
  T_load_ = slew(T_load_, config_.load.T_load_Nm.at(t_k), config_.load.slew_Nm_s, T_s);
  input_ = {.t_k = t_k,
            .u_alphabeta = clarke(applied_.duty_abc * config_.inverter.v_dc),
            .T_load = T_load_};
  integrate();
  ++k_;
  read_sensors();
  return in_time;
}

void Plant::integrate() {
  if (!switched_) {
    x_ = integrator_->advance(x_, input_, config_.T_s());
    return;
  }
  const double f_pwm = config_.facts().f_pwm;
  const auto periods = static_cast<int>(std::lround(f_pwm * config_.T_s()));
  PlantInput input = input_;
  for (int period = 0; period < periods; ++period) {
    for (const Segment& segment : switched_->next_period(applied_.duty_abc)) {
      input.t_k = input_.t_k + period / f_pwm + segment.t_start;
      input.legs = segment.states;
      x_ = integrator_->advance(x_, input, segment.T);
    }
  }
}

void Plant::read_sensors() {
  const double T_s = config_.T_s();
  v_dc_ = model_.bus_voltage(x_, input_, T_s);
  reading_ = model_.sensing_at(x_, input_, T_s);
  const double theta_m_meas = sample_angle(config_.sensors, x_[3] + reading_.theta_m);
  const bool exact = config_.sensors.encoder_counts == 0 && model_.angle_is_read_true();
  omega_m_meas_ = exact ? x_[2] : (theta_m_meas - theta_m_meas_) / T_s;
  theta_m_meas_ = theta_m_meas;
}

}  // namespace twinrate
