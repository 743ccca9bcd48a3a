// Requests to a running set, one after the other: how long each takes, and whether all processes
// applied it at one tick.
//
//   steering_requests RUN_DIR COUNT
//   steering_requests --log RUN_DIR      of a run that has ended: were all its requests common?
//
// Every answer on the bus is noted: a request counts as common if plant, estimator, gain, controller
// and logger named the same tick. bench/steering_rate starts the set and calls this program.
#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>
#include <vector>

#include "core/drive_hand.hpp"
#include "core/event_log.hpp"
#include "core/report_error.hpp"

namespace {

constexpr std::size_t kProcesses = 5;

double quantile(std::vector<double> values, double share) {
  std::sort(values.begin(), values.end());
  const auto last = static_cast<double>(values.size() - 1);
  return values[static_cast<std::size_t>(share * last)];
}

using Ticks = std::map<std::int64_t, std::map<int, std::int64_t>>;  // request -> role -> tick

int common_in(const Ticks& ticks) {
  int common = 0;
  for (const auto& [request, answers] : ticks) {
    std::set<std::int64_t> different;
    for (const auto& [role, k] : answers) different.insert(k);
    common += answers.size() == kProcesses && different.size() == 1;
  }
  return common;
}

int read_log(const std::string& directory) {
  using namespace twinrate;
  constexpr std::int64_t kOfTheSupervisor = 1000;  // its requests are counted from 0
  Ticks ticks;
  EventLog events(directory, OnDamage::kRefuse);
  while (const lcm::LogEvent* event = events.next()) {
    reply_t reply;
    if (events.channel() == Channel::kReply && reply.decode(event->data, 0, event->datalen) > 0 &&
        reply.seq > kOfTheSupervisor && reply.accepted != 0 && reply.applied_seq >= 0)
      ticks[reply.seq].emplace(reply.role, reply.applied_seq);
  }
  const int common = common_in(ticks);
  fmt::print("{} of {} requests in the log applied by {} processes at one common tick\n", common,
             ticks.size(), kProcesses);
  return common == static_cast<int>(ticks.size()) ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) try {
  using namespace twinrate;
  if (argc != 3) {
    fmt::print(stderr, "steering_requests RUN_DIR COUNT, or --log RUN_DIR\n");
    return 2;
  }
  if (argv[1] == std::string("--log")) return read_log(argv[2]);
  const RunningSet set = find_running_set(argv[1]);
  const int count = std::stoi(argv[2]);
  DriveHand hand(set);
  Ticks ticks;
  hand.bus().subscribe<reply_t>([&](const reply_t& reply) {
    if (reply.accepted != 0 && reply.applied_seq >= 0)
      ticks[reply.seq].emplace(reply.role, reply.applied_seq);
  });
  std::vector<double> waited_ms;
  for (int i = 0; i < count; ++i) {
    const HandAnswer answer = hand.steer(fmt::format("load_Nm={}\nomega_e_rad_s={}\nn={}",
                                                     1e-5 * (i % 100), 300 + i % 100, 1 + i % 8));
    if (!answer.accepted) {
      fmt::print("request {}: {}\n", i, answer.why);
      return 1;
    }
    waited_ms.push_back(1e3 * answer.waited_s);
  }
  const int common = common_in(ticks);
  fmt::print("{} of {} requests applied by {} processes at one common tick\n", common, count,
             kProcesses);
  fmt::print("from the request to the answer: p50 {:.2f} ms, p99 {:.2f} ms, max {:.2f} ms\n",
             quantile(waited_ms, 0.5), quantile(waited_ms, 0.99), quantile(waited_ms, 1));
  return common == count ? 0 : 1;
} catch (...) {
  return twinrate::report_error("steering_requests");
}
