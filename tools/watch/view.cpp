#include "tools/watch/view.hpp"

#include <fmt/format.h>

#include <iterator>
#include <nlohmann/json.hpp>

#include "core/report_error.hpp"
#include "tools/watch/key_values.hpp"

namespace twinrate {
namespace {

using Json = nlohmann::ordered_json;
constexpr double kMaxSilence_s = 3;

std::string state_name(int state) {
  const bool known = state >= 0 && state < static_cast<int>(std::size(kProcessStateNames));
  return known ? kProcessStateNames[state] : fmt::format("state {}", state);
}

// Lines are cut to the width of the terminal: a redraw relies on the number of lines.
void add_line(std::string& text, std::string line, std::size_t width) {
  if (width > 0 && line.size() > width) line.resize(width);
  text += line + "\n";
}

std::string channel_line(const WatchedChannel& account, std::int64_t now_us) {
  const auto latency = account.latency_us();
  return fmt::format(
      "{:<18} {:>8.0f} {:>10} {:>6} {:>7} {:>15} {:>7.2f}  {}", info(account.channel()).name,
      account.rate_Hz(now_us), account.last_seq(), account.gaps(), account.repeats(),
      latency ? fmt::format("{:.0f} / {:.0f}", *latency, account.latency_max_us()) : "",
      account.age_s(now_us), to_text(key_values(account.channel(), account.newest())));
}

std::string process_line(const status_t& s) {
  return fmt::format("{:<18} {:<9} {:>9} {:>8} {:>6} {:>8} {:>11} {:>11} {:>8}", role_name(s.role),
                     state_name(s.state), s.steps, s.repeats, s.gaps, s.refused,
                     s.late_commands + s.late_gains, s.undecodable, s.deadline_misses);
}

Json channel_json(const WatchedChannel& account, std::int64_t now_us) {
  Json json = {{"messages", account.messages()}, {"rate_Hz", account.rate_Hz(now_us)},
               {"seq", account.last_seq()},      {"t_ns", account.last_t_ns()},
               {"gaps", account.gaps()},         {"repeats", account.repeats()},
               {"age_s", account.age_s(now_us)}};
  if (const auto latency = account.latency_us()) {
    json["latency_us"] = *latency;
    json["latency_max_us"] = account.latency_max_us();
  }
  const KeyValues values = key_values(account.channel(), account.newest());
  for (const auto& [key, value] : values.numbers) json["values"][key] = value;
  if (!values.text.empty()) json["text"] = values.text;
  return json;
}

Json process_json(const status_t& s) {
  return {{"role", role_name(s.role)},
          {"state", state_name(s.state)},
          {"seq", s.seq},
          {"steps", s.steps},
          {"repeats", s.repeats},
          {"duplicates", s.duplicates},
          {"gaps", s.gaps},
          {"refused", s.refused},
          {"undecodable", s.undecodable},
          {"late_commands", s.late_commands},
          {"late_gains", s.late_gains},
          {"deadline_misses", s.deadline_misses}};
}

}  // namespace

std::string silence_text(const Watcher& watcher, const std::string& url) {
  if (watcher.silent_s() < kMaxSilence_s) return "";
  return fmt::format("nothing heard on {} for {:.0f} s: is a drive running? try twinrate doctor",
                     url, watcher.silent_s());
}

std::string view_text(const Watcher& watcher, const std::string& url, std::size_t width) {
  std::string text;
  const std::int64_t now_us = wall_clock_us();
  add_line(text,
           fmt::format("{}  session {:x}{}", url, watcher.session(),
                       watcher.foreign() > 0
                           ? fmt::format("  {} messages of other sessions", watcher.foreign())
                           : ""),
           width);
  add_line(text,
           fmt::format("{:<18} {:>8} {:>10} {:>6} {:>7} {:>15} {:>7}  {}", "channel", "rate/s",
                       "seq", "gaps", "repeats", "after MEAS, us", "age, s", "last values"),
           width);
  for (const WatchedChannel& account : watcher.channels())
    if (account.messages() > 0) add_line(text, channel_line(account, now_us), width);
  if (!watcher.processes().empty())
    add_line(
        text,
        fmt::format("{:<18} {:<9} {:>9} {:>8} {:>6} {:>8} {:>11} {:>11} {:>8}", "process", "state",
                    "steps", "repeats", "gaps", "refused", "late inputs", "undecodable", "misses"),
        width);
  for (const auto& [role, status] : watcher.processes())
    add_line(text, process_line(status), width);
  for (const WatchedEvent& event : watcher.events())
    add_line(text,
             fmt::format("event  k {}  {}  {}: {}", event.seq, event.role, event.reason,
                         printable(event.text)),
             width);
  const std::string silence = silence_text(watcher, url);
  if (!silence.empty()) add_line(text, silence, width);
  return text;
}

std::string view_json(const Watcher& watcher, const std::string& url) {
  const std::int64_t now_us = wall_clock_us();
  Json json = {{"url", url},
               {"session", watcher.session()},
               {"heard", watcher.heard()},
               {"silent_s", watcher.silent_s()},
               {"foreign", watcher.foreign()},
               {"undecodable", watcher.undecodable()},
               {"channels", Json::object()},
               {"processes", Json::array()},
               {"events", Json::array()}};
  for (const WatchedChannel& account : watcher.channels())
    if (account.messages() > 0)
      json["channels"][info(account.channel()).name] = channel_json(account, now_us);
  for (const auto& [role, status] : watcher.processes())
    json["processes"].push_back(process_json(status));
  for (const WatchedEvent& event : watcher.events())
    json["events"].push_back(
        {{"seq", event.seq}, {"role", event.role}, {"reason", event.reason}, {"text", event.text}});
  return json.dump();
}

}  // namespace twinrate
