// Somebody else on the bus of a launched set: what the drive does, as rows of bench/faults.
//
// The sender hears the bus, so its messages have the right session. "Without the token" it is anybody
// who reaches the bus; "with the token" a process that may read the run directory, whose messages
// have a valid tag. At a random tick it sends one message:
//
//   second COMMAND       COMMAND(k) once more, with another voltage, as soon as it is heard
//   future tick          MEASUREMENT, ESTIMATE, REFERENCE or COMMAND of a later tick, with other
//                        values: 300 to 3,000 ticks in realtime, 5,000 to 15,000 in lock-step, which
//                        is faster and where some are beyond the end of the run
//   GAIN                 GAIN(k) once more with a P that is not positive, with other sizes or not finite;
//                        the next one of a future tick, or an older one. From a second sender with the
//                        token, and in a set that takes messages without a tag, where the estimator
//                        itself must refuse what is not plausible
//   request              add effect or a retune; without the token, or the same three times; and a phase of
//                        a request, which only the plant may send, with the token
//
//   detected after   from the tick heard last to the event that names the fault, in ticks
//   as expected      the run ends locked with exit code 0, the message is counted as refused and,
//                    where the row says so, named by an event; in lock-step every message of every
//                    tick is that of the undisturbed run, bit for bit (but with an effect that was
//                    added), and in realtime no estimate is missing
//
// A trial in realtime that the drive tripped for another reason than the message is counted apart.
#include <fcntl.h>
#include <sched.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>

#include "bench/child.hpp"
#include "bench/faults.hpp"
#include "bench/log_digest.hpp"
#include "core/authority.hpp"
#include "core/bus.hpp"
#include "core/reason.hpp"
#include "core/run_log.hpp"
#include "core/seconds_since.hpp"

