#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <tuple>

#include "core/channels.hpp"
#include "core/reason.hpp"
#include "core/steering.hpp"
#include "report/parts.hpp"

namespace twinrate::report {
namespace {

bool is_change_of_the_model(const EventRecord& event) {
  return event.reason == static_cast<int>(Reason::kEffectAdded) ||
         event.reason == static_cast<int>(Reason::kEffectRemoved);
}

std::string reading(const std::optional<double>& figure, const char* unit) {
  return figure && std::isfinite(*figure) ? fmt::format("{:.4g} {}", *figure, unit) : "-";
}

// The speed after the loss.
std::string aftermath(const RunView& view) {
  const double lost_s = view.run.summary.lost_at_s.value_or(view.end_s());
  double direction = 0;
  for (const TickRow& row : view.rows) {
    const double omega_m = view.omega_m(row);
    if (!std::isfinite(omega_m)) continue;
    if (row.t_s <= lost_s) {
      if (row.command && row.command->omega_m_ref != 0)
        direction = row.command->omega_m_ref > 0 ? 1 : -1;
    } else if (direction * omega_m < 0) {
      return fmt::format(" The speed crossed zero at t = {:.3f} s and ended at {:.4g} rad/s.",
                         row.t_s, view.omega_m(view.rows.back()));
    }
  }
  return "";
}

std::string losses(const Summary& summary) {
  std::string lost;
  for (const auto& [channel, count] : summary.lost_messages)
    if (count > 0) lost += fmt::format("{}{} on {}", lost.empty() ? "" : ", ", count, channel);
  if (!lost.empty()) return "Lost messages: " + lost + ".";
  return summary.losses_counted ? "No message was lost."
                                : "The log has no gap in its messages; no logger counted those of "
                                  "the whole run.";
}

std::string errors(const RunView& view) {
  const Summary& s = view.run.summary;
  std::string text;
  if (s.angle_error_rms)
    text += fmt::format(
        " From {:.4g} s to {:.4g} s the estimated electrical angle is {} deg rms and at most {} "
        "deg "
        "from the {} one.",
        view.settled_s(), view.end_s(), degrees(s.angle_error_rms), degrees(s.angle_error_max),
        view.reference_word());
  if (s.speed_error_rms)
    text += fmt::format(" The speed estimate is {:.3g} rad/s rms from the {} speed.",
                        *s.speed_error_rms, view.has_truth() ? "true" : "measured");
  return text;
}

template <class Table, class Code>
std::string name_in(const Table& table, Code code) {
  return code >= 0 && code < static_cast<Code>(std::size(table)) ? table[code]
                                                                 : fmt::format("{}", code);
}

std::string name_of_reason(int code) {
  const char* name = reason_name(code);
  return name ? name : fmt::format("{}", code);
}

// {state, headline} of a run with a verdict.
std::pair<std::string, std::string> judged(const RunView& view) {
  const Summary& s = view.run.summary;
  if (s.trip) return {"lost", "Tripped: " + trip_text(*s.trip)};
  if (!*s.locked && !s.lost_at_s) return {"lost", "Not locked: " + s.lost_why};
  if (!*s.locked)
    return {"lost", fmt::format("Lost at t = {:.4g} s: {}", s.lost_at_s.value_or(0), s.lost_why)};
  const std::string word = speed_word(s);
  if (word.empty()) return {"locked", "Locked"};
  std::string text =
      fmt::format("Locked, {}: the speed was up to {:.3g} % below and {:.3g} % above its reference",
                  word, s.speed_dip_percent.value_or(0), s.speed_excess_percent.value_or(0));
  if (s.speed_unevenness_percent)
    text += fmt::format(", {:.3g} % between least and greatest within a turn",
                        *s.speed_unevenness_percent);
  return {"locked", text + "; synchronism is kept"};
}

}  // namespace

std::string frequency(double f_Hz) {
  return f_Hz >= 1000 ? fmt::format("{:.4g} kHz", f_Hz / 1000) : fmt::format("{:.4g} Hz", f_Hz);
}

std::string degrees(const std::optional<double>& angle_rad) {
  if (!angle_rad || !std::isfinite(*angle_rad)) return "-";
  const double angle_deg = *angle_rad * kDegrees;
  return angle_deg < 1e-6 ? "0" : fmt::format("{:.3g}", angle_deg);
}

static std::string of_drive_file(const Summary& summary) {
  return summary.rates_requested ? " in the drive file; for requests see the events" : "";
}

std::string rates(const RunView& view) {
  const DriveConfig& config = view.run.config;
  const double f_s = config.rates.f_s_Hz;
  const int n = config.rates.n;
  const char* policy = kGainPolicyNames[static_cast<int>(config.gain.policy)];
  const std::string from = of_drive_file(view.run.summary);
  if (n == 1) return fmt::format("f_s = f_b = {}, gain policy {}{}", frequency(f_s), policy, from);
  return fmt::format("f_s = {}, f_b = f_s/{} = {}, gain policy {}{}", frequency(f_s), n,
                     frequency(f_s / n), policy, from);
}

Json verdict(const RunView& view) {
  const Summary& s = view.run.summary;
  std::string state = "unknown", headline = "No verdict: no independent angle for comparison";
  if (view.rows.empty()) headline = "No verdict: the log is empty";
  if (!s.locked && !s.lost_why.empty()) headline = "No verdict: " + s.lost_why;
  if (s.locked) std::tie(state, headline) = judged(view);
  std::string text = fmt::format("{}: {}.", view.run.config.estimator.kind, rates(view));
  text += errors(view);
  if (view.lost()) text += aftermath(view);
  text += " " + losses(s);
  if (s.gains_used > 0) text += fmt::format(" The fast loop ran on {} gains.", s.gains_used);
  return {{"state", state}, {"headline", headline}, {"text", text}};
}

// Saving of a salient machine against i_d = 0 at the same mean torque, over the settled window;
// empty without saliency or torque.
static std::string saved_against_no_i_d(const RunView& view) {
  const MachineParameters& machine = view.run.config.machine;
  double torque = 0, square = 0, ticks = 0;
  for (const TickRow& row : view.rows) {
    if (row.t_s < view.settled_s() || (!row.truth && !row.estimate)) continue;
    const Vec2 i_dq = row.truth ? row.truth->i_dq : row.estimate->i_dq;
    torque += machine.torque(i_dq[0], i_dq[1]);
    square += i_dq.squaredNorm();
    ++ticks;
  }
  const double i_q_alone = torque / ticks / machine.torque_constant();
  const double ratio = std::sqrt(square / ticks) / std::abs(i_q_alone);
  if (!(ratio < 0.999)) return "";
  return fmt::format("current -{:.1f} %, copper loss -{:.1f} %", 100 * (1 - ratio),
                     100 * (1 - ratio * ratio));
}

// Rows of the verdict and of the errors.
static void add_errors(const RunView& view, Json& rows) {
  const Summary& s = view.run.summary;
  const auto add = [&](const char* quantity, const std::string& value) {
    rows.push_back({quantity, value});
  };
  add("locked", s.locked ? (*s.locked ? "yes" : "no") : "-");
  if (s.trip) add("trip", trip_text(*s.trip));
  if (s.speed_held)
    add("speed held", *s.speed_held ? "yes" : "no, " + (s.trip ? "tripped" : speed_word(s)));
  if (s.lost_at_s) add("lost at", reading(s.lost_at_s, "s"));
  add("angle error, rms", degrees(s.angle_error_rms) + " deg");
  add("angle error, largest", degrees(s.angle_error_max) + " deg");
  add("angle reference", kAngleReferenceNames[static_cast<int>(view.reference)]);
  add("speed error, rms", reading(s.speed_error_rms, "rad/s"));
  if (s.speed_dip_percent) add("speed below its reference", reading(s.speed_dip_percent, "%"));
  if (s.speed_excess_percent)
    add("speed above its reference", reading(s.speed_excess_percent, "%"));
  if (s.speed_unevenness_percent) add("speed unevenness", reading(s.speed_unevenness_percent, "%"));
  add("speed ripple, rms", reading(s.speed_ripple_rms, "rad/s"));
  add("speed ripple, orders 1-60", reading(s.speed_ripple_harmonics_rms, "rad/s"));
  if (s.P44_min && s.P44_max)
    add("P44", fmt::format("{:.3g} .. {:.3g} rad²", *s.P44_min, *s.P44_max));
  if (const std::string saved = saved_against_no_i_d(view); !saved.empty())
    add("against i_d = 0", saved);
}

// Rows of rates, window and messages.
static void add_run(const RunView& view, Json& rows) {
  const Summary& s = view.run.summary;
  const DriveConfig& config = view.run.config;
  const auto add = [&](const char* quantity, const std::string& value) {
    rows.push_back({quantity, value});
  };
  add("f_s", frequency(config.rates.f_s_Hz));
  add("f_b", fmt::format("{} (n = {}){}", frequency(config.rates.f_s_Hz / config.rates.n),
                         config.rates.n, of_drive_file(s)));
  add("gain policy", kGainPolicyNames[static_cast<int>(config.gain.policy)] + of_drive_file(s));
  add("gains used", std::to_string(s.gains_used));
  add("window", fmt::format("{:.4g} .. {:.4g} s", view.settled_s(), view.end_s()));
  add("duration", fmt::format("{:.4g} s, {} steps", s.duration_s, s.steps));
  if (s.wall_s > 0)
    add("wall time",
        fmt::format("{:.3g} s, {:.0f} steps/s", s.wall_s, static_cast<double>(s.steps) / s.wall_s));
  std::int64_t lost = 0;
  for (const auto& [channel, count] : s.lost_messages) lost += count;
  add("lost messages", fmt::format("{}{}", lost, s.losses_counted ? "" : " within the log"));
  add("repeats", std::to_string(s.repeats));
  add("late gains", std::to_string(s.late_gains));
  add("late commands", std::to_string(s.late_commands));
  add("deadline misses", std::to_string(s.deadline_misses));
  if (s.stalls > 0)
    add("stalls", fmt::format("{}, {:.4g} s in all, {:.3g} s at most", s.stalls, s.stalled_s,
                              s.longest_stall_s));
}

Json summary_table(const RunView& view) {
  Json rows = Json::array();
  add_errors(view, rows);
  add_run(view, rows);
  for (const Json& row : transport_rows(view.run.manifest_json)) rows.push_back(row);
  return rows;
}

Json event_table(const RunLog& log) {
  constexpr std::size_t kMaxEvents = 500;
  const auto counted = log.counts[static_cast<std::size_t>(Channel::kEvent)];
  const std::int64_t last_k = log.measurement.empty() ? -1 : log.measurement.back().k;
  const std::vector<AppliedSteering> requests = steering_in(log);
  std::size_t request = 0;
  Json rows = Json::array();
  for (const EventRecord& event : log.events) {
    if (rows.size() == kMaxEvents) break;
    std::string why;
    if (event.reason == static_cast<int>(Reason::kSteered))
      why = why_not_applied(requests, request++, last_k);
    else if (is_change_of_the_model(event) && event.k > last_k)
      why = "not applied: the run ended before";
    rows.push_back(
        {event.k < 0 ? "-" : fmt::format("{:.4f}", static_cast<double>(event.t_ns) * 1e-9),
         name_in(kRoleNames, event.role), name_of_reason(event.reason),
         why.empty() ? event.text : fmt::format("{} ({})", event.text, why)});
  }
  const auto shown = static_cast<std::int64_t>(rows.size());
  const auto all = std::max<std::int64_t>(counted, static_cast<std::int64_t>(log.events.size()));
  const std::string log_name = std::filesystem::path(log.path).filename().string();
  if (all > shown)
    rows.push_back({"", "", "",
                    fmt::format("{} more events are not shown: {} holds all {}, in channel {}",
                                all - shown, log_name, all, info(Channel::kEvent).name)});
  return rows;
}

}  // namespace twinrate::report
