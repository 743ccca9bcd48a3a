#include "run/run_result.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string_view>

#include "analysis/long_log.hpp"
#include "core/channels.hpp"
#include "core/command_line.hpp"
#include "core/output_file.hpp"
#include "core/reason.hpp"
#include "core/stall_text.hpp"
#include "core/steering.hpp"
#include "report/report.hpp"
#include "run/hop_latency.hpp"
#include "run/progress.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr double kDegrees = 180 / kPi;

Json read_json(const fs::path& path) {
  std::ifstream in(path);
  return in ? Json::parse(in, nullptr, false) : Json();
}

// Messages lost by channel, from the logger's account.
std::map<std::string, std::int64_t> lost_messages(const Json& account) {
  std::map<std::string, std::int64_t> lost;
  if (account.is_object() && account.contains("channels"))
    for (const auto& [channel, counts] : account["channels"].items())
      lost[channel] = counts.value("lost", std::int64_t{0});
  return lost;
}

std::string angle_errors(const Summary& s) {
  if (s.angle_error_rms)
    return fmt::format("{:.3f} deg, {:.3f} deg", *s.angle_error_rms * kDegrees,
                       *s.angle_error_max * kDegrees);
  return s.angle_reference == AngleReference::kNone ? "no truth in the log"
                                                    : "no tick of the window has one";
}

// The text of an event may hold tables of a drive file.
std::string one_line(std::string text) {
  while (text.ends_with('\n')) text.pop_back();
  std::replace(text.begin(), text.end(), '\n', ' ');
  return text;
}

// Events of the loop can occur at every tick; their texts differ at most by the tick.
bool is_tick_event(Reason reason) {
  return reason >= Reason::kEstimateNotFinite && reason <= Reason::kCommandLost;
}
// "refused requests without a valid tag: 12", "tick began 310 us late: it was woken late"
std::string without_count(const EventRecord& event) {
  const auto reason = static_cast<Reason>(event.reason);
  std::string text = event.text;
  if (reason == Reason::kRequestRefused) text.erase(std::min(text.rfind(": "), text.size()));
  if (reason == Reason::kOverrun) {
    text.erase(std::min(text.find(" ("), text.size()));
    std::erase_if(text, [](unsigned char c) { return std::isdigit(c) != 0; });
  }
  return text;
}
bool same_event(const EventRecord& a, const EventRecord& b) {
  return a.reason == b.reason && a.role == b.role &&
         (is_tick_event(static_cast<Reason>(a.reason)) || without_count(a) == without_count(b));
}

// "tick began 310 us late: .."; 0 for another event.
int lateness_us(const EventRecord& event) {
  constexpr std::string_view kBefore = "tick began ";
  if (static_cast<Reason>(event.reason) != Reason::kOverrun || !event.text.starts_with(kBefore))
    return 0;
  return std::atoi(event.text.c_str() + kBefore.size());
}

// One line for each event that is not routine: the first occurrence, for each cause of late ticks the
// worst one, and the number of occurrences.
// `end_ns`: drive time of the run's end.
std::vector<std::string> notable_events(const RunLog& log, std::int64_t end_ns) {
  std::vector<std::pair<const EventRecord*, int>> seen;  // first occurrence, count
  for (const EventRecord& event : log.events) {
    const auto reason = static_cast<Reason>(event.reason);
    if (reason == Reason::kModeChange || reason == Reason::kLogRotated ||
        reason == Reason::kLearnt || reason == Reason::kStateChange ||
        reason == Reason::kGainEveryNth)
      continue;
    const auto earlier = std::find_if(seen.begin(), seen.end(),
                                      [&](const auto& s) { return same_event(*s.first, event); });
    if (earlier == seen.end()) {
      seen.emplace_back(&event, 1);
      continue;
    }
    ++earlier->second;
    if (lateness_us(event) > lateness_us(*earlier->first)) earlier->first = &event;
  }
  // An event can be logged before the tick it belongs to.
  std::stable_sort(seen.begin(), seen.end(),
                   [](const auto& a, const auto& b) { return a.first->t_ns < b.first->t_ns; });
  std::vector<std::string> lines;
  for (const auto& [event, count] : seen) {
    std::string often = count > 1 ? fmt::format("  ({} times)", count) : "";
    if (event->t_ns > end_ns) often += "  (not applied: the run ended before)";
    lines.push_back(fmt::format("{:.4f} s, {}: {}{}", 1e-9 * static_cast<double>(event->t_ns),
                                role_name(event->role), one_line(event->text), often));
  }
  return lines;
}

