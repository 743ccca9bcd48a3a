#include "trace/steps_at_reversals.hpp"

#include <algorithm>
#include <cmath>

#include "model/effects/tracing.hpp"
#include "trace/keys.hpp"
#include "trace/record.hpp"

namespace twinrate {

std::vector<std::size_t> steps_at_reversals(const Record& record, const Members& members) {
  constexpr double kWindow_s = 0.02, kNear_s = 0.06;
  constexpr double kStill = 0.02;  // of the largest speed
  const auto window = static_cast<std::size_t>(std::max(1.0, std::round(kWindow_s / record.T_s)));
  const auto speed = [&](std::size_t k) { return record.theta_m[k + window] - record.theta_m[k]; };
  double fastest = 0;
  const auto is_known = [&](std::size_t k) {
    return record.motion_ok[k] && record.motion_ok[k + window];
  };
  for (std::size_t k = 0; k + window < record.size(); ++k)
    if (is_known(k)) fastest = std::max(fastest, std::abs(speed(k)));
  struct Reversal {
    double from, to, direction;
  };
  std::vector<Reversal> reversals;
  double before = 0, since = 0;
  for (std::size_t k = 0; k + window < record.size(); ++k) {
    const double now = speed(k);
    if (!is_known(k) || std::abs(now) <= kStill * fastest) continue;
    if (before * now < 0)
      reversals.push_back({since - kNear_s, record.t[k] + kWindow_s + kNear_s, now});
    before = now;
    since = record.t[k];
  }
  std::vector<std::size_t> steps;
  for (std::size_t m = 0; m < members.size(); ++m) {
    if (!is_placed(*members[m], Traits::Place::kMoment)) continue;
    const double t = get_key(*members[m], "time_s"), torque = get_key(*members[m], "torque_Nm");
    if (std::any_of(reversals.begin(), reversals.end(), [&](const Reversal& r) {
          return t >= r.from && t <= r.to && torque * r.direction > 0;
        }))
      steps.push_back(m);
  }
  // A friction steps at every reversal: where there are many, two steps are there by chance.
  if (steps.size() < 2 || 2 * steps.size() < reversals.size()) steps.clear();
  return steps;
}

}  // namespace twinrate
