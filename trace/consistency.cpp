#include "trace/consistency.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "trace/readings.hpp"
#include "trace/scale_bounds.hpp"
#include "trace/units.hpp"
#include "trace/voltage_meaning.hpp"

namespace twinrate {
namespace {

constexpr const char* kAnotherMachine = "another machine, or a scale of the signals?";

Inconsistency of_ratio(const char* quantity, const char* unit, double declared,
                       const ScaleRatio& r) {
  return {quantity, fmt::format("{:.3g} {}", declared, unit),
          fmt::format("{:.3g} +- {:.2g} {}", r.value * declared, r.sigma * declared, unit),
          kAnotherMachine};
}

// The unit that fits all scales; without one, the scales beyond their bounds.
std::vector<Inconsistency> of_scales(const Record& record, const ScaleFactors& f, const Beyond& out,
                                     const DriveFacts& facts, int encoder_counts) {
  if (out.of_machine())  // no unit moves the load alone
    if (auto unit = fitting_unit(record, f, facts, encoder_counts)) return {*unit};
  const MachineParameters& m = facts.machine;
  std::vector<Inconsistency> found;
  if (out.psi_f) found.push_back(of_ratio("psi_f", "Wb", m.psi_f, f.psi_f));
  if (out.R_s) found.push_back(of_ratio("R_s", "Ohm", m.R_s, f.R_s));
  if (out.L) found.push_back(of_ratio("L_q", "H", m.L_q, f.L));
  if (out.K_t_J)
    found.push_back(of_ratio("K_t/J", "rad/s^2 A", m.torque_constant() / m.J, f.K_t_J));
  // Both scales depend on J: the wrong one is the one further from 1.
  const bool of_motor =
      f.T_load.value > 0 && f.K_t_J.known() && std::abs(f.K_t_J.log()) > std::abs(f.T_load.log());
  if (out.T_load && of_motor)
    found.push_back({"i", "a torque K_t i_q that carries T_load",
                     fmt::format("the motion shows {:.3g} times that", f.K_t_J.value),
                     "rms instead of peak values, a scale of the currents, or K_t?"});
  else if (out.T_load)
    found.push_back(
        {"T_load", "in Nm, positive against positive speed",
         fmt::format("the motion shows {:.3g} times that, with the declared J", f.T_load.value),
         f.T_load.value < 0 ? "its sign?" : "its unit or scale?"});
  return found;
}

// True if no R_s, L and psi_f of any size explain the voltage by current and angle, although the
// rotor turns fast enough for an EMF.
std::vector<Inconsistency> of_frame(const ScaleFactors& f) {
  constexpr double kEmf = 0.3;
  if (magnet_in_place(f)) return {};
  if (f.emf_share < kEmf || f.cell_share + f.rounded_share > kFrameFails ||
      f.mean_interval_e > kSlowTurn)
    return {};
  return {{"theta_m", "the angle that voltage and current turn with",
           fmt::format("{:.0f} % of the voltage follow from current and angle, with any R_s, L and "
                       "psi_f",
                       100 * std::max(0.0, f.cell_share)),
           "the angle of another shaft, another n_p, or another order or sign of the phases?"}};
}

// A drive with that zero would lose a third of its torque. If it runs well, the log has another
// zero.
std::vector<Inconsistency> of_zero(const ScaleFactors& f) {
  if (f.cell_share < kFrameFits || f.mean_interval_e > kSlowTurn || !f.psi_f.known()) return {};
  if (std::abs(f.zero_e) < kFarZero) return {};
  // Another order of the phases turns the zero by a third of a turn, another sign by half a turn.
  constexpr double kOfPhases = 100 * kDegree;
  return {{"theta_m", "zero where the magnet is on phase a",
           fmt::format("the magnet at {:.0f} degrees electrical there", f.zero_e / kDegree),
           std::abs(f.zero_e) < kOfPhases
               ? "another zero of the angle?"
               : "another zero of the angle, or another order or sign of the phases?"}};
}

double quantile(std::vector<double> x, double share) {
  if (x.empty()) return 0;
  const auto at =
      x.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(x.size() - 1));
  std::nth_element(x.begin(), at, x.end());
  return *at;
}

constexpr double kNearly = 0.999;  // quantile in place of the largest value: an outlier is no unit

std::vector<double> sizes(const std::vector<Vec2>& x) {
  std::vector<double> out;
  out.reserve(x.size());
  for (const Vec2& v : x) out.push_back(v.norm());
  return out;
}

// Checks without an equation: the bus, the speed against the angle.
std::vector<Inconsistency> of_ranges(const Record& record, const Health& health,
                                     const DriveFacts& facts) {
  constexpr double kOutOfReach = 1.15;
  std::vector<Inconsistency> found;
  const double bus = quantile(record.v_dc, 0.5), u = quantile(sizes(record.u_alphabeta), kNearly);
  if (!record.v_dc.empty() && bus < 0)
    found.push_back({"v_dc", "above 0 V", fmt::format("{:.4g} V", bus), "its sign?"});
  if (facts.v_dc > 0 && bus > 100 * facts.v_dc)
    found.push_back({"v_dc", fmt::format("about {:.3g} V", facts.v_dc), fmt::format("{:.4g}", bus),
                     "millivolts?"});
  if (bus > 0 && u > kOutOfReach * 2 / 3 * bus)
    found.push_back({"u", fmt::format("up to 2/3 v_dc = {:.3g} V", 2.0 / 3 * bus),
                     fmt::format("{:.3g} V", u),
                     u > 2 * bus ? "unit of the voltage?" : "line-to-line?"});
  constexpr double kNoDrive_s = 0.15;  // needs no equation
  if (record.T_s > kNoDrive_s)
    found.push_back({"t", fmt::format("rows of at most {:.3g} s", kSlowestRow_s),
                     fmt::format("rows every {:.3g}", record.T_s),
                     record.T_s > 1e3 * kSlowestRow_s ? "microseconds?" : "milliseconds?"});
  if (auto far = far_current(sizes(record.i_alphabeta), facts)) found.push_back(*std::move(far));
  constexpr double kSame = 0.03;
  const auto speed = [&](double scale) { return std::abs(health.speed_scale / scale - 1) < kSame; };
  const char* hint = speed(60 / kTwoPi)                                  ? "rpm?"
                     : speed(1 / kDegree)                                ? "degrees per second?"
                     : speed(1 / kTwoPi)                                 ? "turns per second?"
                     : speed(facts.machine.n_p) && facts.machine.n_p > 1 ? "the electrical speed?"
                                                                         : nullptr;
  if (hint)
    found.push_back({"omega_m", "the slope of theta_m, rad/s",
                     fmt::format("{:.4g} times it", health.speed_scale), hint});
  return found;
}

}  // namespace

