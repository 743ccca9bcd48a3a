#include "loop/slips.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "controller/current_reference.hpp"
#include "model/math.hpp"

namespace twinrate {
namespace {

// Rated torque over K_t i_rated of right data sheets: 0.85 to 1.01 over the sheets in
// tests/datasheet/sheets.hpp. Iron loss, friction and saturation take up to a fifth; K_t has a
// tolerance of 10 %, which is all that can make the ratio larger than 1. A ratio is warned of beyond
// another 5 % on either side.
constexpr RatioBand kTorqueBand{0.8, 1.1};
constexpr double kBeyondBand = 1.05;
// sqrt(2), 1.5 and sqrt(3) are nearer to one another than the ratios of right sheets.
constexpr std::size_t kMostNames = 3;
// A drive may weaken its field; its rated speed stays near the voltage limit.
constexpr double kEmfTolerance = 1.15;
// Rotors run up in milliseconds to seconds, with a heavy load in some ten seconds.
constexpr double kLongestRunUp_s = 100;
// L/R_s of motors is 0.1 to 100 ms.
constexpr double kLongestTimeConstant_s = 0.5;
// A current loop with 1.5 T_s of dead time keeps 30 deg of phase margin up to f_s/9:
// 90 deg - 360 deg 1.5 f/f_s = 30 deg.
constexpr double kSamplesABandwidth = 9;
// The speed loop sees the current loop as a lag: 27 deg at half its bandwidth.
constexpr double kSpeedOverCurrent = 0.5;

struct Factor {
  double value;
  const char* name;
};
constexpr Factor kFactors[] = {
    {std::numbers::sqrt3, "sqrt(3), line to line or phase?"},
    {std::numbers::sqrt2, "sqrt(2), rms or peak?"},
    {2, "2, poles or pole pairs?"},
    {1.5, "1.5, the 3/2 of the torque?"},
    {1.5 * std::numbers::sqrt2, "1.5 sqrt(2), the 3/2 of the torque and rms or peak?"},
    {std::numbers::sqrt3 * std::numbers::sqrt2, "sqrt(6), line to line rms or phase peak?"},
    {2 * std::numbers::sqrt3, "2 sqrt(3), line to line or phase, and poles or pole pairs?"},
    {60 / (2 * std::numbers::pi), "60/(2 pi), rpm or rad/s?"},
    {1 / 0.11298483, "8.85, Nm or lb in?"},
    {1 / 7.0615518e-3, "141.6, Nm or oz in?"},
    {1000, "1000, the prefix milli?"}};

void of_torque(const DriveConfig& d, std::vector<Slip>& slips) {
  const MachineParameters& m = d.machine;
  if (m.T_rated <= 0 || m.i_rated <= 0) return;
  const double torque = largest_torque(m, m.i_rated);
  const double ratio = m.T_rated / torque;
  if (ratio < kTorqueBand.most * kBeyondBand && ratio > kTorqueBand.least / kBeyondBand) return;
  slips.push_back(
      {"machine.T_rated_Nm", fmt::format("{:.4g} Nm, but i_rated_A gives {:.4g} Nm: {}", m.T_rated,
                                         torque, factor_text(ratio, kTorqueBand))});
}

void of_emf(const DriveConfig& d, std::vector<Slip>& slips) {
  const MachineParameters& m = d.machine;
  const double emf = m.psi_f * m.n_p * m.omega_m_rated, u_max = d.inverter.u_max_linear();
  if (emf <= kEmfTolerance * u_max) return;
  slips.push_back(
      {"machine.psi_f_Wb",
       fmt::format("the EMF at the rated speed is {:.4g} V, v_dc allows {:.4g} V; line to "
                   "line or phase, rms or peak, poles or pole pairs?",
                   emf, u_max)});
}

void of_inertia(const DriveConfig& d, std::vector<Slip>& slips) {
  const MachineParameters& m = d.machine;
  if (m.T_rated <= 0 || m.omega_m_rated <= 0) return;
  const double run_up = m.J * m.omega_m_rated / m.T_rated;
  if (run_up <= kLongestRunUp_s) return;
  const char* unit = run_up * 1e-4 > 1 ? "g cm2 (1e-7 kg m2)?" : "kg cm2 (1e-4 kg m2)?";
  slips.push_back(
      {"machine.J_kgm2",
       fmt::format("{:.4g} kg m2: the rated torque needs {:.3g} s to the rated speed; {}", m.J,
                   run_up, unit)});
}

void of_inductance(const DriveConfig& d, std::vector<Slip>& slips) {
  const MachineParameters& m = d.machine;
  const double L = std::max(m.L_d, m.L_q);
  if (L <= kLongestTimeConstant_s * m.R_s) return;
  slips.push_back({L == m.L_d ? "machine.L_d_H" : "machine.L_q_H",
                   fmt::format("{:.4g} H: L/R_s is {:.3g} s; mH (1e-3 H)?", L, L / m.R_s)});
}

}  // namespace

std::string factor_text(double ratio, const RatioBand& without_slip) {
  const double size = std::max(ratio, 1 / ratio);
  std::vector<std::pair<double, const char*>> named;  // remaining ratio, its size
  for (const Factor& factor : kFactors) {
    const double left = ratio > 1 ? ratio / factor.value : ratio * factor.value;
    if (left > without_slip.least && left < without_slip.most)
      named.emplace_back(std::abs(math::log(left)), factor.name);
  }
  std::sort(named.begin(), named.end());
  std::string text = fmt::format("off by a factor {:.3g}", size);
  for (std::size_t i = 0; i < std::min(named.size(), kMostNames); ++i)
    text += (i == 0 ? ": " : " or ") + std::string(named[i].second);
  return text;
}

double largest_torque(const MachineParameters& m, double i) {
  const Vec2 i_dq = mtpa(m, i);
  return m.torque(i_dq[0], i_dq[1]);
}

std::vector<Slip> slips_of(const DriveConfig& d, std::optional<double> current_Hz,
                           std::optional<double> speed_Hz) {
  std::vector<Slip> slips;
  of_torque(d, slips);
  of_emf(d, slips);
  of_inertia(d, slips);
  of_inductance(d, slips);
  const double most = d.rates.f_s_Hz / kSamplesABandwidth;
  const std::string table = "controller." + d.controller.kind + ".";
  if (current_Hz && *current_Hz > most)
    slips.push_back({table + "current_bandwidth_Hz",
                     fmt::format("{:.4g} Hz: f_s allows {:.4g} Hz (30 deg of phase margin)",
                                 *current_Hz, most)});
  if (current_Hz && speed_Hz && *speed_Hz > kSpeedOverCurrent * *current_Hz)
    slips.push_back(
        {table + "speed_bandwidth_Hz", fmt::format("{:.4g} Hz: the current loop allows {:.4g} Hz",
                                                   *speed_Hz, kSpeedOverCurrent * *current_Hz)});
  return slips;
}

}  // namespace twinrate
