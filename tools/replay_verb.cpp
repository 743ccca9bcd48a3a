// twinrate replay: a recorded log back to the processes.
//
//   --lockstep   plays MEASUREMENT(k), waits for ESTIMATE(k), compares it with the logged one bit
//   for bit
//   --speed X    plays by the log's time stamps, X times as fast (1 by default)
#include <fmt/format.h>
#include <time.h>

#include <optional>
#include <sstream>
#include <thread>

#include "core/machine_error.hpp"
#include "core/process.hpp"
#include "core/run_log.hpp"
#include "core/signals_io.hpp"
#include "loop/lcm_replay.hpp"
#include "loop/load_drive.hpp"
#include "tools/verb.hpp"

namespace twinrate {
namespace {

using Clock = std::chrono::steady_clock;

struct ReplayOptions {
  std::string log, url, channel_suffix, only = "MEASUREMENT,REFERENCE,TRUTH";
  double speed = 1;
  bool lockstep = false;
};

double seconds_since(Clock::time_point then) {
  return std::chrono::duration<double>(Clock::now() - then).count();
}

// Is an estimator alive on the bus, whatever its session?
bool estimator_heard(const ReplayOptions& o) {
  bool heard = false;
  Bus ears(
      {.url = o.url, .channel_suffix = o.channel_suffix, .follow = true, .role = Role::kReplay});
  ears.subscribe<status_t>([&](const status_t& s) {
    heard = heard || (s.role == static_cast<int>(Role::kEstimator) &&
                      s.state < static_cast<int>(ProcessState::kDone));
  });
  const auto begun = Clock::now();
  while (!heard && seconds_since(begun) < 0.5) ears.handle(20);
  return heard;
}

// The logged estimate of each tick, walked in step with the measurements.
class LoggedEstimates {
 public:
  explicit LoggedEstimates(const std::vector<Estimate>& estimates) : estimates_(estimates) {}
  const Estimate* at(std::int64_t k) {
    while (next_ < estimates_.size() && estimates_[next_].k < k) ++next_;
    return next_ < estimates_.size() && estimates_[next_].k == k ? &estimates_[next_] : nullptr;
  }

 private:
  const std::vector<Estimate>& estimates_;
  std::size_t next_ = 0;
};

class LockstepReplay {
 public:
  LockstepReplay(const RunLog& log, const ReplayOptions& o, const DriveConfig& drive)
      : log_(log), drive_(drive), logged_(log.estimate) {
    const std::int64_t session = new_session_id();
    if (!estimator_heard(o)) {
      fmt::print(
          "no estimator on the bus: starting estimator and gain with the log's own config\n");
      own_.emplace(log.config_toml, o.url, o.channel_suffix, session);
    }
    replay_.emplace(drive.bus, o.url, o.channel_suffix, session);
  }

  int run() {
    const auto begun = Clock::now();
    for (const Measurement& m : log_.measurement) {
      const std::optional<Estimate> answer = replay_->play(m);
      if (stop_signalled()) break;
      if (!answer) {
        fmt::print(stderr,
                   "twinrate: no ESTIMATE({}) from an estimator within {} s; one that runs already "
                   "must be {}\n",
                   m.k, drive_.bus.peer_timeout_s,
                   "unbound, and started with --follow to hear a second session");
        return 1;
      }
      compare(m.k, *answer);
    }
    fmt::print("replayed {} ticks in {:.2f} s, {} sent again\n", played_, seconds_since(begun),
               replay_->repeats());
    fmt::print("estimates: {} equal to the log bit for bit, {} different, {} not in the log\n",
               equal_, different_, played_ - equal_ - different_);
    if (different_ > 0) fmt::print("first difference at tick {}\n", first_difference_);
    return different_ > 0 ? 1 : 0;
  }

 private:
  void compare(std::int64_t k, const Estimate& answer) {
    ++played_;
    const Estimate* logged = logged_.at(k);
    if (!logged) return;
    if (same_bits(*logged, answer)) {
      ++equal_;
    } else if (different_++ == 0) {
      first_difference_ = k;
    }
  }

