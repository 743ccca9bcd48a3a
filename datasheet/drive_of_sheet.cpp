#include "datasheet/drive_of_sheet.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "loop/bandwidths.hpp"
#include "loop/load_drive.hpp"
#include "loop/runnable.hpp"
#include "loop/trial_run.hpp"
#include "model/frames.hpp"
#include "model/per_unit.hpp"

namespace twinrate {
namespace {

// Control rates of lab inverters. The lowest rate with this many samples an electrical turn at the
// rated speed and ticks in the time constant L/R_s is used, else the last one.
constexpr double kRates_Hz[] = {10e3, 20e3, 40e3};
constexpr double kSamplesATurn = 20, kTicksATimeConstant = 2;
// First run, relative to: the rated speed, the speed whose EMF is u_max, the rated torque (load,
// acceleration).
constexpr double kSpeedShare = 0.5, kVoltageShare = 0.7, kLoadShare = 0.3, kAccelerationShare = 0.3;
// Noise of a phase-current sample, rms, relative to the rated current: the presets have 0.1 to
// 1.6 %.
constexpr double kNoiseShare = 0.005;
// A wrong inertia can make start and ramp longer; this limit keeps the run within the range of a
// drive file.
constexpr double kLongestRamp_s = 1000, kShortestStart_s = 1;
constexpr double kSettle_s = 0.5, kLoaded_s = 0.5, kLoadRise_s = 0.2;

double control_rate(const MachineParameters& m) {
  const double f_e = m.n_p * m.omega_m_rated / kTwoPi;
  for (const double f_s : kRates_Hz)
    if (f_s >= kSamplesATurn * f_e && f_s >= kTicksATimeConstant * m.R_s / std::min(m.L_d, m.L_q))
      return f_s;
  return *std::rbegin(kRates_Hz);
}

struct FirstRun {
  double omega_e, slew, T_load, ramp_s;
};
FirstRun first_run(const MachineOfSheet& s) {
  const MachineParameters& m = s.machine;
  const double u_max = s.v_dc / std::sqrt(3.0);
  FirstRun run{};
  run.omega_e = std::min(kSpeedShare * m.n_p * m.omega_m_rated, kVoltageShare * u_max / m.psi_f);
  run.slew = kAccelerationShare * m.n_p * m.T_rated / m.J;
  run.T_load = kLoadShare * m.T_rated;
  run.ramp_s = std::min(run.omega_e / run.slew, kLongestRamp_s);
  return run;
}

std::vector<std::string> derived(const MachineOfSheet& s, double f_s) {
  const MachineParameters& m = s.machine;
  const double k_t = m.torque_constant(), u_max = s.v_dc / std::sqrt(3.0);
  const double L = std::min(m.L_d, m.L_q);
  return {
      fmt::format("K_t                       {:.4g} Nm per ampere of i_q, peak", k_t),
      fmt::format("speed without load        {:.4g} rpm at {:g} V",
                  u_max / m.psi_f / m.n_p / kRadPerRpm, s.v_dc),
      fmt::format("electrical frequency      {:.4g} Hz at the rated speed",
                  m.n_p * m.omega_m_rated / kTwoPi),
      fmt::format("electrical time constant  {:.3g} ms (L/R_s)", 1e3 * L / m.R_s),
      fmt::format("mechanical time constant  {:.3g} ms (J R_s/(3/2 n_p^2 psi_f^2))",
                  1e3 * m.J * m.R_s / (1.5 * std::pow(m.n_p * m.psi_f, 2))),
      fmt::format("run-up                    {:.3g} s to the rated speed at rated torque",
                  m.J * m.omega_m_rated / m.T_rated),
      fmt::format("control rate              {:g} kHz: {:.3g} samples an electrical turn, {:.3g} "
                  "ticks in L/R_s",
                  1e-3 * f_s, f_s / (m.n_p * m.omega_m_rated / kTwoPi), L / m.R_s * f_s)};
}

std::string comments(const MachineOfSheet& s) {
  std::string text = fmt::format("#:schema {}/drive.schema.json\n", preset_directory()) +
                     "# Written by twinrate machine new.\n";
  for (const std::string& line : s.conversions) text += "#   " + line + "\n";
  for (const std::string& line : s.assumed) text += "#   assumed: " + line + "\n";
  for (const std::string& line : s.doubts) text += "#   doubtful: " + line + "\n";
  return text;
}

std::string machine_table(const MachineParameters& m) {
  std::string text = fmt::format(
      "\n[machine]\nR_s_Ohm = {:.6g}\nL_d_H = {:.6g}\nL_q_H = {:.6g}\npsi_f_Wb = {:.6g}\nn_p = {}\n"
      "J_kgm2 = {:.6g}\nB_Nms = {:.6g}\n",
      m.R_s, m.L_d, m.L_q, m.psi_f, m.n_p, m.J, m.B);
  if (m.n_slots > 0) text += fmt::format("n_slots = {}\n", m.n_slots);
  return text +
         fmt::format("i_rated_A = {:.6g}\nT_rated_Nm = {:.6g}\nomega_m_rated_rad_s = {:.6g}\n",
                     m.i_rated, m.T_rated, m.omega_m_rated);
}

// With an encoder the controller uses its angle; without one the drive starts with an alignment.
// `bandwidths`: those of foc; empty: those of scaled_tuning. `start_s`: until the hand-over to the
// estimate, after which the speed follows the ramp.
std::string toml_of(const std::string& name, const MachineOfSheet& s, double f_s,
                    const std::string& bandwidths, double start_s) {
  const FirstRun run = first_run(s);
  const bool sensed = s.encoder_counts > 0;
  const double begin = start_s + run.ramp_s + kSettle_s;
  std::string text = comments(s) + fmt::format("name = \"{}\"\nstart = \"{}\"\n", name,
                                               sensed ? "aligned" : "align_if");
  text += machine_table(s.machine) + fmt::format("\n[inverter]\nv_dc_V = {:.6g}\n", s.v_dc);
  text += fmt::format("\n[sensors]\ni_noise_rms_A = {:.3g}\n", kNoiseShare * s.machine.i_rated);
  if (sensed) text += fmt::format("encoder_counts = {}\n", s.encoder_counts);
  text += fmt::format("\n[rates]\nf_s_Hz = {:.1f}\nn = 1\n", f_s);
  text += fmt::format("\n[estimator]\nkind = \"{}\"\nprediction = \"exact\"\n",
                      sensed ? "ekf_disturbance" : "dq_ekf");
  text += fmt::format("\n[controller]\nkind = \"foc\"\nangle_source = \"{}\"\n",
                      sensed ? "measured" : "estimate");
  text += bandwidths;
  text += fmt::format("\n[reference]\nspeed_rpm = {:.4g}\nslew_rad_s2 = {:.4g}\n",
                      run.omega_e / s.machine.n_p / kRadPerRpm, run.slew);
  text += fmt::format("\n[load]\nT_load_Nm = [[0.0, 0.0], [{:.4g}, {:.4g}]]\nslew_Nm_s = {:.4g}\n",
                      begin, run.T_load, run.T_load / kLoadRise_s);
  return text + fmt::format("\n[run]\nduration_s = {:.4g}\nsettle_s = {:.4g}\nseed = 1\n",
                            begin + kLoaded_s, begin - kSettle_s / 2);
}

Config config_of(const std::string& toml, const std::string& name) {
  Config config = Config::parse(toml, name + ".toml");
  read_all_tables(config);
  return config;
}

}  // namespace

DriveOfSheet drive_of_sheet(const std::string& name, const Sheet& sheet) {
  MachineOfSheet s = machine_of_sheet(sheet);
  s.assumed.push_back(fmt::format(
      "i_noise_rms_A = {:.3g}: {:g} % of the rated current; no ADC step, dead time or device drop",
      kNoiseShare * s.machine.i_rated, 100 * kNoiseShare));
  const double f_s = control_rate(s.machine);
  Config draft = config_of(toml_of(name, s, f_s, "", 0), name);
  const Bandwidths b = suggest_bandwidths(draft);
  const double start_s =
      s.encoder_counts > 0 ? 0 : std::clamp(start_takes_s(draft), kShortestStart_s, kLongestRamp_s);
  const std::string loops = fmt::format(
      "\n[controller.foc]\ncurrent_bandwidth_Hz = {:.4g}\nspeed_bandwidth_Hz = {:.4g}\n",
      b.current_Hz, b.speed_Hz);
  DriveOfSheet drive{.toml = toml_of(name, s, f_s, loops, start_s),
                     .conversions = s.conversions,
                     .assumed = s.assumed,
                     .doubts = s.doubts,
                     .derived = derived(s, f_s),
                     .warnings = {}};
  drive.derived.push_back(fmt::format(
      "bandwidths                current {:.4g} Hz, speed {:.4g} Hz", b.current_Hz, b.speed_Hz));
  if (s.encoder_counts == 0)
    drive.derived.push_back(
        fmt::format("start                     {:.3g} s: alignment and ramp until the hand-over",
                    start_takes_s(draft)));
  Config config = config_of(drive.toml, name);
  drive.warnings = check_by_trial(config, Trial::kAlways);
  return drive;
}

}  // namespace twinrate
