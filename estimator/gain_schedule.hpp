// The steady gain of the full filter (n = 1), tabulated over speed: policy `scheduled`, and what
// the fast loop falls back to when the background falls silent.
//
//   in rotor coordinates:  K(omega) = lim background_step(T(-omega T_s) P, steady state at omega)
//   between two rows K is linear; an element is even or odd in omega, whichever the filter shows
//
// The table is computed from the filter by itself when a program starts, and never from a file.
// At standstill the angle cannot be observed and P44 grows without bound, so the iteration has an
// end (kIterations); K itself is finite there.
#pragma once
#include <memory>
#include <vector>

#include "estimator/filter.hpp"

namespace twinrate {

class GainSchedule {
 public:
  using GainMatrix = Eigen::Matrix<double, kMaxStates, kMaxOutputs>;

  // Rows from 0 to omega_m_max, closer together near standstill. Null where the filter has no
  // steady state. Speeds beyond the table use its last row.
  static std::shared_ptr<const GainSchedule> build(const Filter& filter, double omega_m_max);

  // K for the rotor at this angle and speed.
  Gain at(double omega_m, double theta_e) const;
  GainMatrix rotor_gain(double omega_m) const;

 private:
  GainSchedule(const Filter& filter, double omega_m_max);
  double row_of(double omega_m) const;
  double speed_of(int row) const;

  int pairs_;
  double omega_m_max_;
  Gain shape_;  // n_x, n_y
  std::vector<GainMatrix> K_;
  GainMatrix sign_;  // -1 where the element is odd in omega_m
};

}  // namespace twinrate