  const RunLog& log_;
  const DriveConfig& drive_;
  LoggedEstimates logged_;
  std::optional<OwnEstimator> own_;
  std::optional<LcmReplay> replay_;
  std::int64_t played_ = 0, equal_ = 0, different_ = 0, first_difference_ = -1;
};

std::vector<std::string> channel_list(const std::string& text) {
  std::vector<std::string> names;
  std::stringstream in(text);
  for (std::string name; std::getline(in, name, ',');) {
    if (name.rfind("DRIVE_", 0) != 0) name = "DRIVE_" + name;
    const bool known = std::any_of(kChannels.begin(), kChannels.end(),
                                   [&](const ChannelInfo& c) { return c.name == name; });
    if (!known) throw BadInput(fmt::format("--only {}: no such channel", name));
    names.push_back(name);
  }
  return names;
}

void sleep_until(Clock::time_point begun, double offset_s) {
  std::this_thread::sleep_until(
      begun + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(offset_s)));
}

std::string without_suffix(const std::string& channel, const std::string& suffix) {
  return channel.ends_with(suffix) ? channel.substr(0, channel.size() - suffix.size()) : channel;
}

// By time stamp; the bytes go out as they were recorded, session included.
int play_paced(const ReplayOptions& o, const std::string& logged_suffix) {
  const std::vector<std::string> names = channel_list(o.only);
  const Bus probe(
      {.url = o.url, .role = Role::kReplay});  // says at once where the machine has no multicast
  lcm::LCM out(probe.url());
  const auto begun = Clock::now();
  std::int64_t first_us = -1, played = 0;
  for (const std::string& part : log_parts(o.log)) {
    lcm::LogFile file(part, "r");
    if (!file.good() || !out.good()) throw BadInput(fmt::format("{}: cannot be played", part));
    while (const lcm::LogEvent* event = file.readNextEvent()) {
      if (stop_signalled()) break;
      const std::string name = without_suffix(event->channel, logged_suffix);
      if (std::find(names.begin(), names.end(), name) == names.end()) continue;
      if (first_us < 0) first_us = event->timestamp;
      sleep_until(begun, static_cast<double>(event->timestamp - first_us) * 1e-6 / o.speed);
      out.publish(name + o.channel_suffix, event->data, static_cast<unsigned>(event->datalen));
      ++played;
    }
  }
  fmt::print("played {} messages of {} in {:.2f} s\n", played, o.only, seconds_since(begun));
  return 0;
}

int replay(const ReplayOptions& o) {
  catch_stop_signals();
  resolve_url(o.url);
  check_channel_suffix(o.channel_suffix);
  const RunLog log = read_run_log(o.log);
  if (!o.lockstep) return play_paced(o, log.channel_suffix);
  if (log.config_toml.empty())
    throw BadInput(fmt::format("{}: no DRIVE_MANIFEST in this log; play it with --speed", o.log));
  Config config = Config::parse(log.config_toml, o.log + " (DRIVE_MANIFEST)");
  read_all_tables(config);
  return LockstepReplay(log, o, config.drive()).run();
}

}  // namespace

void add_replay_verb(CLI::App& app, int& exit_code) {
  auto o = std::make_shared<ReplayOptions>();
  CLI::App* verb = app.add_subcommand("replay", "play a log to the running processes");
  verb->add_option("LOG", o->log, "run directory or log file")->required();
  auto* speed = verb->add_option("--speed", o->speed, "times as fast as recorded")
                    ->check(CLI::Range(0.001, 1000.0));
  verb->add_flag("--lockstep", o->lockstep, "wait for each estimate and compare it with the log")
      ->excludes(speed);
  verb->add_option("--only", o->only,
                   "channels to play, comma separated (default MEASUREMENT,REFERENCE,TRUTH)");
  verb->add_option("--lcm-url", o->url, "LCM URL");
  verb->add_option("--channel-suffix", o->channel_suffix, "appended to every channel name");
  verb->callback([o, &exit_code] { exit_code = replay(*o); });
}

}  // namespace twinrate
