#include "scope/request_body.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "core/config.hpp"
#include "scope/recording.hpp"

namespace twinrate::scope {

using Json = nlohmann::ordered_json;

namespace {

double number_in(const Json& body, const char* key, double fallback, double lo, double hi) {
  if (!body.contains(key)) return fallback;
  if (!body[key].is_number()) throw BadInput(fmt::format("{}: a number allowed", key));
  const double value = body[key].get<double>();
  if (!(value >= lo && value <= hi))
    throw BadInput(fmt::format("{} = {}: {} to {} allowed", key, value, lo, hi));
  return value;
}

template <std::size_t N>
int choice_in(const Json& body, const char* key, const char* const (&names)[N], int fallback) {
  const std::string word = text_in(body, key);
  if (word.empty()) return fallback;
  for (std::size_t i = 0; i < N; ++i)
    if (word == names[i]) return static_cast<int>(i);
  throw BadInput(fmt::format("{} = {}: one of {} allowed", key, word, fmt::join(names, ", ")));
}

}  // namespace

std::string text_in(const Json& body, const char* key) {
  if (!body.contains(key)) return "";
  if (!body[key].is_string()) throw BadInput(fmt::format("{}: a text allowed", key));
  return body[key].get<std::string>();
}

TriggerSettings trigger_settings(const Json& body) {
  TriggerSettings t;
  t.mode = static_cast<TriggerMode>(choice_in(body, "mode", kTriggerModeNames, 0));
  t.edge = static_cast<Edge>(choice_in(body, "edge", kEdgeNames, 0));
  t.signal = text_in(body, "signal");
  t.event = text_in(body, "event");
  if (t.mode != TriggerMode::kStop && t.signal.empty() == t.event.empty())
    throw BadInput("a trigger needs a signal or an event");
  t.level = number_in(body, "level", 0, -1e300, 1e300);
  t.hysteresis = number_in(body, "hysteresis", 0, 0, 1e300);
  t.pre_share = number_in(body, "pre_share", 0.5, 0, 1);
  t.length_ticks = static_cast<std::int64_t>(
      number_in(body, "length_ticks", 1000, 2, static_cast<double>(kMaxCaptureTicks)));
  t.holdoff_ticks = static_cast<std::int64_t>(number_in(body, "holdoff_ticks", 0, 0, 1e12));
  t.automatic_ticks = std::max<std::int64_t>(2 * t.length_ticks, 1000);
  return t;
}

}  // namespace twinrate::scope