namespace twinrate::faults {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

enum class Message {
  kSecondCommand,
  kCommand,
  kMeasurement,
  kEstimate,
  kReference,
  kGain,
  kRequest
};
enum class Spoilt { kAsItIs, kNegative, kSizes, kNan, kFuture, kOld };  // a GAIN

struct Asked {
  RequestKind kind = RequestKind::kAddEffect;
  const char* text = "";
  bool changes = false;  // the drive
};

struct MessageRow {
  const char* what;
  Message message;
  bool with_token;
  int times;        // that it is sent
  Reason names_it;  // kNone: counted, no event
  Spoilt spoilt = Spoilt::kAsItIs;
  bool open = false;  // bus.authenticate = false
  Asked asked = {};
};
constexpr const char* kEffect =
    "[[effect]]\nkind = \"coulomb_friction\"\ntorque_Nm = 0.0001\nused_in = \"model\"\n";

const std::vector<MessageRow> kMessageRows = {
    {"second COMMAND of a tick, without the token", Message::kSecondCommand, false, 1,
     Reason::kNone},
    {"second COMMAND of a tick, with the token", Message::kSecondCommand, true, 1,
     Reason::kSecondSender},
    {"COMMAND of a future tick, without the token", Message::kCommand, false, 1, Reason::kNone},
    {"COMMAND of a future tick, with the token", Message::kCommand, true, 1, Reason::kNone},
    {"MEASUREMENT of a future tick, without the token", Message::kMeasurement, false, 1,
     Reason::kNone},
    {"MEASUREMENT of a future tick, with the token", Message::kMeasurement, true, 1, Reason::kNone},
    {"ESTIMATE of a future tick, without the token", Message::kEstimate, false, 1, Reason::kNone},
    {"ESTIMATE of a future tick, with the token", Message::kEstimate, true, 1, Reason::kNone},
    {"REFERENCE of a future tick, without the token", Message::kReference, false, 1, Reason::kNone},
    {"REFERENCE of a future tick, with the token", Message::kReference, true, 1, Reason::kNone},
    {"GAIN of a second sender, with the token", Message::kGain, true, 1, Reason::kSecondSender,
     Spoilt::kNegative},
    {"GAIN with P not positive, in a set without tags", Message::kGain, false, 1, Reason::kNone,
     Spoilt::kNegative, true},
    {"GAIN of other sizes, in a set without tags", Message::kGain, false, 1, Reason::kNone,
     Spoilt::kSizes, true},
    {"GAIN not finite, in a set without tags", Message::kGain, false, 1, Reason::kNone,
     Spoilt::kNan, true},
    {"GAIN of a future tick, in a set without tags", Message::kGain, false, 1, Reason::kNone,
     Spoilt::kFuture, true},
    {"GAIN older than the one in use, in a set without tags", Message::kGain, false, 1,
     Reason::kNone, Spoilt::kOld, true},
    {"retune, without the token",
     Message::kRequest,
     false,
     1,
     Reason::kRequestRefused,
     Spoilt::kAsItIs,
     false,
     {RequestKind::kSteer, "n=3"}},
    {"phase of a request, with the token",
     Message::kRequest,
     true,
     1,
     Reason::kRequestRefused,
     Spoilt::kAsItIs,
     false,
     {RequestKind::kPrepare, "n=3"}},
    {"add effect, without the token",
     Message::kRequest,
     false,
     1,
     Reason::kRequestRefused,
     Spoilt::kAsItIs,
     false,
     {RequestKind::kAddEffect, kEffect}},
    {"add effect, the same message three times",
     Message::kRequest,
     true,
     3,
     Reason::kRequestRefused,
     Spoilt::kAsItIs,
     false,
     {RequestKind::kAddEffect, kEffect, true}},
};
constexpr const char* kDuration = "3s";

pid_t launch(const Options& o, bool realtime, const fs::path& dir, const std::string& url,
             bool open = false) {
  std::vector<std::string> list = {o.twinrate,  "launch", o.drive,
                                   "--run-dir", dir,      "--duration",
                                   kDuration,   "--pace", realtime ? "realtime" : "lockstep",
                                   "--lcm-url", url};
  if (open) list.insert(list.end(), {"--set", "bus.authenticate=false"});
  return start(std::move(list), dir.string() + ".out", dir.string() + ".out");
}

// Hears the set and sends the message of the row once the drive has reached tick `k`. The tick heard
// then; -1: none.
class Sender {
 public:
  Sender(const MessageRow& row, const fs::path& dir, const std::string& url, std::int64_t ahead)
      : row_(row), ahead_(ahead) {
    const RunningSet set = find_running_set(dir.string());
    bus_.emplace(BusOptions{.url = url,
                            .session = set.session,
                            .role = Role::kReplay,
                            .token_file = row.with_token ? (dir / kTokenFile).string() : "",
                            .authenticate = false});
    bus_->subscribe<command_t>([this](const command_t& c) { take(Message::kSecondCommand, c); });
    bus_->subscribe<measurement_t>([this](const measurement_t& m) {
      take(Message::kMeasurement, m);
      if (row_.message == Message::kRequest) send_request(m.seq);
    });
    bus_->subscribe<estimate_t>([this](const estimate_t& e) { take(Message::kEstimate, e); });
    bus_->subscribe<gain_t>([this](const gain_t& g) { take(Message::kGain, g); });
    bus_->subscribe<reference_t>([this](const reference_t& r) { take(Message::kReference, r); });
  }
  std::int64_t send_at(std::int64_t k, pid_t pid) {
    from_k_ = k;
    const auto begun = Clock::now();
    while (sent_k_ < 0 && seconds_since(begun) < 20 && kill(pid, 0) == 0) bus_->handle(5);
    return sent_k_;
  }

