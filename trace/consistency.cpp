#include "trace/consistency.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>

#include "trace/scale_factors.hpp"

namespace twinrate {
namespace {

constexpr double kDegree = kTwoPi / 360, kSqrt2 = 1.41421356237309505, kSqrt3 = 1.73205080756887729;

constexpr double kMostPsi = kThisMachine.psi_f, kMostR = kThisMachine.R_s, kMostL = kThisMachine.L,
                 kLightest = kThisMachine.lightest, kHeaviest = kThisMachine.heaviest;
constexpr double kSigmas = 4;
// Of the voltage's power: a frame that explains less is another's, one that explains more is right.
constexpr double kFrameFails = 0.7, kFrameFits = 0.9;
// Of the torque's power, beside frictions and load: the current moves the rotor.
constexpr double kMoves = 0.5;
constexpr double kSlowTurn = 0.3;        // rad between rows: further on, samples are no means
constexpr double kFarZero = kTwoPi / 8;  // electrical: a drive would lose a third of its torque
constexpr double kSlowestRow_s = 0.02;   // rows of a moving drive stand closer

// How a scale follows from a quantity that is `factor` times what the drive file means.
struct Unit {
  const char* quantity;
  const char* unit;
  double R_s, L, psi_f, K_t_J;  // exponents of the factor; kAny: does not say
  double factor;
  const char* hint;
};
constexpr double kAny = 99;

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
  add("L", "H", 0, 1, 0, 0, {{1e-3, "mH in the drive file?"}, {1e-6, "uH in the drive file?"}});
  return list;
}

struct Scale {
  const ScaleRatio ScaleFactors::*ratio;
  double Unit::*exponent;
  double spread;  // of the logarithm, by effects of a working drive
};
constexpr Scale kScales[] = {{&ScaleFactors::R_s, &Unit::R_s, 0.35},
                             {&ScaleFactors::L, &Unit::L, 0.35},
                             {&ScaleFactors::psi_f, &Unit::psi_f, 0.07},
                             {&ScaleFactors::K_t_J, &Unit::K_t_J, 0.3}};

// Sum of squared deviations of the scales from what the unit makes of them, each over its spread;
// none where one lies further off than that, or where the log shows no scale that the unit moves.
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

// Beyond what effects do, by more than its uncertainty and by more than the equation leaves.
bool beyond(const ScaleRatio& r, double least, double most) {
  if (!r.known() || r.over_rest < 1) return false;
  if (r.value < 0) return -r.value > kSigmas * r.sigma;
  const double reach = kSigmas * r.log_sigma();
  return r.log() - reach > std::log(most) || r.log() + reach < std::log(least);
}

struct Beyond {
  bool R_s, L, psi_f, K_t_J, T_load;
  bool any() const { return of_machine() || T_load; }
  bool of_machine() const { return R_s || L || psi_f || K_t_J; }
};

// The declared load against the motor's own torque, whatever the inertia is.
ScaleRatio load_of_motor(const ScaleFactors& f) {
  if (!f.T_load.known() || !f.K_t_J.known() || f.K_t_J.value <= 0) return {};
  const double value = f.T_load.value / f.K_t_J.value;
  return {value, std::abs(value) * std::hypot(f.T_load.log_sigma(), f.K_t_J.log_sigma()),
          std::max(f.T_load.over_rest, f.K_t_J.over_rest)};
}

Beyond beyond(const ScaleFactors& f) {
  constexpr double kThousandfold = 300, kBrake = 1.4;  // a brake's set value is nearer than that
  const bool voltage = f.cell_share > kFrameFits && f.mean_interval_e < kSlowTurn;
  const bool torque = f.torque_share > kMoves;
  return {.R_s = voltage && beyond(f.R_s, 1 / kMostR, kMostR),
          .L = voltage && beyond(f.L, 1 / kMostL, kMostL),
          .psi_f = f.cell_share > kFrameFits && beyond(f.psi_f, 1 / kMostPsi, kMostPsi),
          .K_t_J = torque && beyond(f.K_t_J, 1 / kHeaviest, kLightest),
          .T_load = (torque && beyond(f.T_load, 1 / kThousandfold, kThousandfold)) ||
                    (f.torque_share > kFrameFits && beyond(load_of_motor(f), 1 / kBrake, kBrake))};
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
  if (unit.factor < 0) return {unit.quantity, "the sign of the drive file", "the other", unit.hint};
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

// Mended by this unit, the quantity has a size that the drive may have.
bool plausible(const Record& record, const Unit& unit, const DriveFacts& facts) {
  constexpr double kLittle = 1e-3, kMuch = 30;
  const std::string_view q = unit.quantity;
  if ((record.T_s > kSlowestRow_s) != (q == "t")) return false;
  const double rated = q == "i" ? facts.machine.i_rated : q == "u" ? facts.v_dc : 0;
  const double mended = size_in_log(record, unit, facts) / std::abs(unit.factor);
  return rated <= 0 || (mended > kLittle * rated && mended < kMuch * rated);
}

Inconsistency of_ratio(const char* quantity, const char* unit, double declared,
                       const ScaleRatio& r) {
  return {quantity, fmt::format("{:.3g} {}", declared, unit),
          fmt::format("{:.3g} +- {:.2g} {}", r.value * declared, r.sigma * declared, unit),
          "another machine, or a scale of the signals?"};
}

// The unit that fits all scales, with others that fit as well.
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

// That unit; without one, what is beyond its bounds.
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
  // Both are of J: which of them is off is the one further from 1.
  const bool of_motor =
      f.T_load.value > 0 && f.K_t_J.known() && std::abs(f.K_t_J.log()) > std::abs(f.T_load.log());
  if (out.T_load && of_motor)
    found.push_back({"i", "a torque K_t i_q that carries T_load",
                     fmt::format("the motion shows {:.3g} of it", f.K_t_J.value),
                     "rms instead of peak values, a scale of the currents, or K_t?"});
  else if (out.T_load)
    found.push_back(
        {"T_load", "in Nm, positive against positive speed",
         fmt::format("the motion shows {:.3g} of it, with the declared J", f.T_load.value),
         f.T_load.value < 0 ? "its sign?" : "its unit or scale?"});
  return found;
}

// Share of the power that the equation leaves, a turned magnet's included.
double power_left(const ScaleFactors& f) {
  return 1 - f.voltage_share + (f.psi_f.known() ? f.zero_e * f.zero_e : 0);
}

bool has_every_tick(const Record& record, const DriveFacts& facts) {
  constexpr double kEveryTick = 1.5;
  return facts.T_s <= 0 || record.T_s < kEveryTick * facts.T_s;
}

// A row's voltage is the mean up to the next row, or that of a tick: as it fits better.
ScaleFactors scales_of(const Record& record, const DriveFacts& facts, Reading as = {}) {
  const ScaleFactors mean = scale_factors(record, facts, as);
  if (!record.has_voltage_equation() || has_every_tick(record, facts)) return mean;
  as.voltage_of_tick = true;
  const ScaleFactors tick = scale_factors(record, facts, as);
  return power_left(tick) < power_left(mean) ? tick : mean;
}

// Every scale that a current moves shows one factor of a convention, and psi_f is as declared.
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

struct OtherReading {
  const char* quantity;
  const char* expected;
  const char* hint;
  Reading reading;
  double K_t_J = 1;  // over the declared, where that is what differs
};

std::vector<OtherReading> other_readings(int n_p, int encoder_counts) {
  const char* angle = "the mechanical angle, rad";
  std::vector<OtherReading> list;
  const auto add = [&](const char* expected, const char* hint, double factor) {
    list.push_back({"theta_m", expected, hint, {.angle_factor = factor}});
    list.push_back({"theta_m", expected, hint, {.angle_factor = factor, .voltage_stands = true}});
    list.push_back({"theta_m",
                    expected,
                    hint,
                    {.angle_factor = factor, .current_stands = true, .voltage_stands = true}});
  };
  add("an angle that grows with the phases' order a, b, c",
      "direction of the angle reversed, or two phases swapped?", -1);
  add(angle, "degrees?", kDegree);
  add(angle, "turns?", kTwoPi);
  if (n_p > 1) add(angle, "the electrical angle?", 1.0 / n_p);
  if (encoder_counts > 0) add(angle, "counts of the encoder?", kTwoPi / encoder_counts);
  for (const int n : {n_p / 2, 2 * n_p, n_p - 1, n_p + 1, n_p - 2, n_p + 2}) {
    const double factor = static_cast<double>(n) / n_p;
    if (n < 1 || (n == n_p / 2 && 2 * n != n_p)) continue;
    const char* hint = n == n_p / 2   ? "poles in the place of pole pairs?"
                       : n == 2 * n_p ? "half of the pole pairs?"
                                      : "pole pairs miscounted?";
    for (const bool stands : {false, true})
      list.push_back({"n_p",
                      "that of the drive file",
                      hint,
                      {.angle_factor = factor, .voltage_stands = stands},
                      factor * factor});
    list.push_back({"n_p",
                    "that of the drive file",
                    hint,
                    {.angle_factor = factor, .current_stands = true, .voltage_stands = true},
                    factor * factor});
  }
  const char* order = "phases in the order a, b, c";
  const char* swapped[] = {"i_b and i_c swapped?", "i_a and i_b swapped?", "i_a and i_c swapped?"};
  for (int turn = 0; turn < 3; ++turn) {
    const double angle_e = kTwoPi / 3 * turn;
    list.push_back({"i", order, swapped[turn], {.mirrored = true, .current_turn = angle_e}});
    if (turn > 0) list.push_back({"i", order, "phases shifted by one?", {.current_turn = angle_e}});
  }
  for (const double angle_e : {kTwoPi / 4, -kTwoPi / 4})
    list.push_back({"theta_m",
                    "zero where the magnet is on phase a",
                    "its zero turned by 90 degrees electrical?",
                    {.current_turn = angle_e}});
  return list;
}

bool turned_by_half(const ScaleFactors& f) {
  return f.psi_f.known() && std::abs(f.zero_e) > kTwoPi / 3;
}

// In the frame of another reading the log is one of this machine.
bool is_this_machine(const ScaleFactors& f, double K_t_J) {
  const auto near = [](const ScaleRatio& r, double most, double expected = 1) {
    return !r.known() || (r.value > 0 && std::abs(r.log() - std::log(expected)) < std::log(most));
  };
  return !turned_by_half(f) && near(f.psi_f, kMostPsi) && near(f.R_s, kMostR) &&
         near(f.L, kMostL) && near(f.K_t_J, kLightest, K_t_J);
}

// The log does not fit as it is, and does in another reading: in the voltage, or, where that says
// nothing or fits, in the torque. A voltage that is mostly EMF fits with any current.
std::vector<Inconsistency> of_readings(const Record& record, const DriveFacts& facts,
                                       const ScaleFactors& as_it_is, int encoder_counts) {
  // That the other reading leaves less; of a frame turned by half, that has all but one sign right.
  const double times = turned_by_half(as_it_is) ? 1.2 : 3;
  constexpr double kMuchEmf = 9;  // of the voltage's power: weakened to a third
  const bool has_voltage = record.has_voltage_equation();
  const bool by_voltage =
      has_voltage && (as_it_is.cell_share < kFrameFails || turned_by_half(as_it_is) ||
                      as_it_is.emf_share > kMuchEmf || beyond(as_it_is).of_machine());
  const bool by_torque = as_it_is.torque_share < (has_voltage ? kFrameFits : kMoves);
  if (!by_voltage && !by_torque) return {};
  struct Best {
    const OtherReading* reading = nullptr;
    double share = 0;
  };
  const auto least = [&](double share) { return std::max(kFrameFits, 1 - (1 - share) / times); };
  Best voltage{.share = least(as_it_is.cell_share)}, torque{.share = least(as_it_is.torque_share)};
  const std::vector<OtherReading> list = other_readings(facts.machine.n_p, encoder_counts);
  for (const OtherReading& other : list) {
    const bool of_current = other.reading.mirrored || other.reading.current_turn != 0;
    const bool same_without_voltage =
        other.K_t_J != 1 || (other.reading.voltage_stands && !other.reading.current_stands);
    if (has_voltage ? !by_voltage && !of_current : same_without_voltage) continue;
    const ScaleFactors f = scales_of(record, facts, other.reading);
    if (!is_this_machine(f, other.K_t_J) || f.voltage_share < as_it_is.voltage_share) continue;
    if (by_voltage && f.cell_share > voltage.share) voltage = {&other, f.cell_share};
    if (by_torque && (of_current || !has_voltage) && f.torque_share > torque.share)
      torque = {&other, f.torque_share};
  }
  const Best& best = torque.reading && !voltage.reading ? torque : voltage;
  if (!best.reading) return {};
  return {{best.reading->quantity, best.reading->expected,
           fmt::format(
               "a rotor frame that explains {:.1f} % of the {}; read the other way {:.1f} %",
               100 * std::max(0.0, &best == &voltage ? as_it_is.cell_share : as_it_is.torque_share),
               &best == &voltage ? "voltage" : "torque", 100 * best.share),
           best.reading->hint}};
}

// The declared magnet is where it should be: the rest of the voltage is the loop's own, a controller's
// answer to noise and to the steps of the angle.
bool magnet_in_place(const ScaleFactors& f) {
  const double reach = std::log(kMostPsi) + kSigmas * f.psi_f.log_sigma();
  return f.psi_f.known() && std::abs(f.psi_f.log()) < reach && std::abs(f.zero_e) < kFarZero;
}

// No R_s, L and psi_f, whatever their sizes, make this voltage of this current and angle, though the
// rotor turns fast enough for an EMF.
std::vector<Inconsistency> of_frame(const ScaleFactors& f) {
  constexpr double kEmf = 0.3;
  if (magnet_in_place(f)) return {};
  if (f.emf_share < kEmf || f.cell_share > kFrameFails || f.mean_interval_e > kSlowTurn) return {};
  return {{"theta_m", "the angle that voltage and current turn with",
           fmt::format("{:.0f} % of the voltage follow from current and angle, with any R_s, L and "
                       "psi_f",
                       100 * std::max(0.0, f.cell_share)),
           "the angle of another shaft, another n_p, or another order or sign of the phases?"}};
}

// Such a drive would run with a third of its torque lost; one that runs well is read from elsewhere.
std::vector<Inconsistency> of_zero(const ScaleFactors& f) {
  if (f.cell_share < kFrameFits || f.mean_interval_e > kSlowTurn || !f.psi_f.known()) return {};
  if (std::abs(f.zero_e) < kFarZero || turned_by_half(f)) return {};
  return {{"theta_m", "zero where the magnet is on phase a",
           fmt::format("the magnet at {:.0f} degrees electrical there", f.zero_e / kDegree),
           "another zero of the angle?"}};
}

double quantile(std::vector<double> x, double share) {
  if (x.empty()) return 0;
  const auto at =
      x.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(x.size() - 1));
  std::nth_element(x.begin(), at, x.end());
  return *at;
}