std::int64_t lost_in_total(const Summary& s) {
  std::int64_t lost = 0;
  for (const auto& [channel, count] : s.lost_messages) lost += count;
  return lost;
}

// The first cause of a bad end comes before any figure.
std::string verdict_of(const Summary& s) {
  if (s.trip) return "TRIPPED";
  if (!s.locked)
    return "NO VERDICT: " +
           (s.lost_why.empty() ? "no angle to compare the estimate with" : s.lost_why);
  const std::string word = speed_word(s);
  if (!*s.locked) return s.lost_at_s ? "LOST" : "NOT LOCKED: " + s.lost_why;
  return "LOCKED" + (word.empty() ? "" : ", " + word);
}

std::string speed_text(const Summary& s) {
  const std::string deviation =
      fmt::format("up to {:.1f} % below and {:.1f} % above a constant reference",
                  s.speed_dip_percent.value_or(0), s.speed_excess_percent.value_or(0));
  if (!s.speed_unevenness_percent) return deviation;
  return fmt::format("{}; {:.1f} % between least and greatest within a turn", deviation,
                     *s.speed_unevenness_percent);
}

std::string latency_text(const Percentiles& us) {
  return fmt::format("{:.0f}, {:.0f}, {:.0f} us (largest {:.0f})", us.p50, us.p99, us.p99_9,
                     us.max);
}

std::string link_text(const LinkFigures& link) {
  if (link.host.empty()) return fmt::format("no answer to {} requests", link.asked);
  return fmt::format(
      "{}: clock {:+.0f} us (error below {:.0f}); round trip p50, p99 {:.0f}, {:.0f} us, {} of {} "
      "lost; {} messages missed",
      link.host, 1e-3 * static_cast<double>(link.offset_ns),
      1e-3 * static_cast<double>(link.error_ns), link.round_trip_us.p50, link.round_trip_us.p99,
      link.lost, link.asked, link.missed);
}

Json to_json(const Percentiles& us) {
  return {{"p50", us.p50}, {"p99", us.p99}, {"p99_9", us.p99_9}, {"max", us.max}};
}

void print_row(const std::string& name, const std::string& text) {
  fmt::print("  {:<22} {}\n", name, text);
}

// Verdict, rates and errors of the estimate.
void print_figures(const DriveConfig& d, const Summary& s, const RunFacts& facts) {
  const auto row = print_row;
  fmt::print("\n{}: {}  ({})\n", d.name, verdict_of(s), facts.how);
  if (s.trip) row("trip", trip_text(*s.trip));
  if (!facts.ended.empty()) row("ended early", facts.ended);
  if (s.lost_at_s) row("lost", fmt::format("at {:.4f} s: {}", *s.lost_at_s, s.lost_why));
  if (const std::string word = speed_word(s); !word.empty()) row("speed", speed_text(s));
  row("drive time", fmt::format("{:.3f} s, {} steps; figures from {:.2f} s on", s.duration_s,
                                s.steps, s.window_from_s));
  row("rates",
      fmt::format("f_s {:.0f} Hz, f_b {:.1f} Hz (n = {}), policy {}{}", d.rates.f_s_Hz,
                  d.rates.f_b_Hz, d.rates.n, kGainPolicyNames[static_cast<int>(d.gain.policy)],
                  s.rates_requested ? " in the drive file; for requests see the events" : ""));
  if (d.locks_first())
    row("gain every tick",
        s.n_from_tick ? fmt::format("up to {:.4f} s, tick {}: the filter agrees with itself",
                                    static_cast<double>(*s.n_from_tick) * d.T_s(), *s.n_from_tick)
                      : "to the end: the filter did not agree with itself");
  row("angle error rms, max", angle_errors(s));
  if (s.speed_error_rms)
    row("speed error rms", fmt::format("{:.3f} rad/s mechanical", *s.speed_error_rms));
  if (s.P44_max) row("P44", fmt::format("{:.3f} to {:.3f} rad^2", *s.P44_min, *s.P44_max));
}