 private:
  template <class Lcm>
  void take(Message heard, Lcm message) {
    const bool second = row_.message == Message::kSecondCommand;
    const Message wanted =
        row_.message == Message::kCommand ? Message::kSecondCommand : row_.message;
    if (heard != wanted || sent_k_ >= 0 || message.seq < from_k_) return;
    sent_k_ = message.seq;
    if constexpr (std::is_same_v<Lcm, gain_t>)
      spoil_gain(message);
    else
      spoil(message);
    message.tag = 0;
    if (!second && heard != Message::kGain) message.seq += ahead_, message.t_ns += 200'000 * ahead_;
    bus_->publish(message);
  }
  static void spoil(command_t& c) { c.u_alpha_V += 3; }
  static void spoil(measurement_t& m) { m.i_a_A += 1; }
  static void spoil(estimate_t& e) { e.theta_e_rad += 1; }
  static void spoil(reference_t& r) { r.omega_m_ref_rad_s *= -1; }
  void spoil_gain(gain_t& g) const {
    constexpr std::int64_t kOldGains = 20;
    const std::int64_t n = g.first_use_seq - g.seq;  // policy paper
    const std::int64_t gains = row_.spoilt == Spoilt::kFuture ? ahead_
                               : row_.spoilt == Spoilt::kOld  ? -kOldGains
                                                              : 0;
    g.seq += n * gains;
    g.first_use_seq += n * gains;
    g.t_ns += 200'000 * n * gains;
    if (row_.spoilt == Spoilt::kNegative)
      for (double& p : g.P) p = -p;
    else if (row_.spoilt == Spoilt::kNan)
      g.K.front() = std::nan("");
    else
      for (double& k : g.K) k *= 2;
    if (row_.spoilt != Spoilt::kSizes) return;
    --g.n_x;
    g.n_K = g.n_x * g.n_y;
    g.n_P = g.n_x * g.n_x;
    g.K.resize(static_cast<std::size_t>(g.n_K));
    g.P.resize(static_cast<std::size_t>(g.n_P));
  }
  void send_request(std::int64_t k) {
    if (sent_k_ >= 0 || k < from_k_) return;
    sent_k_ = k;
    request_t request{};
    request.seq = 1'000'000;
    request.t_ns = 1;
    request.kind = static_cast<std::int32_t>(row_.asked.kind);
    request.text = row_.asked.text;
    if (row_.asked.kind == RequestKind::kPrepare)
      request.value = static_cast<double>(RequestKind::kSteer);
    for (int i = 0; i < row_.times; ++i) bus_->publish(request);
  }

