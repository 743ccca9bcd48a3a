// The JSON of a recording for the page.
#include <cmath>
#include <nlohmann/json.hpp>

#include "scope/recording.hpp"

namespace twinrate::scope {

using Json = nlohmann::ordered_json;

namespace {

// JSON has no NaN.
Json number(double value) {
  return std::isfinite(value) ? Json(value) : Json(nullptr);
}

Json trigger_json(const Trigger& trigger, bool capturing) {
  const TriggerSettings& t = trigger.settings();
  return {{"mode", kTriggerModeNames[static_cast<int>(t.mode)]},
          {"signal", t.signal},
          {"event", t.event},
          {"edge", kEdgeNames[static_cast<int>(t.edge)]},
          {"level", t.level},
          {"hysteresis", t.hysteresis},
          {"pre_share", t.pre_share},
          {"length_ticks", t.length_ticks},
          {"holdoff_ticks", t.holdoff_ticks},
          {"capturing", capturing}};
}

Json capture_json(const Capture& c) {
  return {{"id", c.id}, {"trigger_k", c.trigger_k}, {"from", c.from},
          {"to", c.to}, {"cause", c.cause},         {"missing", c.missing}};
}

Json event_json(const ScopeEvent& e) {
  return {{"k", e.k},       {"t_s", 1e-9 * static_cast<double>(e.t_ns)},
          {"role", e.role}, {"reason", e.reason},
          {"text", e.text}, {"trip", e.trip}};
}

Json process_json(const status_t& s) {
  const bool known = s.state >= 0 && s.state < static_cast<int>(std::size(kProcessStateNames));
  return {{"role", role_name(s.role)},
          {"state", known ? kProcessStateNames[s.state] : "unknown"},
          {"steps", s.steps},
          {"repeats", s.repeats},
          {"gaps", s.gaps},
          {"refused", s.refused},
          {"late", s.late_commands + s.late_gains},
          {"misses", s.deadline_misses}};
}

}  // namespace

Json Recording::brief() const {
  const Lock lock(mutex_);
  Json captures = Json::array();
  for (const Capture& c : captures_) captures.push_back(capture_json(c));
  return {{"first_k", store_.first_k()},
          {"last_k", store_.last_k()},
          {"T_s", drive_.T_s},
          {"generation", generation_},
          {"events", events_before_ + events_.size()},
          {"trigger", trigger_json(trigger_, pending_.has_value())},
          {"captures", captures}};
}

Json Recording::tree(std::int64_t now_us) const {
  const Lock lock(mutex_);
  Json signals = Json::array(), channels = Json::array(), processes = Json::array();
  for (std::size_t i = 0; i < signals_.list().size(); ++i) {
    const Signal& s = signals_.list()[i];
    const double value = i < newest_.size() ? newest_[i] : kNoValue;
    signals.push_back(
        {{"name", s.name}, {"unit", s.unit}, {"comment", s.comment}, {"value", number(value)}});
  }
  for (const WatchedChannel& c : channels_)
    if (c.messages() > 0)
      channels.push_back(
          {{"channel", layout_of(c.channel()).short_name},
           {"rate_Hz", number(rate_Hz(static_cast<std::size_t>(c.channel()), now_us))},
           {"messages", c.messages()},
           {"gaps", c.gaps()},
           {"repeats", c.repeats()},
           {"latency_us", c.latency_us() ? number(*c.latency_us()) : Json(nullptr)}});
  for (const auto& [role, status] : processes_) processes.push_back(process_json(status));
  return {{"signals", signals},
          {"channels", channels},
          {"processes", processes},
          {"drive",
           {{"name", drive_.name},
            {"n_p", drive_.n_p},
            {"T_s", drive_.T_s},
            {"omega_m_max_rad_s", drive_.omega_m_max},
            {"load_max_Nm", drive_.load_max_Nm},
            {"rated_torque_Nm", drive_.rated_torque_Nm},
            {"rated_current_A", drive_.i_max_A}}}};
}

Json Recording::events(std::size_t from) const {
  const Lock lock(mutex_);
  Json list = Json::array();
  for (std::size_t i = std::max(from, events_before_); i < events_before_ + events_.size(); ++i)
    list.push_back(event_json(events_[i - events_before_]));
  return list;
}

}  // namespace twinrate::scope