// Gains, messages, delays and the machine of the run.
void print_transport(const Summary& s, const RunFacts& facts, const HopLatencies& latency) {
  const auto row = print_row;
  row("gains used", std::to_string(s.gains_used));
  row("messages lost",
      fmt::format("{}{}  (sent again: {})", lost_in_total(s),
                  s.losses_counted ? "" : " within the log; the logger ended before its count",
                  facts.repeats));
  row("late", fmt::format("gains {}, commands {}, ticks {}", facts.late_gains, facts.late_commands,
                          facts.deadline_misses));
  if (s.stalls > 0)
    row("stalls", fmt::format("{}: the plant's clock stood for {:.4g} s in all, {:.3g} s at most",
                              s.stalls, s.stalled_s, s.longest_stall_s));
  if (!facts.scheduling.empty()) row("scheduling", facts.scheduling);
  if (latency.rounds > 0) row("round p50, p99, p99.9", latency_text(latency.round_us));
  for (const LinkFigures& link : facts.links)
    row(fmt::format("link to {}", role_name(static_cast<int>(link.role))), link_text(link));
  if (facts.refused > 0)
    row("messages refused",
        fmt::format("{}  (another session, no valid tag, or not of their tick)", facts.refused));
  if (!facts.tags_checked)
    row("messages", "not authenticated (bus.authenticate = false): anybody on the bus could steer");
}

void print_table(const std::string& directory, const DriveConfig& d, const Summary& s,
                 const RunFacts& facts, const HopLatencies& latency,
                 const std::vector<std::string>& events) {
  const auto row = print_row;
  print_figures(d, s, facts);
  print_transport(s, facts, latency);
  for (const std::string& event : events) row("event", event);
  row("speed of the run",
      fmt::format("{:.0f} steps/s ({:.2f} s wall)",
                  s.wall_s > 0 ? static_cast<double>(s.steps) / s.wall_s : 0, s.wall_s));
  row("written to", directory + (facts.not_written.empty() ? "  (open report.html)" : ""));
  if (!facts.not_written.empty()) row("could not be written", facts.not_written);
}

// What a controller learnt: one table of the controller of this drive and nothing else.
bool is_learnt_table(const EventRecord& event, const std::string& kind) {
  return static_cast<Reason>(event.reason) == Reason::kLearnt &&
         event.role == static_cast<int>(Role::kController) &&
         event.text.starts_with("\n[controller." + kind + ".") &&
         event.text.find("\n[", 1) == std::string::npos;
}

// "\n[table]".
std::string header_of(const EventRecord& learnt) {
  return learnt.text.substr(0, learnt.text.find(']') + 1);
}

// The resolved drive file with the last table that the controller learnt; empty without one. Last is
// the latest tick: an event can be recorded and sent again.
std::string learnt_config(const RunLog& log, const Config& config) {
  std::string resolved = config.resolved();
  const EventRecord* last = nullptr;
  std::size_t begin = 0;
  for (const EventRecord& event : log.events) {
    if (!is_learnt_table(event, config.drive().controller.kind) || (last && event.k < last->k))
      continue;
    const auto found = resolved.find(header_of(event));
    if (found == std::string::npos) continue;
    last = &event;
    begin = found;
  }
  if (!last) return "";
  const auto end = resolved.find("\n[", begin + header_of(*last).size());
  resolved.replace(begin, end == std::string::npos ? end : end - begin, last->text);
  return resolved;
}

// Empty if the run ended early and left no readable log.
LongLog read_log(const std::string& directory, const DriveConfig& drive, RunFacts& facts) {
  const OnDamage on_damage = facts.ended.empty() ? OnDamage::kRefuse : OnDamage::kSkip;
  try {
    if (is_long(directory)) {
      LongLog found = summarise_log(directory, drive, on_damage);
      found.log.path += fmt::format(" (curves: ticks {} to {})", found.first_k, found.last_k);
      return found;
    }
    LongLog found;
    if (facts.kept && facts.ended.empty()) {
      found = std::move(*facts.kept);
    } else {
      found.log = read_run_log(directory, "", on_damage);
      found.ticks = run_ticks(found.log);
    }
    found.summary = summarise(found.log, found.ticks, drive);
    found.begin_s = found.ticks.measured_from_s().value_or(0);
    return found;
  } catch (const BadInput&) {
    if (facts.ended.empty()) throw;
    return {};
  }
}