  MessageRow row_;
  std::int64_t ahead_, from_k_ = 0, sent_k_ = -1;
  std::optional<Bus> bus_;
};

nlohmann::json json_of(const fs::path& path) {
  std::ifstream file(path);
  return nlohmann::json::parse(file, nullptr, false);
}

Trial judge(const MessageRow& row, bool realtime, const fs::path& dir, int exit_code,
            std::int64_t sent_k, const std::optional<LogDigest>& calm) {
  Trial result;
  result.lost = "nothing";
  const auto summary = json_of(dir / "summary.json"), manifest = json_of(dir / "manifest.json");
  if (sent_k < 0 || !summary.is_object() || !manifest.is_object()) {
    result.did = sent_k < 0 ? "the message was not sent" : "no summary";
    return result;
  }
  const RunLog log = read_run_log(dir.string(), "", OnDamage::kSkip);
  std::int64_t named = -1;
  int added = 0;
  for (const EventRecord& e : log.events) {
    if (e.reason == static_cast<int>(row.names_it) && row.names_it != Reason::kNone && named < 0)
      named = e.k;
    added += e.reason == static_cast<int>(Reason::kEffectAdded) &&
             e.role == static_cast<int>(Role::kEstimator);
  }
  result.detected = named >= 0;
  result.detected_after = static_cast<double>(std::max<std::int64_t>(0, named - sent_k));
  const bool changes = row.asked.changes;
  const bool counted = manifest.value("refused_messages", 0) > 0;
  const bool locked = summary["trip"].is_null() && summary.value("locked", false);
  const bool same = realtime || changes || (calm && digest_of(dir.string()) == *calm);
  const bool whole = log.estimate.size() == log.measurement.size();
  std::string wrong;
  const auto must = [&](bool holds, const std::string& text) {
    if (!holds) wrong += (wrong.empty() ? "" : ", ") + text;
  };
  must(summary["trip"].is_null(),
       summary["trip"].is_null() ? "" : "tripped: " + summary["trip"].value("name", ""));
  must(locked || !summary["trip"].is_null(), "lost the rotor");
  must(exit_code == 0, fmt::format("exit code {}", exit_code));
  must(counted || row.spoilt == Spoilt::kOld, "not counted");  // it may be one that is sent again
  must(row.names_it == Reason::kNone || named >= 0, "not named");
  must(same, "another log");
  must(whole,
       fmt::format("{} estimates missing", static_cast<std::int64_t>(log.measurement.size()) -
                                               static_cast<std::int64_t>(log.estimate.size())));
  must(added == (changes ? 1 : 0), fmt::format("effect added {} times", added));
  result.as_expected = wrong.empty();
  result.did = wrong.empty() ? changes ? "ran on, effect added once" : "ran on" : wrong;
  if (!locked) result.lost = "the run";
  return result;
}

int wait_for(pid_t pid) {
  const auto begun = Clock::now();
  int status = 0;
  while (waitpid(pid, &status, WNOHANG) == 0) {
    if (seconds_since(begun) > 60) kill(pid, SIGKILL);
    usleep(5000);
  }
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

// Until the session file is whole, or 20 s.
void wait_for_session(const fs::path& dir) {
  const auto begun = Clock::now();
  while (seconds_since(begun) < 20) {
    try {
      find_running_set(dir.string());
      return;
    } catch (const BadInput&) {
      usleep(1000);
    }
  }
}

Trial try_message(const Options& o, const MessageRow& row, bool realtime, std::size_t index,
                  int trial, const fs::path& scratch, const std::optional<LogDigest>& calm) {
  const fs::path dir = scratch / fmt::format("{}-{}-{}", realtime ? "rt" : "ls", index, trial);
  const std::string url = url_of_this_process();
  const pid_t pid = launch(o, realtime, dir, url, row.open);
  wait_for_session(dir);
  std::int64_t sent_k = -1;
  {
    const std::int64_t ahead = realtime ? 300 + draw(o, 300 + index, trial, 2700)
                                        : 5000 + draw(o, 300 + index, trial, 10000);
    Sender sender(row, dir, url, ahead);
    sent_k = sender.send_at(1000 + draw(o, 200 + index, trial, 8000), pid);
  }
  const int exit_code = wait_for(pid);
  Trial result = judge(row, realtime, dir, exit_code, sent_k, calm);
  std::error_code ignored;
  if (result.as_expected) fs::remove_all(dir, ignored);
  return result;
}

}  // namespace

bool run_message_rows(const Options& o) {
  char pattern[] = "/tmp/message-faults-XXXXXX";
  const fs::path scratch = mkdtemp(pattern);
  const sched_param normal{};
  sched_setscheduler(0, SCHED_OTHER, &normal);
  std::optional<LogDigest> calm;
  bool well = true;
  print_header(false);
  for (const bool realtime : {false, true}) {
    for (std::size_t row = 0; row < kMessageRows.size(); ++row) {
      const std::string name =
          fmt::format("{}, {}", kMessageRows[row].what, realtime ? "realtime" : "lock-step");
      if (name.find(o.only) == std::string::npos) continue;
      if (!realtime && !calm) {
        wait_for(launch(o, false, scratch / "calm", url_of_this_process()));
        calm = digest_of((scratch / "calm").string());
      }
      std::vector<Trial> trials;
      for (int trial = 0; trial < o.trials; ++trial) {
        trials.push_back(try_message(o, kMessageRows[row], realtime, row, trial, scratch, calm));
        well = well && trials.back().as_expected;
      }
      print_row(name, trials, "ticks", false);
    }
  }
  std::error_code ignored;
  if (well) fs::remove_all(scratch, ignored);
  return well;
}

}  // namespace twinrate::faults
