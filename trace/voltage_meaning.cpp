#include "trace/voltage_meaning.hpp"

#include <fmt/format.h>

#include <cmath>

namespace twinrate {
namespace {

// Share of the power that the equation leaves, a turned magnet's included.
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

}  // namespace twinrate
