// The simulated drive, one tick at a time: inverter, computation delay, machine, load, sensors.
//
//   sample()        MEASUREMENT(k) and TRUTH(k) at t_k
//   advance(cmd k)  integrates t_k -> t_{k+1} under the command that is due (delay_samples old)
#pragma once
#include <array>
#include <memory>

#include "core/drive_config.hpp"
#include "plant_sim/integrator.hpp"

namespace twinrate {

class Plant {
 public:
  explicit Plant(const DriveConfig& config);

  Measurement sample() const;
  Truth truth() const;
  // Throws std::runtime_error where SUNDIALS fails.
  void advance(const Command& command);
  // As advance() with the voltage of the last interval held (realtime: the command is late).
  void advance_holding();
  // Zero voltage from now on, whatever is commanded (safe state).
  void trip() { tripped_ = true; }

  std::int64_t k() const { return k_; }

 private:
  void integrate();

  DriveConfig config_;
  DriveModel model_;
  std::unique_ptr<Integrator> integrator_;
  PlantState x_;
  PlantInput input_;
  InverterOutput applied_;
  Command applied_command_;
  std::array<Command, 5> pending_{};  // commands on their way, newest last
  double theta_m_meas_ = 0, omega_m_meas_ = 0;
  double T_load_ = 0;
  std::int64_t k_ = 0;
  bool tripped_ = false;
};

}  // namespace twinrate
