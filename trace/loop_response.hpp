// Response of a drive to the noise of its own sensors.
//
// The controller takes noise for current, angle and speed, and drives the motor against it. Below
// its bandwidth the measured current is therefore quiet and the true current is not. The inner
// products of the tracer need the effect of noise on a record (Chain, trace/chain.hpp). In rotor
// axes
//   delta u[k]   = sum_j a_j delta u[k-j] + sum_j G_j x[k-j] + sum_j h_j y[k-j]    the controller
//   L delta i'   = delta u - R_s delta i + cross terms - (0, n_p psi_f delta omega_m)
//   J delta omega_m' = 1.5 n_p psi_f delta i_q
// with x = n_i + delta i and y = n_theta + delta theta_m, the noise that the record holds. The
// controller's coefficients are fitted to second differences from row to row, in which noise
// prevails.
#pragma once
#include <Eigen/Core>
#include <array>

#include "model/machine.hpp"
#include "trace/record.hpp"

namespace twinrate {

// White noise of the sensors, one for each row of a record.
struct SensorNoise {
  std::vector<Vec2> i_alphabeta;  // A
  std::vector<double> theta_m;    // rad

  void add(Record& record) const;
};

class LoopResponse {
 public:
  // No response (an open loop) if the record has too few rows with voltages.
  LoopResponse(const Record& record, const MachineParameters& machine);

  // Adds noise to a record with the drive's response to it. If the identified loop is unstable,
  // adds the noise alone.
  void add(const SensorNoise& noise, Record& record) const;

 private:
  static constexpr int kOrder = 6;
  static constexpr int kInputs = kOrder + 3 * (kOrder + 1);
  using Inputs = Eigen::Matrix<double, kInputs, 1>;
  // Inputs of row k: u of the axis at the rows before; both currents and the angle up to row k.
  static Inputs inputs(std::size_t k, int axis, const std::vector<Vec2>& u,
                       const std::vector<Vec2>& x, const std::vector<double>& y);

  MachineParameters machine_;
  std::array<Inputs, 2> controller_{Inputs::Zero(), Inputs::Zero()};  // of the axes d and q
};

}  // namespace twinrate
