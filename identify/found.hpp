// Results of an identification.
#pragma once
#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "model/effects/shapes.hpp"
#include "model/frames.hpp"

namespace twinrate {

struct Found {
  double value = 0, sigma = 0;
  // A value with a larger sigma is not identified and does not belong in a drive file.
  bool is_known() const { return sigma < 0.1 * std::abs(value); }
};

// Voltage that the inverter loses: V sat(i/i_linear) in each phase. Dead time and device drop have
// this form; one bus voltage does not separate them. A resistance of the devices is part of R_s.
struct InverterLoss {
  Found V;
  double i_linear = 0;  // A
  CurrentShape shape = CurrentShape::kClamp;

  double of_phase(double i) const {
    return V.value == 0 ? 0 : V.value * current_sign(i / i_linear, shape);
  }
  Vec2 drop(const Vec2& i_alphabeta) const {
    const Vec3 i = inverse_clarke(i_alphabeta);
    return clarke(Vec3(of_phase(i[0]), of_phase(i[1]), of_phase(i[2])));
  }
};

// psi = L i f(|i|/I_s), f of the effect `saturation` (model/effects/saturation.cpp).
struct SaturationFound {
  int form = 0;  // rational, square, tanh
  double I_s = 0;
};
inline constexpr const char* kSaturationForms[] = {"rational", "square", "tanh"};

// One point of an inductance over its current.
struct InductancePoint {
  double i = 0;       // A
  Found L;            // H
  bool small = true;  // incremental, for small changes about i; else psi/i
};

// Fits L at zero current and, if the points fall by more than 2 % and three sigmas, a saturation.
struct InductanceFit {
  Found L;
  std::optional<SaturationFound> saturation;
  double misfit = 0;  // chi-square
};
InductanceFit fit_inductance(const std::vector<InductancePoint>& points);
// Both axes. A drive file has one form of saturation: if both axes saturate, both are fitted with
// the form of the smallest total misfit.
struct InductanceFits {
  InductanceFit d, q;
};
InductanceFits fit_inductances(const std::vector<InductancePoint>& d,
                               const std::vector<InductancePoint>& q);

// Lag of the current readings against the voltage.
struct Lateness {
  enum Form { kNone, kDelay, kFirstOrder } form = kNone;
  Found lag;  // s
};

struct Identified {
  int n_p = 0;
  bool mirrored = false;  // the encoder counts against the phase order
  double theta_zero = 0;  // rad, reading at which the d axis is phase a, of the first pole pair
  Vec3 i_offset = Vec3::Zero();
  Found R_s, L_d, L_q, psi_f, J, B, T_coulomb, T_constant;
  double phase_spread = 0;  // largest relative deviation of a phase's resistance from the mean
  bool R_s_drifts = false;  // while the direct currents are on
  Found fan;                // Nm s^2, torque over the square of the speed
  Lateness current;
  Found angle_lag;            // s, against the voltage; 0: not found
  double stale_share = 0;     // of the rows
  double flux_harmonics = 0;  // relative to psi_f, at six times the electrical angle; 0: not found
  double friction_share = 0;  // relative error of the friction that they can cause
  Found T_sin, T_cos;  // Nm, torque of one period a turn over the encoder angle, sign of T_load
  InverterLoss loss;
  std::vector<InductancePoint> L_d_points, L_q_points;
  std::optional<SaturationFound> saturation_d, saturation_q;
  double i_max = 0, omega_m_max = 0;  // reached
  double duration = 0;                // s, of all experiments
  std::vector<std::string> notes;     // parameters that were not identified, with the reason
};

}  // namespace twinrate