// Adds the counts of the processes and of the logger to the summary.
void add_process_counts(const RunFacts& facts, const Json& account, Summary& s) {
  s.wall_s = facts.wall_s;
  s.repeats = facts.repeats;
  s.deadline_misses = facts.deadline_misses;
  s.late_gains = std::max(s.late_gains, facts.late_gains);
  s.late_commands = facts.late_commands;
  s.losses_counted = !facts.on_bus || account.is_object();
  // The account of a logger that was started again does not hold what was lost before it.
  for (const auto& [channel, count] : lost_messages(account))
    s.lost_messages[channel] = std::max(s.lost_messages[channel], count);
}

// The stalls of a realtime plant, as its last event that counts them has it.
void add_stalls(const RunLog& log, Summary& s) {
  for (const EventRecord& event : log.events) {
    if (event.role != static_cast<int>(Role::kPlant) ||
        static_cast<Reason>(event.reason) != Reason::kOverrun)
      continue;
    const auto count = stall_count_in(event.text);
    if (!count || count->stalls < s.stalls) continue;
    s.stalls = count->stalls;
    s.stalled_s = count->stood_s;
    s.longest_stall_s = count->longest_s;
  }
}

// The manifest of the log with the facts of the run.
Json manifest_of(const RunLog& log, const RunFacts& facts, const HopLatencies& latency,
                 const Json& account) {
  Json manifest = Json::parse(log.manifest_json, nullptr, false);
  if (!manifest.is_object()) manifest = Json::object();
  manifest["how"] = facts.how;
  if (!remembered_command().empty()) manifest["command"] = remembered_command();
  if (!facts.ended.empty()) manifest["ended_early"] = facts.ended;
  if (!facts.tags_checked) manifest["authenticated"] = false;
  if (!facts.scheduling.empty()) manifest["scheduling"] = facts.scheduling;
  if (facts.refused > 0) manifest["refused_messages"] = facts.refused;
  if (account.is_object()) manifest["log"] = account;
  if (latency.rounds > 0)
    manifest["latency_us"] = {{"rounds", latency.rounds},
                              {"to_estimate", to_json(latency.to_estimate_us)},
                              {"to_command", to_json(latency.to_command_us)},
                              {"round", to_json(latency.round_us)}};
  for (const LinkFigures& link : facts.links)
    manifest["links"][role_name(static_cast<int>(link.role))] = {
        {"host", link.host},
        {"clock_offset_us", 1e-3 * static_cast<double>(link.offset_ns)},
        {"clock_offset_error_us", 1e-3 * static_cast<double>(link.error_ns)},
        {"round_trip_us", to_json(link.round_trip_us)},
        {"round_trips", link.asked},
        {"round_trips_lost", link.lost},
        {"messages_missed", link.missed}};
  if (!log.damage.empty()) manifest["log_damage"] = log.damage;
  for (const ChannelInfo& c : kChannels)
    manifest["logged"][c.name] = log.counts[static_cast<std::size_t>(c.channel)];
  return manifest;
}

ClockOffsets offsets_of(const std::vector<LinkFigures>& links) {
  ClockOffsets clocks;
  for (const LinkFigures& link : links) {
    if (link.role == Role::kPlant) clocks.plant_ns = link.offset_ns;
    if (link.role == Role::kEstimator) clocks.estimator_ns = link.offset_ns;
    if (link.role == Role::kController) clocks.controller_ns = link.offset_ns;
  }
  return clocks;
}

// A trip for want of commands names the process that was waited for, where one took longer than a period.
void add_cause(const std::string& directory, const Config& config, const RunFacts& facts,
               std::optional<Trip>& trip) {
  if (!facts.realtime || !trip || trip->reason != static_cast<int>(Reason::kCommandLost)) return;
  const auto slow = slowest_answer(directory, trip->k, offsets_of(facts.links));
  if (slow && slow->ms > 1e3 * config.drive().T_s()) trip->text += "; " + text_of(*slow);
}

