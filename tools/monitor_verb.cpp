// twinrate monitor add: adds effects to the model of a running drive; remove: takes them out again.
//
//   no file   the effects proposed by twinrate-monitor (add)
//   FILE      the [[effect]] tables of a file, sent to estimator, gain and controller
#include <fmt/format.h>

#include <fstream>
#include <iterator>
#include <map>
#include <set>

#include "core/authority.hpp"
#include "core/message_tag.hpp"
#include "core/process.hpp"
#include "core/seconds_since.hpp"
#include "tools/verb.hpp"

namespace twinrate {
namespace {

using Clock = std::chrono::steady_clock;

struct MonitorOptions {
  std::string file, url, channel_suffix, run_dir;
  std::int64_t tick = 0;
  bool remove = false;
};

constexpr double kTimeout_s = 3, kRepeat_s = 0.1;
constexpr double kStart_s = 10;  // a starting set answers once all its processes run

request_t request_of(const MonitorOptions& o) {
  request_t request{};
  request.seq = new_session_id();  // unique
  request.kind = static_cast<std::int32_t>(o.file.empty() ? RequestKind::kAddProposed
                                           : o.remove     ? RequestKind::kRemoveEffect
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
bool wait_for_heartbeat(Bus& bus, double limit_s) {
  bool received = false;
  bus.subscribe<status_t>([&](const status_t&) { received = true; });
  const auto begun = Clock::now();
  while (!received && seconds_since(begun) < limit_s) bus.handle(20);
  return received;
}

// The processes name the source of the text DRIVE_REQUEST; replaced by the file's name.
std::string with_file_name(const std::string& refusal, const std::string& file) {
  const std::string source = std::string(kEffectsSource) + ":";
  return refusal.starts_with(source) ? file + refusal.substr(source.size() - 1) : refusal;
}

// Others take part in the choice of the tick.
bool has_model(int role) {
  return role == static_cast<int>(Role::kEstimator) || role == static_cast<int>(Role::kGain) ||
         role == static_cast<int>(Role::kController);
}

// A launched set asks for its token: of the given run directory, or of the set that runs below runs/.
std::string token_file(const MonitorOptions& o) {
  if (!o.run_dir.empty()) return o.run_dir + "/" + kTokenFile;
  try {
    const RunningSet set = find_running_set("");
    const bool same = (o.url.empty() || o.url == set.url) && o.channel_suffix == set.channel_suffix;
    return same ? set.directory + "/" + kTokenFile : "";
  } catch (const BadInput&) {  // processes that were started by hand need none
    return "";
  }
}

// The replies of the processes to a request.
class Replies {
 public:
  Replies(const MonitorOptions& o, std::int64_t seq) : o_(o), seq_(seq) {}

  void take(const reply_t& reply) {
    if (reply.seq != seq_) return;
    const bool agreed = reply.accepted != 0 && reply.applied_seq < 0;  // the tick comes later
    if (!o_.file.empty() && (agreed || !has_model(reply.role))) {
      if (reply.accepted == 0) refused_by_plant_ = with_file_name(reply.text, o_.file);
      return;
    }
    if (!answered_.insert(reply.role).second) return;
    if (reply.accepted == 0) {
      std::string& roles = refused_by_[with_file_name(reply.text, o_.file)];
      roles += (roles.empty() ? "" : ", ") + std::string(role_name(reply.role));
      return;
    }
    const std::string from = fmt::format("from tick {} on", reply.applied_seq);
    fmt::print("{}: {}\n", role_name(reply.role), o_.file.empty() ? "will be added" : from);
  }

  bool all() const { return answered_.size() >= (o_.file.empty() ? 1 : 3); }
  // The plant alone replied, with a refusal: no other process will reply.
  bool refused_by_plant_alone() const { return !refused_by_plant_.empty() && answered_.empty(); }

  // Prints the process that refused, or that nobody replied; returns the exit code.
  int conclude() {
    if (refused_by_.empty() && !refused_by_plant_.empty())
      refused_by_[refused_by_plant_] = role_name(static_cast<int>(Role::kPlant));
    if (answered_.empty() && refused_by_.empty())
      fmt::print(
          stderr, "twinrate: no process answered{}\n",
          o_.run_dir.empty() ? "; a launched set asks for its token: give its --run-dir" : "");
    for (const auto& [why, roles] : refused_by_)
      fmt::print(stderr, "twinrate: {} (refused by {})\n", why, roles);
    if (!refused_by_.empty()) return o_.file.empty() ? 1 : 2;
    return answered_.empty() ? 1 : 0;
  }

 private:
  const MonitorOptions& o_;
  std::int64_t seq_;
  std::set<int> answered_;
  std::map<std::string, std::string> refused_by_;  // refusal -> processes
  std::string refused_by_plant_;  // the plant chooses the tick and asks the other processes
};

int change(const MonitorOptions& o) {
  const request_t request = request_of(o);
  const std::string token = token_file(o);
  Bus bus({.url = o.url,
           .channel_suffix = o.channel_suffix,
           .role = Role::kSupervisor,
           .token_file = token});
  Replies replies(o, request.seq);
  bus.subscribe<reply_t>([&](const reply_t& reply) { replies.take(reply); });
  if (!wait_for_heartbeat(bus, token.empty() ? kTimeout_s : kStart_s)) {
    fmt::print(stderr, "twinrate: no drive on the bus\n");
    return 1;
  }
  const auto begun = Clock::now();
  while (!replies.all() && !replies.refused_by_plant_alone() && seconds_since(begun) < kStart_s) {
    bus.publish(request);  // a process that has it repeats its answer
    const auto sent = Clock::now();
    while (!replies.all() && seconds_since(sent) < kRepeat_s) bus.handle(20);
  }
  return replies.conclude();
}

}  // namespace

void add_monitor_verb(CLI::App& app, int& exit_code) {
  CLI::App* verb =
      app.add_subcommand("monitor", "Add effects to the model of a running drive, or remove them");
  verb->require_subcommand(1);
  const auto add_one = [&](const char* name, const char* help, bool remove) {
    auto o = std::make_shared<MonitorOptions>();
    o->remove = remove;
    CLI::App* sub = verb->add_subcommand(name, help);
    CLI::Option* file = sub->add_option("FILE", o->file,
                                        remove ? "remove the [[effect]] tables of this file"
                                               : "add the [[effect]] tables of this file");
    file->check(CLI::ExistingFile)->required(remove);
    sub->add_option("--tick", o->tick, "apply FILE at this tick (default: the next one)")
        ->check(zero_or_more());
    sub->add_option("--lcm-url", o->url, "use this LCM URL");
    sub->add_option("--run-dir", o->run_dir,
                    "take the token of the launch that runs in this directory");
    sub->add_option("--channel-suffix", o->channel_suffix,
                    "append this text to every channel name");
    sub->callback([o, &exit_code] { exit_code = change(*o); });
  };
  add_one("add",
          "Add the effects that the monitor proposed, or those of FILE, to the running estimator, "
          "gain and controller",
          false);
  add_one("remove",
          "Remove the effects of FILE, as they were added, from the running estimator, gain and "
          "controller",
          true);
}

}  // namespace twinrate