std::optional<Inconsistency> far_current(std::vector<double> sizes, const DriveFacts& facts) {
  constexpr double kFar = 30, kUsual = 0.9;  // quantile: a unit moves all rows, spikes few
  const double rated = facts.machine.i_rated;
  if (rated <= 0 || quantile(sizes, kUsual) <= rated) return {};
  const double i = quantile(std::move(sizes), kNearly);
  if (i <= kFar * rated) return {};
  return Inconsistency{"i", fmt::format("up to some {:.3g} A (rated)", rated),
                       fmt::format("{:.3g}", i), "milliamperes?"};
}

std::vector<Inconsistency> inconsistencies(const Record& record, const Health& health,
                                           const DriveFacts& facts, int encoder_counts) {
  std::vector<Inconsistency> found;
  const ScaleFactors f = scales_of(record, facts);
  found = of_readings(record, facts, f, encoder_counts);
  const Beyond out = beyond(f);
  if (found.empty() && !out.of_machine()) found = of_current(record, f, facts, encoder_counts);
  if (found.empty() && out.any()) found = of_scales(record, f, out, facts, encoder_counts);
  if (found.empty()) found = of_zero(f);
  if (found.empty()) found = of_frame(f);
  for (Inconsistency& x : of_ranges(record, health, facts)) {
    const bool told = std::any_of(found.begin(), found.end(), [&](const Inconsistency& y) {
      return y.quantity == x.quantity || (x.quantity == "omega_m" && y.quantity == "theta_m");
    });
    if (!told) found.push_back(std::move(x));
  }
  return found;
}

