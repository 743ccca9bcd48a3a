#include <cmath>
#include <nlohmann/json.hpp>

#include "analysis/summary.hpp"
#include "core/channels.hpp"
#include "core/reason.hpp"

namespace twinrate {
namespace {

using Json = nlohmann::ordered_json;

Json number(const std::optional<double>& figure) {
  return figure && std::isfinite(*figure) ? Json(*figure) : Json(nullptr);
}

Json trip_json(const std::optional<Trip>& trip) {
  if (!trip) return nullptr;
  const char* name = reason_name(trip->reason);
  return {
      {"reason", trip->reason}, {"name", name ? Json(name) : Json(nullptr)}, {"tick", trip->k},
      {"t_s", trip->t_s},       {"process", role_name(trip->role)},          {"text", trip->text}};
}

}  // namespace

std::string to_json(const Summary& summary, const DriveConfig& config) {
  const int n = config.rates.n;
  Json json;
  json["locked"] = summary.locked ? Json(*summary.locked) : Json(nullptr);
  json["trip"] = trip_json(summary.trip);
  json["lost_at_s"] = number(summary.lost_at_s);
  json["lost_why"] = summary.lost_why.empty() ? Json(nullptr) : Json(summary.lost_why);
  json["speed_held"] = summary.speed_held ? Json(*summary.speed_held) : Json(nullptr);
  json["speed_dip_percent"] = number(summary.speed_dip_percent);
  json["speed_excess_percent"] = number(summary.speed_excess_percent);
  json["speed_unevenness_percent"] = number(summary.speed_unevenness_percent);
  json["window_from_s"] = summary.window_from_s;
  json["duration_s"] = summary.duration_s;
  json["steps"] = summary.steps;
  json["speed_error_rms_rad_s"] = number(summary.speed_error_rms);
  json["angle_error_rms_rad"] = number(summary.angle_error_rms);
  json["angle_error_max_rad"] = number(summary.angle_error_max);
  json["angle_reference"] = kAngleReferenceNames[static_cast<int>(summary.angle_reference)];
  json["speed_ripple_rms_rad_s"] = number(summary.speed_ripple_rms);
  json["speed_ripple_harmonics_rms_rad_s"] = number(summary.speed_ripple_harmonics_rms);
  json["f_s_Hz"] = config.rates.f_s_Hz;
  json["f_b_Hz"] = config.rates.f_s_Hz / n;
  json["n"] = n;
  json["policy"] = kGainPolicyNames[static_cast<int>(config.gain.policy)];
  json["rates_requested"] = summary.rates_requested;
  json["n_from_tick"] = summary.n_from_tick ? Json(*summary.n_from_tick) : Json(nullptr);
  json["gains_used"] = summary.gains_used;
  json["P44_min"] = number(summary.P44_min);
  json["P44_max"] = number(summary.P44_max);
  json["lost_messages"] = Json(summary.lost_messages);
  json["losses_counted"] = summary.losses_counted;
  json["repeats"] = summary.repeats;
  json["deadline_misses"] = summary.deadline_misses;
  json["late_gains"] = summary.late_gains;
  json["late_commands"] = summary.late_commands;
  json["stalls"] = summary.stalls;
  json["stalled_s"] = summary.stalled_s;
  json["longest_stall_s"] = summary.longest_stall_s;
  json["wall_s"] = summary.wall_s;
  json["steps_per_s"] = summary.wall_s > 0
                            ? Json(static_cast<double>(summary.steps) / summary.wall_s)
                            : Json(nullptr);
  return json.dump(2);
}

void take_process_figures(const std::string& summary_json, Summary& summary) {
  const Json json = Json::parse(summary_json, nullptr, false);
  if (!json.is_object()) return;
  const auto take = [&](const char* key, auto& figure) {
    if (json.contains(key) && json[key].is_number()) json[key].get_to(figure);
  };
  take("repeats", summary.repeats);
  take("deadline_misses", summary.deadline_misses);
  take("late_gains", summary.late_gains);
  take("late_commands", summary.late_commands);
  take("stalls", summary.stalls);
  take("stalled_s", summary.stalled_s);
  take("longest_stall_s", summary.longest_stall_s);
  take("wall_s", summary.wall_s);
  if (json.contains("losses_counted") && json["losses_counted"].is_boolean())
    json["losses_counted"].get_to(summary.losses_counted);
  if (!json.contains("lost_messages") || !json["lost_messages"].is_object()) return;
  for (const auto& [channel, count] : json["lost_messages"].items())
    if (count.is_number_integer()) summary.lost_messages[channel] = count.get<std::int64_t>();
}

}  // namespace twinrate
