// A value over drive time: a constant, or steps at given times.
//
// value(t) is the value of the last step with t_s <= t; before the first step it is the first
// value. Ramps come from the slew limit of the profile's user, so a profile never hides a rate.
#pragma once
#include <vector>

namespace twinrate {

struct ProfileStep {
  double t_s = 0;
  double value = 0;
};

class Profile {
 public:
  Profile(double constant = 0) : steps_{{0.0, constant}} {}
  // Requires at least one step, times strictly increasing (the config reader checks both).
  explicit Profile(std::vector<ProfileStep> steps) : steps_(std::move(steps)) {}

  double at(double t_s) const {
    double value = steps_.front().value;
    for (const ProfileStep& step : steps_) {
      if (step.t_s > t_s) break;
      value = step.value;
    }
    return value;
  }
  bool is_constant() const { return steps_.size() == 1; }
  const std::vector<ProfileStep>& steps() const { return steps_; }

 private:
  std::vector<ProfileStep> steps_;
};

// Moves `from` towards `to` by at most rate * dt; a rate of 0 means no limit.
inline double slew(double from, double to, double rate, double dt) {
  const double step = rate * dt;
  if (rate <= 0 || (to - from <= step && from - to <= step)) return to;
  return to > from ? from + step : from - step;
}

}  // namespace twinrate
