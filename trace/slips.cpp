#include "trace/slips.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <string_view>
#include <vector>

#include "trace/readings.hpp"
#include "trace/scale_bounds.hpp"
#include "trace/units.hpp"
#include "trace/voltage_meaning.hpp"

namespace twinrate {
namespace {

// Of the power that the best scales explain beyond the declared ones: 5 % of a size. A dead time at
// one speed may look like another scale of the voltage to within a fifth.
constexpr double kOpen = 0.0025;
// In squared deviations of one cell. By design: five free scales take up 5 of noise, and seldom 16;
// a slip that lowers the power by less than 20 is not visible.
constexpr double kChance = 16, kShown = 20;
// Of the residual power as declared: a slip must explain the whole error. Six slips at one speed
// left 0.0096 and less; with two missing effects that are no slips, the nearest slip left 0.09 to
// 0.31 (three drawn logs).
constexpr double kMostLeft = 0.03;
constexpr double kSure = 1.2;  // a known scale this close to 1 is right

bool right(const ScaleRatio& r) {
  return r.known() && r.value > 0 && std::abs(r.log()) < std::log(kSure);
}

// Test of a slip by one equation: it explains as much as scales can, or no less than the declared.
struct Said {
  bool fits = true, better = false;
  double misfit = 0;  // squared deviations of a cell beyond the best scales
};
Said said(const CellPower& as_declared, const CellPower& read, const CellPower::Scales& declared,
          const CellPower::Scales& slip) {
  if (read.cells < 20 || as_declared.cells < 20) return {};
  const double before = as_declared.left(declared), after = read.left(slip),
               one = read.rest / read.cells;
  const bool all = after < read.rest + kChance * one + kOpen * std::max(0.0, before - read.rest);
  return {.fits = all || after <= before,
          .better = all && before - after > kShown * one && after < kMostLeft * before,
          .misfit = (after - read.rest) / one};
}

double scale(const Unit& unit, double exponent) {
  return exponent == kAny ? 1 : std::pow(unit.factor, exponent);
}

// The slips that fit as well as the best one.
class FittingSlips {
 public:
  void ask(const char* quantity, const char* hint, bool frame, const Said& voltage,
           const Said& torque) {
    if (voltage.fits && torque.fits && (voltage.better || torque.better))
      found_.push_back({voltage.misfit + torque.misfit, fmt::format("{}: {}", quantity, hint),
                        frame, voltage.better, torque.better});
  }
  Slip all() {
    if (found_.empty()) return {};
    std::stable_sort(found_.begin(), found_.end(),
                     [](const Found& a, const Found& b) { return a.misfit < b.misfit; });
    Slip slip;
    std::vector<std::string_view> names;
    for (const Found& one : found_) {
      if (one.misfit > found_.front().misfit + kChance || names.size() == kMostNamed) break;
      names.push_back(one.name);
      slip.frame = slip.frame || one.frame;
      slip.voltage = slip.voltage || one.voltage;
      slip.torque = slip.torque || one.torque;
    }
    slip.text = fmt::format("a slip would explain it as well ({})", fmt::join(names, " or "));
    return slip;
  }

 private:
  static constexpr std::size_t kMostNamed = 3;
  struct Found {
    double misfit;
    std::string name;
    bool frame, voltage, torque;
  };
  std::vector<Found> found_;
};

}  // namespace

Slip slip_that_fits(const Record& record, const DriveFacts& facts) {
  const ScaleFactors f = scales_of(record, facts);
  FittingSlips slips;
  const CellPower::Scales machine{1, 1, 1, 0, 0}, load{1, 1, 0, 0, 0};
  const bool currents_right = right(f.K_t_J) || right(f.L) || right(f.R_s);
  for (const Unit& unit : units(facts.machine, 0)) {
    const std::string_view q = unit.quantity;
    if (q == "theta_m" || q == "t" || q == "J" || (q == "i" && currents_right)) continue;
    const CellPower::Scales scaled{scale(unit, unit.R_s), scale(unit, unit.L),
                                   scale(unit, unit.psi_f), 0, 0},
        driven{scale(unit, unit.K_t_J), 1, 0, 0, 0};
    slips.ask(unit.quantity, unit.hint, false, said(f.voltage, f.voltage, machine, scaled),
              said(f.torque, f.torque, load, driven));
  }
  if (currents_right) return slips.all();
  for (const OtherReading& other : other_readings(facts.machine.n_p, 0)) {
    if (!other.reading.mirrored && other.reading.current_turn == 0) continue;
    const ScaleFactors read = scales_of(record, facts, other.reading);
    slips.ask(other.quantity, other.hint, other.reading.mirrored,
              said(f.voltage, read.voltage, machine, machine),
              said(f.torque, read.torque, load, load));
  }
  return slips.all();
}

}  // namespace twinrate
