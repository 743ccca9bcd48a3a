// A request takes a drive from SAFE back to its run: plant, controller and estimator of a set.
#include <algorithm>
#include <map>
#include <set>

#include "core/bus.hpp"
#include "core/reason.hpp"
#include "core/run_log.hpp"
#include "tests/system/run_program.hpp"

namespace twinrate::test {
namespace {

class ResetRequest : public ProgramTest {
 protected:
  static std::vector<EventRecord> events(const RunLog& log, Reason reason) {
    std::vector<EventRecord> some;
    for (const EventRecord& e : log.events)
      if (e.reason == static_cast<int>(reason)) some.push_back(e);
    return some;
  }
};

TEST_F(ResetRequest, TakesTheSetFromSafeToItsRunAndIsRefusedBeforeAndAfter) {
  // The trip at 0.61 s; without a reset the drive stands for the rest of the run. At the wall's pace
  // the first request is answered before it.
  Program launch({"twinrate", "launch", "dilys2021", "--run-dir", path("run"), "--duration", "2.4s",
                  "--pace", "wall", "--set", "plant.fault.kind=current_nan", "--set",
                  "plant.fault.at_s=0.6", "--set", "plant.fault.for_s=0.03", "--set",
                  "bus.authenticate=false"});
  Bus bus({.role = Role::kSupervisor});
  bool tripped = false;
  std::int64_t reset_k = -1;
  std::vector<reply_t> replies;
  bus.subscribe<event_t>([&](const event_t& e) {
    tripped = tripped || e.reason == static_cast<int>(Reason::kSensorLost);
    if (e.reason == static_cast<int>(Reason::kReset)) reset_k = e.seq;
  });
  bus.subscribe<reply_t>([&](const reply_t& r) {
    if (r.seq > 1000 && r.role == static_cast<int>(Role::kPlant)) replies.push_back(r);
  });
  const auto ask = [&](std::int64_t number) {
    request_t request{};
    request.seq = number;
    request.kind = static_cast<std::int32_t>(RequestKind::kReset);
    bus.publish(request);
  };
  const auto answered = [&](std::int64_t number) {
    return std::any_of(replies.begin(), replies.end(),
                       [&](const reply_t& r) { return r.seq == number; });
  };
  std::int64_t k = -1, k_tripped = -1;
  bus.subscribe<measurement_t>([&](const measurement_t& m) {
    k = m.seq;
    if (tripped && k_tripped < 0) k_tripped = k;
    if (k % 50 != 0) return;  // asked again until it is answered
    if (!answered(1001) && k > 100) ask(1001);
    // The fault has ended by then.
    if (!answered(1002) && k_tripped >= 0 && k > k_tripped + 300) ask(1002);
    if (!answered(1003) && reset_k >= 0 && k > reset_k + 200) ask(1003);
  });
  while (launch.running()) bus.handle(5);
  const ProgramResult result = launch.wait(20);
  ASSERT_FALSE(result.timed_out) << result.err;
  EXPECT_EQ(result.exit_code, 1) << "it tripped";
  const RunLog log = read_run_log(path("run"));
  ASSERT_EQ(log.measurement.size(), 12000u) << result.err;
  EXPECT_EQ(events(log, Reason::kReset).size(), 2u) << "of plant and estimator";
  EXPECT_EQ(events(log, Reason::kSafeRequested).size(), 0u);
  EXPECT_EQ(log.command.back().mode, Mode::kRun);
  for (std::size_t i = log.truth.size() - 200; i < log.truth.size(); ++i)
    ASSERT_LT(std::abs(wrap_pi(log.estimate[i].theta_e - 4 * log.truth[i].theta_m)), 0.5) << i;
  EXPECT_NEAR(log.truth.back().omega_m, 100, 10);
  // The plant answers each request for the set; the first and the last are refused.
  std::map<std::int64_t, int> accepted, refused;
  for (const reply_t& r : replies) ++(r.accepted ? accepted : refused)[r.seq];
  const auto names = [](const std::map<std::int64_t, int>& answers) {
    std::set<std::int64_t> numbers;
    for (const auto& [number, count] : answers) numbers.insert(number);
    return numbers;
  };
  EXPECT_EQ(names(refused), (std::set<std::int64_t>{1001, 1003}));
  EXPECT_EQ(names(accepted), (std::set<std::int64_t>{1002}));
}

}  // namespace
}  // namespace twinrate::test
