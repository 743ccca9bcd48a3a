#include "identify/identify.hpp"

#include <fmt/format.h>

#include "identify/spin.hpp"
#include "identify/standstill.hpp"
#include "model/per_unit.hpp"

namespace twinrate {
namespace {

// Expected difference between a correct sheet and a correct measurement: sheets give typical values
// at 20 or 25 degC, inductances at one frequency, and the inertia of the rotor without its coupled
// parts.
constexpr double kWinding = 0.15, kInductance = 0.25, kFlux = 0.08, kInertia = 0.2;

struct Slip {
  double factor;  // found/sheet
  const char* name;
};
constexpr double kSqrt2 = std::numbers::sqrt2, kSqrt3 = std::numbers::sqrt3;
constexpr Slip kOfWinding[] = {{0.5, "1/2: the sheet gives it line to line"},
                               {2, "2: a phase value was halved"},
                               {1.5, "3/2: line to line of a delta winding"},
                               {1e-3, "1/1000: the prefix milli"},
                               {1e3, "1000: the prefix milli"}};
constexpr Slip kOfFlux[] = {{1 / kSqrt3, "1/sqrt(3): the sheet gives it line to line"},
                            {kSqrt3, "sqrt(3): taken for line to line, is of a phase"},
                            {kSqrt2, "sqrt(2): taken for peak, is rms"},
                            {1 / kSqrt2, "1/sqrt(2): taken for rms, is peak"},
                            {kSqrt2 / kSqrt3, "sqrt(2/3): line to line rms taken for phase peak"},
                            {kSqrt3 / kSqrt2, "sqrt(3/2): phase peak taken for line to line rms"},
                            {0.5, "1/2: poles and pole pairs"},
                            {2, "2: poles and pole pairs"},
                            {1.5, "3/2: the 3/2 of the torque"},
                            {2.0 / 3, "2/3: the 3/2 of the torque"},
                            {1e-3, "1/1000: V per krpm and V per rpm"}};
constexpr Slip kOfInertia[] = {{1e-7, "1e-7: g cm2 typed as kg m2"},
                               {1e-4, "1e-4: kg cm2 typed as kg m2"},
                               {1e-3, "1/1000: g m2 typed as kg m2"},
                               {1 / 9.81, "1/9.81: a weight, kgf cm s2 or N m2"}};

// A value with a large sigma is not compared, because it would agree with every sheet. Every slip
// whose factor is near is named: the ratio alone does not distinguish them.
template <std::size_t N>
std::string verdict(const Found& found, double sheet, double tolerance, const Slip (&slips)[N]) {
  constexpr double kNear = 0.035;
  if (!(found.value > 0)) return "not identified";
  if (!found.is_known()) return "not identified: sigma is above 10 %";
  if (!(sheet > 0)) return "";
  const double ratio = found.value / sheet;
  if (std::abs(std::log(ratio)) < std::log1p(tolerance) + 3 * found.sigma / found.value)
    return fmt::format("agrees ({:+.1f} %)", 100 * (ratio - 1));
  std::string names;
  for (const Slip& slip : slips)
    if (std::abs(std::log(ratio / slip.factor)) < kNear)
      names += (names.empty() ? "as by " : ", or by ") + std::string(slip.name);
  const std::string factor = fmt::format("differs by a factor {:.3g}", ratio);
  return names.empty() ? factor : factor + ", " + names;
}

// Faults of the readings that were found and taken into account.
void note_readings(Identified& found, double T_s) {
  if (found.stale_share > 0)
    found.notes.push_back(fmt::format(
        "stale readings: {:.2g} % of the rows repeat the currents of the row before; they are left "
        "out of the sines and replaced between their neighbours in the turning experiments",
        100 * found.stale_share));
  if (found.current.form != Lateness::kNone)
    found.notes.push_back(fmt::format(
        "currents: read {:.3g} us late against the voltage ({}, {:.2g} ticks), which the values "
        "take into account; the drive file does not have it",
        1e6 * found.current.lag.value,
        found.current.form == Lateness::kDelay ? "a delay" : "a first-order filter",
        found.current.lag.value / T_s));
  if (found.angle_lag.value != 0)
    found.notes.push_back(fmt::format(
        "angle: read {:.3g} us {} against the voltage ({:.2g} ticks), which the values take into "
        "account; the drive file does not have it",
        1e6 * std::abs(found.angle_lag.value), found.angle_lag.value > 0 ? "late" : "early",
        std::abs(found.angle_lag.value) / T_s));
  if (found.T_sin.value != 0)
    found.notes.push_back(fmt::format(
        "a torque once a turn, {:.3g} Nm: unbalance, or an encoder that is not centred; J and "
        "friction are without it",
        std::hypot(found.T_sin.value, found.T_cos.value)));
}

// Adds the remaining error of each fault that was found to the sigmas of the values it affects.
void widen(Identified& found) {
  constexpr double kFormOfLag = 3e-3;  // relative difference of L between a delay and a filter
  const auto add = [](Found& x, double share) { x.sigma = std::hypot(x.sigma, share * x.value); };
  if (found.current.form != Lateness::kNone)
    for (Found* L : {&found.L_d, &found.L_q}) add(*L, kFormOfLag);
  add(found.R_s, found.phase_spread);
  for (Found* L : {&found.L_d, &found.L_q}) add(*L, 2 * found.phase_spread);
  add(found.J, found.phase_spread);
}

// The sines at standstill give L_d to 1 % unless the readings contain another effect.
void note_late_signals(Identified& found) {
  constexpr double kFits = 0.01;
  if (found.L_d.sigma < kFits * found.L_d.value) return;
  found.notes.push_back(
      fmt::format("L_d, L_q: the sines fit a resistance and an inductance badly (sigma {:.2g} %): "
                  "with a late signal (plant.delay_samples, a filter) both are wrong",
                  100 * found.L_d.sigma / found.L_d.value));
}

}  // namespace

IdentifyLimits limits_of(const DriveConfig& d) {
  return {per_unit(d.machine, d.inverter.v_dc, d.T_s()).i, d.machine.omega_m_rated};
}

Identified identify(Rig& rig, const IdentifyLimits& limits, const IdentifyHooks& hooks) {
  Experiment e(rig, limits, hooks);
  Identified found;
  found.i_max = limits.i_max;
  identify_standstill(e, found);
  identify_spin(e, found);
  found.duration = e.seconds();
  // The fits do not show these two errors. With a gain 1 + g of the current sensors, R_s and L are
  // the true values over 1 + g, J and friction are 1 + g times theirs. With a gain of the voltage
  // all are 1 + g times their values.
  found.notes.push_back(
      "a common gain of the current sensors: readings 1 % too large make R_s, L_d and L_q 1 % too "
      "small, J and friction 1 % too large");
  found.notes.push_back(
      "a gain of the voltage: 1 % less than asked for makes R_s, L_d, L_q, psi_f, J and friction "
      "1 % too large");
  found.notes.push_back("differences between the phases: L_d is that along phase a");
  note_readings(found, e.T_s());
  note_late_signals(found);
  widen(found);
  if (found.loss.V.value != 0)
    found.notes.push_back(
        "dead time and device drop: one bus voltage does not separate them; the file has them as "
        "one inverter_drop");
  found.notes.push_back("resistance of the devices and cables: it is part of R_s");
  found.notes.push_back(
      "iron loss: its torque is part of the friction (twinrate trace finds it in a log)");
  found.notes.push_back("cogging, flux harmonics: twinrate trace finds them in a log");
  for (const std::string& note : rig.notes()) found.notes.push_back(note);
  return found;
}

std::vector<SheetRow> compare(const Identified& f, const MachineParameters& m) {
  std::vector<SheetRow> rows = {
      {"R_s", "Ohm", f.R_s, m.R_s, verdict(f.R_s, m.R_s, kWinding, kOfWinding)},
      {"L_d", "H", f.L_d, m.L_d, verdict(f.L_d, m.L_d, kInductance, kOfWinding)},
      {"L_q", "H", f.L_q, m.L_q, verdict(f.L_q, m.L_q, kInductance, kOfWinding)},
      {"psi_f", "Wb", f.psi_f, m.psi_f, verdict(f.psi_f, m.psi_f, kFlux, kOfFlux)},
      {"J", "kgm2", f.J, m.J, verdict(f.J, m.J, kInertia, kOfInertia)},
      {"B", "Nms", f.B, m.B, ""}};
  const std::string pairs = f.n_p == m.n_p       ? "agrees"
                            : f.n_p * 2 == m.n_p ? "differs by 1/2: poles and pole pairs"
                            : f.n_p == m.n_p * 2 ? "differs by 2: poles and pole pairs"
                                                 : "differs";
  rows.insert(rows.begin(),
              {"n_p", "", {static_cast<double>(f.n_p), 0}, static_cast<double>(m.n_p), pairs});
  return rows;
}

}  // namespace twinrate
