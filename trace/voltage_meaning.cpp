#include "trace/voltage_meaning.hpp"

#include <fmt/format.h>

#include <cmath>

namespace twinrate {
namespace {

// True if the voltage turns with the speed as with this meaning, and not as with the other,
// whatever the zero of the angle. Of 399 drawn logs 242 are decided so, none wrongly.
bool turns_as_said(const ScaleFactors& one, const ScaleFactors& other) {
  // Halves of the turn from row to row, 1 apart, and their standard deviations.
  constexpr double kNear = 0.25, kFar = 0.6, kNearSigma = 0.1, kFarSigma = 0.15;
  return std::abs(one.turned.value) < kNear && one.turned.sigma < kNearSigma &&
         std::abs(other.turned.value) > kFar && other.turned.sigma < kFarSigma;
}

// Share of the power that the equation does not explain, plus that of a turned magnet.
double power_left(const ScaleFactors& f) {
  return 1 - f.voltage_share + (f.psi_f.known() ? f.zero_e * f.zero_e : 0);
}

bool has_every_tick(const Record& record, const DriveFacts& facts) {
  constexpr double kEveryTick = 1.5;
  return facts.T_s <= 0 || record.T_s < kEveryTick * facts.T_s;
}

}  // namespace

ScaleFactors scales_of(const Record& record, const DriveFacts& facts, Reading as) {
  const ScaleFactors mean = scale_factors(record, facts, as);
  if (!record.has_voltage_equation() || has_every_tick(record, facts)) return mean;
  as.voltage_of_tick = true;
  const ScaleFactors tick = scale_factors(record, facts, as);
  return power_left(tick) < power_left(mean) ? tick : mean;
}

VoltageMeaning voltage_meaning(const Record& record, const DriveFacts& facts) {
  constexpr double kHalf = 0.5, kAsGood = 1.1, kStill = 0.02;  // rad
  // Of the power that the cells leave with any direction of psi. An angle with another zero makes
  // the wrong meaning fit, but not in this power (three drawn logs: 1.8 to 7.6 times as much is
  // left).
  constexpr double kSameCells = 1.02;
  if (!record.has_voltage_equation() || has_every_tick(record, facts)) return {};
  const ScaleFactors mean = scale_factors(record, facts),
                     tick = scale_factors(record, facts, {.voltage_of_tick = true});
  if (mean.mean_interval_e == 0) return {};  // too few rows
  const auto fits = [&](const ScaleFactors& one, const ScaleFactors& other) {
    return turns_as_said(one, other) ||
           (!turns_as_said(other, one) && power_left(one) < kHalf * power_left(other) &&
            1 - one.cell_share < kSameCells * (1 - other.cell_share));
  };
  if (fits(mean, tick)) return {};
  const double ticks = record.T_s / facts.T_s;
  const std::string rows = fmt::format("one row for {:.3g} ticks of the controller", ticks);
  const std::string compared = fmt::format(
      "the mean of the interval leaves {:.2g} % of the voltage's power, the tick's value {:.2g} %",
      100 * power_left(mean), 100 * power_left(tick));
  if (fits(tick, mean)) {
    // The ticks scatter about their mean. A lag of the voltage of up to two rows, which the ticks at
    // the ends of an interval span, averages that scatter away.
    VoltageMeaning of_tick{
        .of_tick = true, .open_e = mean.mean_interval_e / ticks, .open_s = 2 * record.T_s};
    of_tick.told = fmt::format(
        "{}, and its voltage is that of a tick ({}): the mean to the next row is "
        "taken from the ticks at its ends; an encoder_offset below {:.2g} rad and "
        "a lag below {:.2g} s are not traced",
        rows, compared, of_tick.open_e / facts.machine.n_p, of_tick.open_s);
    return of_tick;
  }
  if (mean.mean_interval_e < kStill && power_left(mean) < kAsGood * power_left(tick)) {
    VoltageMeaning slow{.open_e = mean.mean_interval_e, .open_s = record.T_s};
    slow.told = fmt::format(
        "{}; the voltage of a row is taken for the mean to the next row, and the rotor is too slow "
        "to "
        "tell: an encoder_offset below {:.2g} rad and a lag below {:.2g} s are not traced",
        rows, slow.open_e / facts.machine.n_p, slow.open_s);
    return slow;
  }
  return {
      .doubt = fmt::format("{}, and its voltage is neither clearly the mean of the interval nor "
                           "that of a tick ({})",
                           rows, compared),
      .open_e = mean.mean_interval_e,
      .open_s = record.T_s};
}

Record with_mean_of_ticks(const Record& record, const DriveFacts& facts) {
  Record out = record;
  const double ticks = record.T_s / facts.T_s;
  out.ticks_each = ticks;
  const auto turn_e = [&](std::size_t k) {  // up to the next row; the last as the one before
    const std::size_t from = std::min(k, record.size() - 2);
    return facts.machine.n_p * (record.theta_m[from + 1] - record.theta_m[from]);
  };
  for (std::size_t k = 0; k + 1 < record.size(); ++k) {
    const double half = 0.5 * turn_e(k), half_tick = half / ticks;
    const double kept = length_of_mean(turn_e(k), ticks);
    const Vec2 begin = inverse_park(record.u_alphabeta[k], half - half_tick),
               end = inverse_park(record.u_alphabeta[k + 1], -half - 0.5 * turn_e(k + 1) / ticks);
    out.u_alphabeta[k] = 0.5 * kept * (begin + end);
  }
  return out;
}

}  // namespace twinrate
