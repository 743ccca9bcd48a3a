#include "scope/trigger.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace twinrate::scope {

void Trigger::set(TriggerSettings settings) {
  settings_ = std::move(settings);
  last_k_ = waiting_since_ = -1;
  ready_from_ = steady_ = 0;
  below_ = above_ = false;
}

bool Trigger::fire(std::int64_t k) {
  const auto after = static_cast<std::int64_t>(
      std::llround((1 - settings_.pre_share) * static_cast<double>(settings_.length_ticks)));
  ready_from_ = k + after + settings_.holdoff_ticks;
  waiting_since_ = ready_from_;
  below_ = above_ = false;
  steady_ = 0;
  if (settings_.mode == TriggerMode::kSingle) settings_.mode = TriggerMode::kStop;
  return true;
}

bool Trigger::crosses(double value) {
  const bool rises = below_ && value >= settings_.level;
  const bool falls = above_ && value <= settings_.level;
  if (value < settings_.level - settings_.hysteresis) below_ = true;
  if (value > settings_.level + settings_.hysteresis) above_ = true;
  if (rises) below_ = false;
  if (falls) above_ = false;
  switch (settings_.edge) {
    case Edge::kRising:
      return rises;
    case Edge::kFalling:
      return falls;
    case Edge::kEither:
      return rises || falls;
    case Edge::kChange:
      break;
  }
  const bool steady = steady_ >= kSteadyTicks;
  steady_ = value == last_ ? std::min(steady_ + 1, kSteadyTicks) : 0;
  return steady && steady_ == 0;
}

bool Trigger::sample(std::int64_t k, double value) {
  if (!armed() || k <= last_k_ || !std::isfinite(value)) return false;
  const bool crossed = crosses(value);
  last_k_ = k;
  last_ = value;
  return crossed && !held_off(k) && fire(k);
}

bool Trigger::event(std::int64_t k, const std::string& name, bool trip) {
  if (!armed() || settings_.event.empty() || held_off(k)) return false;
  const bool wanted =
      settings_.event == "any" || settings_.event == name || (settings_.event == "trip" && trip);
  return wanted && fire(k);
}

bool Trigger::automatic(std::int64_t k) {
  if (settings_.mode != TriggerMode::kAutomatic) return false;
  if (waiting_since_ < 0) waiting_since_ = k;
  return k - waiting_since_ >= settings_.automatic_ticks && fire(k);
}

}  // namespace twinrate::scope