std::string hidden_turns(const Record& record, const Health& health, const DriveFacts& facts,
                         const std::vector<Inconsistency>& found) {
  constexpr double kHalfTurn = kTwoPi / 2, kNearHalf = 0.8 * kHalfTurn;  // rad
  constexpr double kOften = 0.01, kHidden = 0.05;                        // of the rows
  if (std::any_of(found.begin(), found.end(),
                  [](const Inconsistency& i) { return i.hint != kAnotherMachine; }))
    return {};
  const MachineParameters& m = facts.machine;
  const double by_bus = m.psi_f > 0 ? facts.v_dc / (std::sqrt(3.0) * m.n_p * m.psi_f) : 0,
               fastest = std::max(m.omega_m_rated, by_bus);
  const auto far_apart = [&](const std::string& why) {
    return fmt::format(
        "the rows are too far apart: {}. Log at least {:.0f} rows a second, or an angle that "
        "counts turns",
        why, std::ceil(fastest / (0.5 * kHalfTurn)));
  };
  if (health.hidden_turns.value_or(0) > kHidden)
    return far_apart("from row to row omega_m turns the rotor by whole turns more than theta_m");
  if (health.hidden_turns) return {};  // omega_m shows that there are none
  std::size_t near_half = 0;
  double largest = 0;
  for (std::size_t k = 1; k < record.theta_m.size(); ++k) {
    if (!(record.motion_ok[k - 1] && record.motion_ok[k])) continue;
    const double turn = std::abs(record.theta_m[k] - record.theta_m[k - 1]);
    near_half += turn > kNearHalf;
    largest = std::max(largest, turn);
  }
  if (largest > 1.001 * kHalfTurn) return {};  // the angle counts turns
  if (static_cast<double>(near_half) > kOften * static_cast<double>(record.size()))
    return far_apart(
        fmt::format("theta_m turns by up to {:.2g} rad from row to row, and does not "
                    "show in which direction",
                    largest));
  if (!found.empty() && fastest * record.T_s > kHalfTurn)
    return far_apart(
        fmt::format("a rotor faster than {:.0f} rad/s turns by more than half a turn "
                    "from row to row, and the log shows another {} at the speed of "
                    "theta_m",
                    kHalfTurn / record.T_s, found.front().quantity));
  return {};
}

std::string sign_in_doubt(const Record& record, const DriveFacts& facts) {
  const ScaleFactors f = scales_of(record, facts);
  if (f.braking < kScaleSigmas || f.R_s.known() || f.L.known()) return {};
  return "the currents brake a rotor whose speed is held, and nothing else in the log shows their "
         "sign: log a change of "
         "speed";
}

std::string inconsistency_in_words(const Inconsistency& i) {
  return fmt::format("{} is expected to be {}, the log has {} ({})", i.quantity, i.expected,
                     i.found, i.hint);
}

std::vector<Inconsistency> inconsistencies_of_file(const Record& record, const Health& health,
                                                   const DriveFacts& facts, int encoder_counts) {
  if (!health.blind.empty()) return {};
  auto found = inconsistencies(record, health, facts, encoder_counts);
  if (!hidden_turns(record, health, facts, found).empty()) return {};
  for (Inconsistency& x : found) x.file = record.source;
  return found;
}

TraceResult inconsistent_result(std::vector<Inconsistency> found, const Health& health) {
  TraceResult r;
  r.verdict = "inconsistent";
  const std::string& file = found.front().file;
  r.sentence = fmt::format("{} and the drive file do not belong together: {}. No effect is traced.",
                           file.empty() ? "The log" : file, inconsistency_in_words(found.front()));
  r.health = health.lines();
  r.inconsistent = std::move(found);
  return r;
}

}  // namespace twinrate
