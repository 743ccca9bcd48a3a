// twinrate monitor add: effects into the model of a running drive.
//
//   no file   what twinrate-monitor proposed is added
//   FILE      [[effect]] tables of one's own, straight to estimator, gain and controller
#include <fmt/format.h>

#include <fstream>
#include <iterator>
#include <map>
#include <set>

#include "core/process.hpp"
#include "tools/verb.hpp"

namespace twinrate {
namespace {

using Clock = std::chrono::steady_clock;

struct MonitorOptions {
  std::string file, url, channel_suffix;
  std::int64_t tick = 0;
};

constexpr double kPatience_s = 3, kRepeat_s = 0.1;

double seconds_since(Clock::time_point then) {
  return std::chrono::duration<double>(Clock::now() - then).count();
}

request_t request_of(const MonitorOptions& o) {
  request_t request{};
  request.seq = new_session_id();  // another one each time
  request.kind = static_cast<std::int32_t>(o.file.empty() ? RequestKind::kAddProposed
                                                          : RequestKind::kAddEffect);
  if (o.file.empty()) return request;
  std::ifstream in(o.file);
  if (!in) throw BadInput(o.file + ": cannot be read");
  request.text = {std::istreambuf_iterator<char>(in), {}};
  Config::check_addition(request.text, o.file);
  request.value = static_cast<double>(o.tick);
  return request;
}

// Waits for a heartbeat: the request must carry the session of the drive.
bool hear_session(Bus& bus) {
  bool heard = false;
  bus.subscribe<status_t>([&](const status_t&) { heard = true; });
  const auto begun = Clock::now();
  while (!heard && seconds_since(begun) < kPatience_s) bus.handle(20);
  return heard;
}

// The processes know the file's text as DRIVE_REQUEST.
std::string in_users_words(const std::string& refusal, const std::string& file) {
  const std::string theirs = std::string(kEffectsSource) + ":";
  return refusal.starts_with(theirs) ? file + refusal.substr(theirs.size() - 1) : refusal;
}

int add(const MonitorOptions& o) {
  const request_t request = request_of(o);
  Bus bus({.url = o.url, .channel_suffix = o.channel_suffix, .role = Role::kSupervisor});
  std::set<int> answered;
  std::map<std::string, std::string> refused_by;  // by what was said
  bus.subscribe<reply_t>([&](const reply_t& reply) {
    if (reply.seq != request.seq || !answered.insert(reply.role).second) return;
    if (reply.accepted == 0) {
      std::string& roles = refused_by[in_users_words(reply.text, o.file)];
      roles += (roles.empty() ? "" : ", ") + std::string(role_name(reply.role));
      return;
    }
    const std::string from = fmt::format("from tick {} on", reply.applied_seq);
    fmt::print("{}: {}\n", role_name(reply.role), o.file.empty() ? "will be added" : from);
  });
  if (!hear_session(bus)) {
    fmt::print(stderr, "twinrate: no drive on the bus\n");
    return 1;
  }
  const std::size_t wanted = o.file.empty() ? 1 : 3;
  const auto begun = Clock::now();
  while (answered.size() < wanted && seconds_since(begun) < kPatience_s) {
    bus.publish(request);  // whoever has it already gives the same answer
    const auto sent = Clock::now();
    while (answered.size() < wanted && seconds_since(sent) < kRepeat_s) bus.handle(20);
  }
  if (answered.empty()) fmt::print(stderr, "twinrate: no process answered\n");
  for (const auto& [why, roles] : refused_by)
    fmt::print(stderr, "twinrate: {} (refused by {})\n", why, roles);
  if (!refused_by.empty()) return o.file.empty() ? 1 : 2;
  return answered.empty() ? 1 : 0;
}

}  // namespace

void add_monitor_verb(CLI::App& app, int& exit_code) {
  auto o = std::make_shared<MonitorOptions>();
  CLI::App* verb = app.add_subcommand("monitor", "Extend the model of a running drive");
  verb->require_subcommand(1);
  CLI::App* sub = verb->add_subcommand(
      "add",
      "Add the effects that the monitor proposed, or those of FILE, to the running estimator, "
      "gain and controller");
  sub->add_option("FILE", o->file, "add the [[effect]] tables of this file")
      ->check(CLI::ExistingFile);
  sub->add_option("--tick", o->tick,
                  "add the effects of FILE at this tick (default: the next one)");
  sub->add_option("--lcm-url", o->url, "use this LCM URL");
  sub->add_option("--channel-suffix", o->channel_suffix, "append this text to every channel name");
  sub->callback([o, &exit_code] { exit_code = add(*o); });
}

}  // namespace twinrate