std::vector<double> sizes(const std::vector<Vec2>& x) {
  std::vector<double> out;
  out.reserve(x.size());
  for (const Vec2& v : x) out.push_back(v.norm());
  return out;
}

// What no equation is needed for: the bus, the speed beside the angle.
std::vector<Inconsistency> of_ranges(const Record& record, const Health& health,
                                     const DriveFacts& facts) {
  constexpr double kNearly = 0.999, kOutOfReach = 1.15, kFarCurrent = 30;
  std::vector<Inconsistency> found;
  const double bus = quantile(record.v_dc, 0.5), u = quantile(sizes(record.u_alphabeta), kNearly);
  const double i = quantile(sizes(record.i_alphabeta), kNearly);
  if (!record.v_dc.empty() && bus < 0)
    found.push_back({"v_dc", "above 0 V", fmt::format("{:.4g} V", bus), "its sign?"});
  if (facts.v_dc > 0 && bus > 100 * facts.v_dc)
    found.push_back({"v_dc", fmt::format("about {:.3g} V", facts.v_dc), fmt::format("{:.4g}", bus),
                     "millivolts?"});
  if (bus > 0 && u > kOutOfReach * 2 / 3 * bus)
    found.push_back({"u", fmt::format("up to 2/3 v_dc = {:.3g} V", 2.0 / 3 * bus),
                     fmt::format("{:.3g} V", u),
                     u > 2 * bus ? "unit of the voltage?" : "line-to-line?"});
  constexpr double kNoDrive_s = 0.15;  // no need of an equation
  if (record.T_s > kNoDrive_s)
    found.push_back({"t", fmt::format("rows of at most {:.3g} s", kSlowestRow_s),
                     fmt::format("rows every {:.3g}", record.T_s),
                     record.T_s > 1e3 * kSlowestRow_s ? "microseconds?" : "milliseconds?"});
  const double rated = facts.machine.i_rated;
  if (rated > 0 && i > kFarCurrent * rated)
    found.push_back({"i", fmt::format("up to some {:.3g} A (rated)", rated),
                     fmt::format("{:.3g}", i), "milliamperes?"});
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

std::string sign_in_doubt(const Record& record, const DriveFacts& facts) {
  const ScaleFactors f = scales_of(record, facts);
  if (f.braking < kSigmas || f.R_s.known() || f.L.known()) return {};
  return "the currents brake a rotor whose speed is held, and nothing else in the log shows their "
         "sign: log a change of "
         "speed";
}

VoltageMeaning voltage_meaning(const Record& record, const DriveFacts& facts) {
  constexpr double kHalf = 0.5, kAsGood = 1.1, kStill = 0.02;  // rad
  if (!record.has_voltage_equation() || has_every_tick(record, facts)) return {};
  const ScaleFactors mean = scale_factors(record, facts),
                     tick = scale_factors(record, facts, {.voltage_of_tick = true});
  if (mean.mean_interval_e == 0) return {};  // too few rows to say
  if (power_left(mean) < kHalf * power_left(tick)) return {};
  if (mean.mean_interval_e < kStill && power_left(mean) < kAsGood * power_left(tick))
    return {.doubt = "",
            .open_e = mean.mean_interval_e,
            .of_tick = power_left(tick) < power_left(mean)};
  std::string why = fmt::format(
      "the log has one row for {:.3g} ticks of the controller, and its voltage is {} (the mean of "
      "the interval leaves {:.2g} % of the voltage's power, the tick's value {:.2g} %): no "
      "electrical effect is traced. Log every tick, or the mean voltage from row to row in stator "
      "axes",
      record.T_s / facts.T_s,
      power_left(tick) < kHalf * power_left(mean) ? "that of a tick"
                                                  : "not clearly the mean of the interval",
      100 * power_left(mean), 100 * power_left(tick));
  return {.doubt = std::move(why)};
}

Record with_mean_of_ticks(const Record& record, const DriveFacts& facts) {
  Record out = record;
  const double share = 0.5 * (1 - facts.T_s / record.T_s) * facts.machine.n_p;
  for (std::size_t k = 0; k + 1 < record.size(); ++k)
    out.u_alphabeta[k] =
        inverse_park(record.u_alphabeta[k], share * (record.theta_m[k + 1] - record.theta_m[k]));
  return out;
}

TraceResult inconsistent_result(std::vector<Inconsistency> found, const Health& health) {
  TraceResult r;
  r.verdict = "inconsistent";
  const Inconsistency& first = found.front();
  r.sentence = fmt::format(
      "The log and the drive file do not belong together: {} is expected to be {}, the log has {} "
      "({}). No effect is traced.",
      first.quantity, first.expected, first.found, first.hint);
  r.health = health.lines();
  r.inconsistent = std::move(found);
  return r;
}

}  // namespace twinrate
