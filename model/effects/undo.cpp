#include "model/effects/undo.hpp"

#include "model/point_of.hpp"

namespace twinrate {

namespace {
constexpr int kRounds = 3;
}

SensingUndo::SensingUndo(const Effects& effects, int n_p, int current_sensors, double T_s)
    : on_currents_(acting_on(effects, kOnCurrents)),
      on_angle_(acting_on(effects, kOnAngle)),
      n_p_(n_p),
      current_sensors_(current_sensors),
      T_s_(T_s) {
  SamplingFacts late;
  for (const auto& effect : effects) effect->describe_sampling(late);
  current_lag_ = late.delay[SamplingFacts::kCurrent] + late.lowpass[SamplingFacts::kCurrent];
  angle_lag_ = late.delay[SamplingFacts::kAngle] + late.lowpass[SamplingFacts::kAngle];
}

double SensingUndo::angle_error(double theta_m, OperatingPoint& point) const {
  point.theta_m = theta_m;
  point.theta_e = n_p_ * theta_m;
  return sum_at(on_angle_, point).theta_m;
}

double SensingUndo::true_angle(double theta_m_meas, OperatingPoint& point) const {
  double theta_m = theta_m_meas;
  for (int round = 0; round < kRounds; ++round)
    theta_m = theta_m_meas - angle_error(theta_m, point);
  return theta_m;
}

Measurement SensingUndo::operator()(const Measurement& m, double omega_m) const {
  Measurement corrected = m;
  OperatingPoint point =
      point_of(1e-9 * static_cast<double>(m.t_ns), {.omega_m = m.omega_m});  // the angle follows
  point.v_dc = m.v_dc;
  if (m.signals & kPosition && !on_angle_.empty()) {
    corrected.theta_m = true_angle(m.theta_m, point);
    if (m.signals & kSpeed) {
      const double theta_m_before = true_angle(m.theta_m - T_s_ * m.omega_m, point);
      corrected.omega_m = (corrected.theta_m - theta_m_before) / T_s_;
    }
    corrected.theta_m += angle_lag_ * omega_m;
  }
  if (!(m.signals & kPhaseCurrents) || on_currents_.empty()) return corrected;
  const RotorFrame frame = frame_at(corrected.theta_m, corrected.omega_m, n_p_);
  for (int round = 0; round < kRounds; ++round) {
    corrected.i_abc = m.i_abc - sum_at(on_currents_, point_of(corrected, frame)).i_abc;
    if (current_sensors_ == 2) corrected.i_abc[2] = -(corrected.i_abc[0] + corrected.i_abc[1]);
  }
  if (current_lag_ > 0)
    corrected.i_abc =
        inverse_clarke(rotate(clarke(corrected.i_abc), n_p_ * omega_m * current_lag_));
  return corrected;
}

}  // namespace twinrate
