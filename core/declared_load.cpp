#include "core/declared_load.hpp"

#include <algorithm>
#include <iterator>

#include "core/steering.hpp"

namespace twinrate {

// A step is half a period before its tick, as SteeredDrive sets it.
void DeclaredLoad::steer(std::int64_t k, std::string_view lines) {
  const std::optional<double> load = steered_load(lines);
  if (!load) return;
  const double t_s = (static_cast<double>(k) - 0.5) * T_s_;
  const double first = steps_.front().value;
  std::erase_if(steps_, [&](const ProfileStep& step) { return step.t_s >= t_s; });
  if (steps_.empty()) steps_.push_back({0, first});
  steps_.push_back({t_s, *load});
}

double DeclaredLoad::at(double t_s) {
  const auto later = std::upper_bound(steps_.begin(), steps_.end(), t_s,
                                      [](double t, const ProfileStep& s) { return t < s.t_s; });
  const double wanted = later == steps_.begin() ? later->value : std::prev(later)->value;
  return T_load_ = slew(T_load_, wanted, slew_Nm_s_, T_s_);
}

}  // namespace twinrate
