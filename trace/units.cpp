#include "trace/units.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "trace/scale_bounds.hpp"

namespace twinrate {
namespace {

constexpr double kSqrt2 = 1.41421356237309505, kSqrt3 = 1.73205080756887729;

}  // namespace

std::vector<Unit> units(const MachineParameters& m, int encoder_counts) {
  const double n_p = m.n_p;
  std::vector<Unit> list;
  const auto add = [&](const char* quantity, const char* unit, double R_s, double L, double psi_f,
                       double K_t_J,
                       std::initializer_list<std::pair<double, const char*>> factors) {
    for (const auto& [factor, hint] : factors)
      list.push_back({quantity, unit, R_s, L, psi_f, K_t_J, factor, hint});
  };
  add("i", "A", -1, -1, 0, -1,
      {{1e3, "milliamperes?"},
       {1e6, "microamperes?"},
       {-1, "positive out of the motor?"},
       {1 / kSqrt2, "rms instead of peak values?"},
       {kSqrt2, "peak values times sqrt(2)?"},
       {1 / kSqrt3, "a Clarke transform that keeps the power, or line currents?"},
       {std::sqrt(1.5), "a Clarke transform that keeps the power?"},
       {1.5, "a Clarke transform without its 2/3?"},
       {0.5, "a scale of a half?"},
       {2, "a scale of two?"},
       {0.1, "a scale of a tenth?"},
       {10, "a scale of ten?"},
       {0.01, "a scale of a hundredth?"},
       {100, "a scale of a hundred?"},
       {1e-3, "kiloamperes?"}});
  add("u", "V", 1, 1, 1, 0,
      {{1e3, "millivolts?"},
       {kSqrt3, "line-to-line?"},
       {kSqrt3 / kSqrt2, "line-to-line, rms?"},
       {1 / kSqrt2, "rms instead of peak values?"},
       {kSqrt2, "peak values times sqrt(2)?"},
       {1 / kSqrt3, "divided by sqrt(3)?"},
       {-1, "sign of the voltage?"},
       {1.5, "a Clarke transform without its 2/3?"},
       {0.5, "a scale of a half?"},
       {2, "a scale of two?"},
       {1e-3, "kilovolts?"}});
  add("theta_m", "rad", kAny, kAny, -1, 1,
      {{1 / kDegree, "degrees?"}, {1 / kTwoPi, "turns?"}, {n_p, "the electrical angle?"}});
  if (encoder_counts > 0)
    add("theta_m", "rad", kAny, kAny, -1, 1, {{encoder_counts / kTwoPi, "counts of the encoder?"}});
  add("t", "s", kAny, kAny, 1, -2, {{1e3, "milliseconds?"}, {1e6, "microseconds?"}});
  add("psi_f", "Wb", 0, 0, 1, 1,
      {{kSqrt2, "rms instead of peak in psi_f or K_t?"},
       {1 / kSqrt2, "peak instead of rms in psi_f or K_t?"},
       {kSqrt3, "phase instead of line-to-line in psi_f or K_t?"},
       {1 / kSqrt3, "line-to-line instead of phase in psi_f or K_t?"},
       {1.5, "K_t without its 3/2?"},
       {1 / 1.5, "the 3/2 of K_t twice?"},
       {n_p, "divided by n_p twice?"},
       {1 / n_p, "not divided by n_p?"},
       {2, "a scale of two?"},
       {0.5, "pole pairs and poles?"},
       {1e-3, "mWb?"}});
  add("J", "kgm2", 0, 0, 0, -1,
      {{1e-4, "kg cm2 in the drive file?"},
       {1e-7, "g cm2 in the drive file?"},
       {1e-3, "a scale of a thousand?"}});
  add("R_s", "Ohm", 1, 0, 0, 0, {{1e-3, "milliohms in the drive file?"}});
  add("L", "H", 0, 1, 0, 0,
      {{1e-3, "mH in the drive file?"},
       {1e-6, "uH in the drive file?"},
       {10, "a tenth of it in the drive file?"},
       {0.1, "ten times it in the drive file?"}});
  return list;
}

namespace {

struct Scale {
  const ScaleRatio ScaleFactors::*ratio;
  double Unit::*exponent;
  double spread;  // of the logarithm, from effects of a working drive
};
constexpr Scale kScales[] = {{&ScaleFactors::R_s, &Unit::R_s, 0.35},
                             {&ScaleFactors::L, &Unit::L, 0.35},
                             {&ScaleFactors::psi_f, &Unit::psi_f, 0.07},
                             {&ScaleFactors::K_t_J, &Unit::K_t_J, 0.3}};

// Sum of squared deviations of the scales from those that the unit predicts, each over its spread.
// None if a scale deviates by more than kMost spreads, or if the log shows no scale that depends on
// the unit.
std::optional<double> misfit(const ScaleFactors& f, const Unit& unit) {
  constexpr double kMost = 1.5;
  double sum = 0;
  bool shown = false;
  for (const Scale& s : kScales) {
    const ScaleRatio& r = f.*s.ratio;
    const double exponent = unit.*s.exponent;
    const bool of_torque = s.ratio == &ScaleFactors::K_t_J;
    if (of_torque && f.torque_share < kMoves) continue;
    if (!r.known() || exponent == kAny) continue;
    if (s.ratio != &ScaleFactors::psi_f &&
        (r.value < 0) != (unit.factor < 0 && std::fmod(exponent, 2) != 0))
      return {};
    const double off = r.log() - exponent * std::log(std::abs(unit.factor));
    const double spread = std::hypot(s.spread, r.log_sigma());
    if (std::abs(off) > kMost * spread) return {};
    sum += off * off / (spread * spread);
    shown = shown || exponent != 0;
  }
  return shown ? std::optional(sum) : std::nullopt;
}

// Size of the quantity in the log.
double size_in_log(const Record& record, const Unit& unit, const DriveFacts& facts) {
  const std::string_view q = unit.quantity;
  const MachineParameters& m = facts.machine;
  const auto rms = [](const std::vector<Vec2>& x) {
    double sum = 0;
    for (const Vec2& v : x) sum += v.squaredNorm();
    return std::sqrt(sum / std::max<double>(1, static_cast<double>(x.size())));
  };
  if (q == "i") return rms(record.i_alphabeta);
  if (q == "u") return rms(record.u_alphabeta);
  if (q == "t") return record.T_s;
  if (q == "theta_m") {
    const auto [low, high] = std::minmax_element(record.theta_m.begin(), record.theta_m.end());
    return *high - *low;
  }
  return q == "psi_f" ? m.psi_f : q == "J" ? m.J : q == "R_s" ? m.R_s : m.L_q;
}

bool is_parameter(const Unit& unit) {
  const std::string_view q = unit.quantity;
  return q == "psi_f" || q == "J" || q == "R_s" || q == "L";
}

Inconsistency of_unit(const Record& record, const Unit& unit, const DriveFacts& facts) {
  const std::string_view q = unit.quantity;
  const double size = size_in_log(record, unit, facts);
  if (unit.factor < 0)
    return {unit.quantity, "the sign that the drive file gives", "the other", unit.hint};
  const char* what = q == "t"             ? "rows every "
                     : q == "theta_m"     ? "a range of "
                     : is_parameter(unit) ? ""
                                          : "rms ";
  // A parameter: the drive file expects it, the log has `factor` times that.
  const double expected = is_parameter(unit) ? size : size / unit.factor;
  const double found = is_parameter(unit) ? size * unit.factor : size;
  return {unit.quantity, fmt::format("{}{:.3g} {}", what, expected, unit.unit),
          fmt::format("{}{:.3g}", what, found), unit.hint};
}

// True if the quantity, corrected for this unit, has a size that is possible for the drive.
bool plausible(const Record& record, const Unit& unit, const DriveFacts& facts) {
  constexpr double kLittle = 1e-3, kMuch = 30;
  const std::string_view q = unit.quantity;
  if ((record.T_s > kSlowestRow_s) != (q == "t")) return false;
  const double rated = q == "i" ? facts.machine.i_rated : q == "u" ? facts.v_dc : 0;
  const double mended = size_in_log(record, unit, facts) / std::abs(unit.factor);
  return rated <= 0 || (mended > kLittle * rated && mended < kMuch * rated);
}

}  // namespace

std::optional<Inconsistency> fitting_unit(const Record& record, const ScaleFactors& f,
                                          const DriveFacts& facts, int encoder_counts) {
  constexpr double kAsWell = 0.1;
  struct Fitting {
    const Unit* unit;
    double misfit;
  };
  std::vector<Fitting> fitting;
  const std::vector<Unit> list = units(facts.machine, encoder_counts);
  for (const Unit& unit : list)
    if (const auto off = misfit(f, unit); off && plausible(record, unit, facts))
      fitting.push_back({&unit, *off});
  if (fitting.empty()) return {};
  std::stable_sort(fitting.begin(), fitting.end(),
                   [](const Fitting& a, const Fitting& b) { return a.misfit < b.misfit; });
  const Unit& best = *fitting.front().unit;
  Inconsistency found = of_unit(record, best, facts);
  std::set<std::string_view> told{best.quantity};
  for (const Fitting& other : fitting)
    if (other.misfit < fitting.front().misfit + kAsWell && told.insert(other.unit->quantity).second)
      found.hint += fmt::format(" or {}: {}", other.unit->quantity, other.unit->hint);
  return found;
}

std::vector<Inconsistency> of_current(const Record& record, const ScaleFactors& f,
                                      const DriveFacts& facts, int encoder_counts) {
  constexpr double kSame = 0.06, kLeast = 0.2;  // of the logarithm
  const auto sure = [](const ScaleRatio& r) { return r.known() && r.log_sigma() < kSame / 2; };
  if (f.cell_share < kFrameFits || f.torque_share < kFrameFits) return {};
  if (!sure(f.psi_f) || std::abs(f.psi_f.log()) > kSame) return {};
  if (!sure(f.K_t_J) || f.K_t_J.value < 0 || !(sure(f.L) || sure(f.R_s))) return {};
  for (const Unit& unit : units(facts.machine, encoder_counts)) {
    const auto fits = [&](const ScaleRatio& r) {
      return !sure(r) || (r.value > 0 && std::abs(r.log() + std::log(unit.factor)) < kSame);
    };
    if (std::string_view(unit.quantity) != "i" || unit.factor < 0) continue;
    if (std::abs(std::log(unit.factor)) > kLeast && fits(f.K_t_J) && fits(f.L) && fits(f.R_s))
      return {of_unit(record, unit, facts)};
  }
  return {};
}

}  // namespace twinrate
