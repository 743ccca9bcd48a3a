// The steady gain of the full filter (n = 1), tabulated over speed: policy `scheduled`, and the
// fall-back of the fast loop when the background is silent.
//
// In rotor coordinates:
//
//   K(omega)  = lim background_step(T(-omega T_s) P T(omega T_s), steady state at omega)
//   K(-omega) = +-K(omega)                             element by element: even or odd
//
// K is linear between two rows. The table is computed from the filter when a program starts, never
// read from a file. At standstill the angle is not observable and P44 grows without bound, so the
// number of steps is limited (kIterations); K itself is finite there. If the filter provides its
// matrices (Filter::covariance_model), the steps are computed by doubling
// (kernels/riccati_doubling.hpp): 0.1 s for 20 states. Otherwise they are computed one after the
// other: 30 s.
#pragma once
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <vector>

#include "estimator/filter.hpp"

namespace twinrate {

// P after many steps at this speed, the rotor at 0. Empty if the filter has no covariance model or
// no steady state, and if P is not finite.
std::optional<CovarianceModel::Matrix> settled_covariance(const Filter& filter, double omega_m);

class GainSchedule {
 public:
  using GainMatrix = Eigen::Matrix<double, kMaxStates, kMaxOutputs>;

  // Rows from 0 to omega_m_max, closer together near standstill. Null if the filter has no steady
  // state, or if the table takes more than `most_steps` background steps one after the other.
  // Speeds beyond the table use its last row.
  static std::shared_ptr<const GainSchedule> build(
      const Filter& filter, double omega_m_max,
      std::int64_t most_steps = std::numeric_limits<std::int64_t>::max());

  // K for the rotor at this angle and speed.
  Gain at(double omega_m, double theta_e) const;
  GainMatrix rotor_gain(double omega_m) const;

 private:
  GainSchedule(const Filter& filter, double omega_m_max, std::int64_t& steps_left);
  double row_of(double omega_m) const;
  double speed_of(int row) const;

  int pairs_;
  double omega_m_max_;
  Gain shape_;  // n_x, n_y
  std::vector<GainMatrix> K_;
  GainMatrix sign_;  // -1 for an element that is odd in omega_m
};

}  // namespace twinrate
