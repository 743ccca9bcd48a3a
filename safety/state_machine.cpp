#include "safety/state_machine.hpp"

#include <utility>

namespace twinrate {
namespace {

double magnitude(double x) {
  return x < 0 ? -x : x;
}

}  // namespace

void SafetyMachine::add_event(const SafetyEvent& event) {
  if (event_count_ < static_cast<int>(events_.size()))
    events_[static_cast<std::size_t>(event_count_++)] = event;
}

void SafetyMachine::change_to(DriveState state, Reason reason, double value, double limit) {
  add_event({reason, state_, state, value, limit});
  state_ = state;
}

// A number that is not finite exceeds every limit.
void SafetyMachine::count(const SafetyInput& in) {
  // In IDLE there is no voltage to hold: the drive waits.
  const bool waits = state_ == DriveState::kIdle;
  missing_ticks_ = in.arrival == Arrival::kMissing && !waits ? missing_ticks_ + 1 : 0;
  not_finite_ticks_ = in.arrival == Arrival::kNotFinite ? not_finite_ticks_ + 1 : 0;
  over_current_ticks_ = in.i <= limits_.i_trip ? 0 : over_current_ticks_ + 1;
  faulty_ticks_ = in.faulty != 0 ? faulty_ticks_ + 1 : 0;
  const double share = limits_.T_s / (limits_.T_s + kSpeedLowpass_s);
  omega_m_ = speed_known_ ? omega_m_ + share * (in.omega_m - omega_m_) : in.omega_m;
  speed_known_ = true;
}

// For a fault known at compile time: its own comparison and no more.
template <Fault fault>
bool SafetyMachine::trips(const SafetyInput& in, double& value, double& limit) const {
  const auto above = [&](double is, double most) {
    value = is;
    limit = most;
    return !(is <= most);
  };
  switch (fault) {
    case Fault::kEmergencyStop:
      return in.emergency_stop;
    case Fault::kOverCurrent:
      return above(in.i, limits_.i_trip) && over_current_ticks_ >= kOverCurrentTicks;
    case Fault::kOverVoltage:
      return above(in.v_dc, limits_.v_dc_max);
    case Fault::kUnderVoltage:
      value = in.v_dc;
      limit = limits_.v_dc_min;
      return in.v_dc < limit;
    case Fault::kOverSpeed:
      return above(magnitude(omega_m_), limits_.omega_m_max);
    case Fault::kOverTemperature:
      return in.has_temperature && above(in.temperature, limits_.temperature_max);
    case Fault::kSensorLost:
      return above(faulty_ticks_, limits_.sensor_ticks);
    case Fault::kCommandNotFinite:
      value = not_finite_ticks_;
      limit = kNotFiniteTicks;
      return not_finite_ticks_ >= kNotFiniteTicks;
    case Fault::kCommandLost:
      return above(missing_ticks_, limits_.hold_ticks);
    case Fault::kSupervisorLost:
      return in.supervisor_silent;
    case Fault::kSafeRequested:
      return in.arrival == Arrival::kInTime && in.asked == Asked::kSafe &&
             state_ != DriveState::kIdle;
  }
  return true;
}

template <std::size_t row>
bool SafetyMachine::goes_off(const SafetyInput& in) {
  constexpr Fault fault = kFaults[row].fault;
  double value = 0, limit = 0;
  if (!trips<fault>(in, value, limit)) return false;
  go_off(fault, value, limit);
  return true;
}

void SafetyMachine::go_off(Fault fault, double value, double limit) {
  const auto row = static_cast<std::size_t>(fault);
  off_ = limits_.off[row];
  current_share_ = 1;
  change_to(DriveState::kSafe, kFaults[row].reason, value, limit);
}

void SafetyMachine::follow_command(const SafetyInput& in) {
  if (in.arrival != Arrival::kInTime || in.asked == Asked::kSafe) return;
  const DriveState wanted = in.asked == Asked::kForcedAngle ? DriveState::kAlign : DriveState::kRun;
  const bool there =
      state_ == wanted || (state_ == DriveState::kDerate && wanted == DriveState::kRun);
  if (!there) change_to(wanted, Reason::kStateChange);
}

void SafetyMachine::derate(const SafetyInput& in) {
  if (!in.has_temperature) return;
  const double span = limits_.temperature_max - limits_.temperature_derate;
  const double left = limits_.temperature_max - in.temperature;
  const bool hot = in.temperature > limits_.temperature_derate;
  current_share_ = hot && span > 0 ? left / span : 1;
  if (hot && state_ == DriveState::kRun)
    change_to(DriveState::kDerate, Reason::kDerated, in.temperature, limits_.temperature_derate);
  // Back a tenth of the span lower, so that noise does not switch to and fro.
  const bool cool = in.temperature < limits_.temperature_derate - 0.1 * span;
  if (cool && state_ == DriveState::kDerate) change_to(DriveState::kRun, Reason::kStateChange);
}

[[gnu::flatten]] void SafetyMachine::step(const SafetyInput& in) {
  event_count_ = 0;
  if (in.reset) last_ = in, leave_safe();
  if (!is_off()) step_on(in);
  last_ = in;  // at the end: a copy waits for the last writes
}

void SafetyMachine::step_on(const SafetyInput& in) {
  count(in);
  if (in.clamped && since_clamped_s_ >= kClampPause_s)
    add_event({Reason::kVoltageClamped, state_, state_});
  since_clamped_s_ = in.clamped ? 0 : since_clamped_s_ + limits_.T_s;
  if ((in.faulty & ~faulty_before_) != 0)
    add_event({Reason::kSensorFault, state_, state_, static_cast<double>(in.faulty)});
  faulty_before_ = in.faulty;
  const bool off = [&]<std::size_t... row>(std::index_sequence<row...>) {
    return (goes_off<row>(in) || ...);
  }
  (std::make_index_sequence<kFaults.size()>());
  if (off) return;
  follow_command(in);
  derate(in);
}

// An emergency stop and a silent supervisor are past events, and the request answers them.
bool SafetyMachine::may_reset() const {
  return is_off() && last_.i <= limits_.i_trip && last_.v_dc <= limits_.v_dc_max &&
         last_.v_dc >= limits_.v_dc_min && magnitude(last_.omega_m) <= limits_.omega_m_max &&
         last_.faulty == 0 &&
         (!last_.has_temperature || last_.temperature <= limits_.temperature_max);
}

bool SafetyMachine::leave_safe() {
  if (!may_reset()) return false;
  missing_ticks_ = not_finite_ticks_ = over_current_ticks_ = faulty_ticks_ = 0;
  speed_known_ = false;
  change_to(DriveState::kIdle, Reason::kReset);
  return true;
}

bool SafetyMachine::reset() {
  event_count_ = 0;
  return leave_safe();
}

}  // namespace twinrate
