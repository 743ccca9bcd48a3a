// How the messages of a run travelled, from its manifest.json.
#include <fmt/format.h>

#include "report/parts.hpp"

namespace twinrate::report {
namespace {

std::string percentiles(const Json& us) {
  return fmt::format("{:.0f}, {:.0f}, {:.0f} us (largest {:.0f})", us.at("p50").get<double>(),
                     us.at("p99").get<double>(), us.at("p99_9").get<double>(),
                     us.at("max").get<double>());
}

std::string link(const Json& link) {
  const auto asked = link.at("round_trips").get<std::int64_t>();
  const auto host = link.at("host").get<std::string>();
  if (host.empty()) return fmt::format("no answer to {} requests", asked);
  return fmt::format(
      "{}: round trip p50, p99, p99.9 {}; {} of {} lost; {} messages missed; clock {:+.0f} us, "
      "error below {:.0f} us",
      host, percentiles(link.at("round_trip_us")), link.at("round_trips_lost").get<std::int64_t>(),
      asked, link.at("messages_missed").get<std::int64_t>(),
      link.at("clock_offset_us").get<double>(), link.at("clock_offset_error_us").get<double>());
}

}  // namespace

std::string command_of(const std::string& manifest_json) {
  const Json manifest = Json::parse(manifest_json, nullptr, false);
  if (!manifest.is_object()) return "";
  const auto command = manifest.find("command");
  return command != manifest.end() && command->is_string() ? command->get<std::string>() : "";
}

Json transport_rows(const std::string& manifest_json) {
  Json rows = Json::array();
  try {
    const Json manifest = Json::parse(manifest_json);
    if (const auto granted = manifest.find("scheduling"); granted != manifest.end())
      rows.push_back({"scheduling", granted->get<std::string>()});
    if (const auto us = manifest.find("latency_us"); us != manifest.end()) {
      rows.push_back(
          {"MEASUREMENT to ESTIMATE p50, p99, p99.9", percentiles(us->at("to_estimate"))});
      rows.push_back({"ESTIMATE to COMMAND p50, p99, p99.9", percentiles(us->at("to_command"))});
      rows.push_back({"MEASUREMENT to COMMAND p50, p99, p99.9", percentiles(us->at("round"))});
    }
    if (const auto links = manifest.find("links"); links != manifest.end())
      for (const auto& [role, figures] : links->items())
        rows.push_back({"link to " + role, link(figures)});
    if (const auto refused = manifest.find("refused_messages"); refused != manifest.end())
      rows.push_back({"messages refused", fmt::format("{}", refused->get<std::int64_t>())});
    if (manifest.contains("authenticated") && !manifest.at("authenticated").get<bool>())
      rows.push_back({"messages", "not authenticated: anybody on the bus could steer"});
  } catch (const Json::exception&) {  // no run directory, or another program's manifest
  }
  return rows;
}

}  // namespace twinrate::report
