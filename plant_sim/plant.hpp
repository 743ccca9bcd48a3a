// The simulated drive, one tick at a time: inverter, computation delay, machine, load, sensors.
//
//   sample(), truth()   MEASUREMENT(k) and TRUTH(k) at t_k
//   take_command(j)     COMMAND(j) has arrived; it acts from t_{j + delay_samples}
//   advance()           integrates t_k -> t_{k+1} under COMMAND(k - delay_samples)
//
// The averaged inverter applies the mean voltage over the interval. The switched one goes from edge
// to edge (plant_sim/switched_inverter.hpp); t_k is the start of a carrier period, in the middle of
// the zero vector, where the current has its mean.
//
// A reading is the truth plus the errors by effects, then noise, ADC and encoder steps. The
// modulator scales by the bus voltage measured at t_k. The voltage in MEASUREMENT is duty times
// that: it does not contain the losses on its way (dead time, drops, a bus voltage that changes
// inside the interval).
//
// Effects on the samples (late signals, lost rows, ..) act here: plant_sim/sample_errors.hpp.
//
// The drive protects itself like a real one (safety/state_machine.hpp): readings are checked before
// they are published, and each tick passes the state machine before its voltage is applied. Before
// the first command is due the voltage is zero. In state SAFE the phases are shorted (the zero
// voltage vector) or the gates are open:
//
//   gates open   the diodes carry the current until it is zero. Then no current flows as long as
//                the EMF between two phases, sqrt3 psi_f |omega_e|, is below the bus voltage;
//                above it the diodes rectify into the bus. The drive does not know the voltage at
//                its terminals then: MEASUREMENT has none.
//
// With safety.temperature_max_degC the temperature of the winding (plant_sim/winding.hpp) is watched;
// in state DERATE the plant itself reduces a voltage that would exceed the current limit.
//
// [plant.fault] makes a fault at a given time: of a sensor, of the bus, of the commands.
#pragma once
#include <array>
#include <deque>
#include <memory>

#include "core/config.hpp"
#include "core/steering.hpp"
#include "plant_sim/plant_parameters.hpp"
#include "plant_sim/safety_parameters.hpp"
#include "plant_sim/sample_errors.hpp"

namespace twinrate {

// True if the applied values of a command are finite. Another command is not used: the last one is
// held.
bool is_finite(const Command& command);

class Plant {
 public:
  // Reads its table of the drive file. Throws BadInput.
  explicit Plant(Config& config);

  // Before the first advance(): tick and angle are those of a drive that has run for long.
  void begin_at(std::int64_t k, double theta_m);

  const Measurement& sample() const { return sample_; }
  Truth truth() const;
  void take_command(const Command& command);
  // False if the due command is missing. Throws std::runtime_error if SUNDIALS fails.
  bool advance();
  // True if advance() would hold the last command because the due one has not arrived.
  bool command_is_missing() const;
  // True if another command of the same tick has already arrived.
  bool contradicts(const Command& command) const;
  // Off from the next advance() on, for every command.
  void emergency_stop() { emergency_stop_ = true; }
  // True if the drive file, not a request, made the last emergency stop.
  bool stop_was_planned() const { return stop_was_planned_; }
  void supervisor_is_silent() { supervisor_silent_ = true; }
  // SAFE -> IDLE in the advance() of tick `k`, or the next one. Returns "" or the reason why not:
  // the drive is not off, or the cause persists. A cause that returns before then keeps the drive
  // off.
  std::string reset(std::int64_t k = 0);
  // The load from now on; the torque moves to it with load.slew_Nm_s.
  void follow_load(const Profile& T_load_Nm) { config_.load.T_load_Nm = T_load_Nm; }
  bool tripped() const { return safety_.is_off(); }
  // With the events of the last advance(), of tick k() - 1.
  const SafetyMachine& safety() const { return safety_; }

  double winding_temperature() const { return winding_.temperature(); }  // degC

  std::int64_t k() const { return k_; }

 private:
  Plant(const Config& config, const PlantParameters& parameters, const SafetyParameters& safety);
  // Chooses the voltage of the interval that begins at t_k; false if the due command is missing.
  bool apply_due_command();
  // Puts the due command in force; if it is missing, the newest one before it that is at most
  // hold_ticks older and was not in force yet.
  Arrival take_due_command(std::int64_t due);
  bool has(std::int64_t k) const;
  bool was_not_finite(std::int64_t k) const;
  // `clamped`: the voltage in force is outside the hexagon.
  void protect(Arrival arrival, bool clamped);
  double sensed_temperature() const;
  // The voltage of the command in force, within the reduced current limit of DERATE.
  Vec2 voltage_in_force() const;
  void integrate();
  void integrate_open();
  // x and shaft over T; integrate()'s part from one moment of the interval on.
  void step(PlantState& x, ShaftState& shaft, const PlantInput& input, double T);
  void advance_part(const PlantInput& input, double from, double T);
  bool is_open() const { return safety_.is_off() && safety_.off() == Off::kOpen; }
  bool makes(MadeFault kind) const;
  void read_row(Measurement& m);
  void spoil_reading(Measurement& m);
  void take_row();
  void mark_faults(Measurement& m) const;
  void read_sensors();
  double sensed_angle();
  void sense_currents();

  DriveConfig config_;
  const double T_s_;
  PlantParameters parameters_;
  DriveModel model_;
  std::unique_ptr<Integrator> integrator_;
  std::optional<SwitchedInverter> switched_;  // none: the averaged inverter
  CurrentSensors current_sensors_;
  std::optional<SampleErrors> errors_;  // none: no effect spoils samples
  PlantState x_;
  ShaftState shaft_;  // of a drive that has one
  std::optional<LateState> late_currents_, late_angle_;
  RotorAxes rotor_axes_;  // of the last reading of the currents
  PlantInput input_;
  InverterOutput applied_;     // as the drive believes: duty times the v_dc measured before
  Contribution reading_;       // error of the readings by effects, at t_k
  double v_dc_ = 0;            // bus voltage at t_k
  Vec3 i_abc_ = Vec3::Zero();  // as the current sensors see them, before noise and ADC
  Vec3 acting_duty_;           // of the legs: that of applied_, unless it acts late
  // Readings at t_k and, for errors_, t_{k-1}; before the watch. Of a drive that looks back.
  Measurement row_, before_;
  bool keeps_rows_;
  Measurement sample_;  // MEASUREMENT(k)
  Command applied_command_;
  double frame_turns_ = 0;  // omega_e of the commands' frame, rad/s
  SafetyMachine safety_;
  CurrentLimit current_limit_;
  Winding winding_;
  SensorWatch watch_;
  bool watches_, needs_position_;
  int faults_ = 0;  // ReadingFault of sample_
  std::array<std::int64_t, 8> not_finite_k_{-1, -1, -1, -1, -1, -1, -1, -1};  // as commands_
  double bus_share_ = 1;  // of the nominal bus voltage
  void do_what_is_planned();
  std::deque<PlannedEmergency> planned_;
  bool emergency_stop_ = false, supervisor_silent_ = false, stop_was_planned_ = false;
  std::int64_t reset_k_ = -1;          // tick of a pending reset; -1: none
  std::array<Command, 8> commands_{};  // the latest, at index k modulo 8
  double theta_m_meas_ = 0, omega_m_meas_ = 0;
  double T_load_ = 0;
  std::int64_t k_ = 0;
};

}  // namespace twinrate