// Writes the files of the result; returns the names of those that cannot be written.
std::string write_results(const fs::path& dir, const LongLog& found, const Config& config,
                          const Summary& s, const RunFacts& facts, const Json& manifest) {
  Summary shown = s;
  shown.window_from_s = window_of_part(found);
  const RunLog& log = found.log;
  std::string not_written;
  const auto put = [&](const char* name, const auto& write) {
    try {
      write((dir / name).string());
    } catch (const std::runtime_error&) {
      not_written += (not_written.empty() ? "" : ", ") + std::string(name);
    }
  };
  put("summary.json",
      [&](const std::string& path) { write_new(path, to_json(s, config.drive()) + "\n"); });
  put("manifest.json", [&](const std::string& path) { write_new(path, manifest.dump(2) + "\n"); });
  // Without tags anybody on the bus could have sent it.
  if (const std::string learnt = learnt_config(log, config); !learnt.empty()) {
    if (facts.tags_checked)
      put("learnt.toml", [&](const std::string& path) { write_new(path, learnt); });
    else
      fmt::print(
          stderr,
          "twinrate: learnt.toml is not written: with bus.authenticate = false anybody could "
          "have sent what was learnt\n");
  }
  put("report.html", [&](const std::string& path) {
    write_report({{log, found.ticks, config.drive(), shown, manifest.dump()}},
                 {.title = config.drive().name}, path);
  });
  return not_written;
}

// One component of a path: the name of a drive is any text.
std::string as_file_name(const std::string& name) {
  constexpr std::size_t kMaxBytes = 200;  // NAME_MAX is 255; date and number follow
  std::string file = name.empty() ? "drive" : name.substr(0, kMaxBytes);
  for (char& c : file)
    if (std::isalnum(static_cast<unsigned char>(c)) == 0 && c != '-' && c != '.') c = '_';
  return file;
}

}  // namespace

std::unique_ptr<ResultDirectory> make_run_directory(const std::string& wanted, const Config& config,
                                                    bool force) {
  fs::path path = wanted;
  if (wanted.empty()) {
    const std::time_t now = std::time(nullptr);
    char stamp[32];
    std::strftime(stamp, sizeof stamp, "%Y%m%d-%H%M%S", std::localtime(&now));
    const std::string name = as_file_name(config.drive().name);
    for (int copy = 0; path.empty() || name_is_taken(path.string()); ++copy)
      path = fs::path("runs") /
             fmt::format("{}-{}{}", name, stamp, copy ? fmt::format("-{}", copy) : "");
  }
  auto directory = std::make_unique<ResultDirectory>(path.string(), ResultKind::kRun, force);
  directory->begin();
  write_new((path / "config.toml").string(), config.resolved());
  return directory;
}

int conclude_run(const std::string& directory, const Config& config, RunFacts facts) {
  const fs::path dir = directory;
  const LongLog found = read_log(directory, config.drive(), facts);
  const RunLog& log = found.log;
  if (!found.ticks.measured_from_s()) return 1;
  Summary s = found.summary;
  const std::int64_t reached = std::llround(s.duration_s / config.drive().T_s());
  if (facts.ended.empty() && reached < config.drive().steps() && !is_endless(config.drive()))
    facts.ended = fmt::format("stopped at tick {} of {}", reached, config.drive().steps());
  const Json account = read_json(dir / "logger.json");
  add_process_counts(facts, account, s);
  if (facts.realtime) add_stalls(log, s);
  std::error_code ignored;
  fs::remove(dir / "logger.json", ignored);
  add_cause(directory, config, facts, s.trip);
  const HopLatencies latency =
      facts.realtime ? hop_latencies(directory, offsets_of(facts.links)) : HopLatencies{};
  facts.not_written =
      write_results(dir, found, config, s, facts, manifest_of(log, facts, latency, account));
  if (!facts.quiet)
    print_table(directory, config.drive(), s, facts, latency,
                notable_events(log, config.drive().t_ns(reached + 1)));
  const bool well = s.locked.value_or(true) && lost_in_total(s) == 0 && facts.ended.empty() &&
                    facts.not_written.empty();
  return well ? 0 : 1;
}

}  // namespace twinrate
