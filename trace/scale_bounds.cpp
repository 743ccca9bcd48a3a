#include "trace/scale_bounds.hpp"

#include <algorithm>
#include <cmath>

namespace twinrate {
namespace {

constexpr double kMostPsi = kThisMachine.psi_f, kMostR = kThisMachine.R_s, kMostL = kThisMachine.L,
                 kLightest = kThisMachine.lightest, kHeaviest = kThisMachine.heaviest;

// True if the scale exceeds the bounds by more than its uncertainty and the error of the equation.
bool beyond(const ScaleRatio& r, double least, double most) {
  if (!r.known() || r.over_rest < 1) return false;
  if (r.value < 0) return -r.value > kScaleSigmas * r.sigma;
  const double reach = kScaleSigmas * r.log_sigma();
  return r.log() - reach > std::log(most) || r.log() + reach < std::log(least);
}

// The declared load against the motor's own torque, independent of the inertia.
ScaleRatio load_of_motor(const ScaleFactors& f) {
  if (!f.T_load.known() || !f.K_t_J.known() || f.K_t_J.value <= 0) return {};
  const double value = f.T_load.value / f.K_t_J.value;
  return {value, std::abs(value) * std::hypot(f.T_load.log_sigma(), f.K_t_J.log_sigma()),
          std::max(f.T_load.over_rest, f.K_t_J.over_rest)};
}

}  // namespace

Beyond beyond(const ScaleFactors& f) {
  constexpr double kThousandfold = 300, kBrake = 1.4;  // a brake's set value is closer than that
  const bool voltage = f.cell_share > kFrameFits && f.mean_interval_e < kSlowTurn;
  const bool torque = f.torque_share > kMoves;
  return {.R_s = voltage && beyond(f.R_s, 1 / kMostR, kMostR),
          .L = voltage && beyond(f.L, 1 / kMostL, kMostL),
          .psi_f = f.cell_share > kFrameFits && beyond(f.psi_f, 1 / kMostPsi, kMostPsi),
          .K_t_J = torque && beyond(f.K_t_J, 1 / kHeaviest, kLightest),
          .T_load = (torque && beyond(f.T_load, 1 / kThousandfold, kThousandfold)) ||
                    (f.torque_share > kFrameFits && beyond(load_of_motor(f), 1 / kBrake, kBrake))};
}

bool turned_by_half(const ScaleFactors& f) {
  return f.psi_f.known() && std::abs(f.zero_e) > kTwoPi / 3;
}

bool is_this_machine(const ScaleFactors& f, double K_t_J) {
  const auto near = [](const ScaleRatio& r, double most, double expected = 1) {
    return !r.known() || (r.value > 0 && std::abs(r.log() - std::log(expected)) < std::log(most));
  };
  return !turned_by_half(f) && near(f.psi_f, kMostPsi) && near(f.R_s, kMostR) &&
         near(f.L, kMostL) && near(f.K_t_J, kLightest, K_t_J);
}

bool magnet_in_place(const ScaleFactors& f) {
  const double reach = std::log(kMostPsi) + kScaleSigmas * f.psi_f.log_sigma();
  return f.psi_f.known() && std::abs(f.psi_f.log()) < reach && std::abs(f.zero_e) < kFarZero;
}

}  // namespace twinrate
