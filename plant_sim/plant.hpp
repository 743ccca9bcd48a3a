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
// Before the first command is due the voltage is zero. A command that is not there when it is due
// leaves the last voltage on; after plant.hold_ticks intervals of that the drive trips: zero
// voltage from then on.
#pragma once
#include <array>
#include <memory>

#include "core/config.hpp"
#include "plant_sim/plant_parameters.hpp"
#include "plant_sim/sample_errors.hpp"

namespace twinrate {

// Whether what the drive applies of a command is finite. Another command is not taken: the last one
// is held.
bool is_finite(const Command& command);

class Plant {
 public:
  // Reads its table of the drive file. Throws BadInput.
  explicit Plant(Config& config);

  Measurement sample() const;
  Truth truth() const;
  void take_command(const Command& command);
  // False where the command that was due is missing. Throws std::runtime_error where SUNDIALS
  // fails.
  bool advance();
  // Zero voltage from now on, for every command (safe state).
  void trip() { tripped_ = true; }
  bool tripped() const { return tripped_; }

  std::int64_t k() const { return k_; }

 private:
  Plant(const DriveConfig& drive, const PlantParameters& parameters);
  // Chooses the voltage of the interval that begins at t_k; false where the command due is missing.
  bool apply_due_command();
  void integrate();
  // x and shaft over T; integrate()'s part from one moment of the interval on.
  void step(PlantState& x, ShaftState& shaft, const PlantInput& input, double T);
  void advance_part(const PlantInput& input, double from, double T);
  void read_sensors();
  double sensed_angle();
  void sense_currents();

  DriveConfig config_;
  PlantParameters parameters_;
  DriveModel model_;
  std::unique_ptr<Integrator> integrator_;
  std::optional<SwitchedInverter> switched_;  // none: the averaged inverter
  std::optional<SampleErrors> errors_;        // none: no effect spoils samples
  PlantState x_;
  ShaftState shaft_;  // of a drive that has one
  std::optional<LateState> late_currents_, late_angle_;
  PlantInput input_;
  InverterOutput applied_;     // as the drive believes: duty times the v_dc measured before
  Contribution reading_;       // error of the readings by effects, at t_k
  double v_dc_ = 0;            // bus voltage at t_k
  Vec3 i_abc_ = Vec3::Zero();  // as the current sensors see them, before noise and ADC
  Vec3 acting_duty_;           // of the legs: that of applied_, unless it acts late
  Measurement before_;         // MEASUREMENT(k-1), where rows may repeat it
  Command applied_command_;
  int held_ticks_ = 0;
  std::array<Command, 8> commands_{};  // the latest, at index k modulo 8
  double theta_m_meas_ = 0, omega_m_meas_ = 0;
  double T_load_ = 0;
  std::int64_t k_ = 0;
  bool tripped_ = false;
};

}  // namespace twinrate
