// Damage of a log is found, said with its event and byte, and costs no memory.
#include "core/event_log.hpp"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>

#include "core/measurement_reader.hpp"
#include "core/reason.hpp"
#include "core/run_log.hpp"
#include "tests/support/damaged_log.hpp"

namespace twinrate::event_log_test {
namespace {

namespace fs = std::filesystem;
using test::Damage, test::RawEvent;

class DamagedLog : public testing::Test {
 public:
  DamagedLog()
      : root_(fs::temp_directory_path() / ("twinrate-damaged-" + std::to_string(getpid()))) {
    fs::remove_all(root_);
    fs::create_directories(root_);
  }
  ~DamagedLog() override { fs::remove_all(root_); }
  std::string put(const std::string& bytes) const {
    std::ofstream(log(), std::ios::binary) << bytes;
    return log();
  }
  std::string log() const { return (root_ / "log.lcm").string(); }
  void put_counts(int measurements) const {
    std::ofstream(root_ / "manifest.json")
        << R"({"logged": {"DRIVE_MEASUREMENT": )" << measurements << "}}";
  }
  static std::string refusal(const std::string& path) {
    try {
      read_run_log(path);
    } catch (const BadInput& refused) {
      return refused.what();
    }
    return "";
  }
  std::vector<RawEvent> whole_ = test::small_log(Config::load("dilys2021"), 60);

 private:
  fs::path root_;
};

TEST_F(DamagedLog, AWholeLogIsReadWithoutADamage) {
  const RunLog read = read_run_log(put(test::file_of(whole_)), "", OnDamage::kSkip);
  EXPECT_EQ(read.measurement.size(), 60u);
  EXPECT_EQ(read.events.size(), 6u);
  EXPECT_EQ(read.damage, "");
}

// The supervisor knows the tick of the plant's last heartbeat, up to 0.1 s before: the drive cannot
// have ended at a tick that others followed.
TEST_F(DamagedLog, AnEventOfTheSupervisorIsNotBeforeTheTicksLoggedBeforeIt) {
  const auto event_of = [](Role role, std::int64_t k) {
    event_t event{};
    event.seq = k;
    event.t_ns = 200'000 * k;
    event.role = static_cast<std::int32_t>(role);
    event.reason = static_cast<std::int32_t>(Reason::kProcessDied);
    event.waited_for = -1;
    event.text = "twinrate-plant ended";
    return event;
  };
  struct Case {
    Role role;
    std::int64_t k, expected;
  };
  for (const auto& [role, k, expected] :
       {Case{Role::kSupervisor, 3, 59}, Case{Role::kSupervisor, 70, 70},
        Case{Role::kPlant, 3, 3}}) {
    std::vector<RawEvent> events = whole_;
    events.insert(events.end() - 1, test::raw_event(event_of(role, k), events.back().timestamp));
    test::number(events);
    const RunLog read = read_run_log(put(test::file_of(events)));
    EXPECT_EQ(read.events.back().k, expected) << k;
    EXPECT_EQ(read.events.back().t_ns, 200'000 * expected) << k;
  }
}

TEST_F(DamagedLog, EventAndByteAreSaid) {
  const std::size_t before = test::file_of({whole_.begin(), whole_.begin() + 7}).size();
  whole_[7].data_length = INT32_MAX;
  const std::string said = refusal(put(test::file_of(whole_)));
  EXPECT_NE(said.find("event 7, byte " + std::to_string(before) + ":"), std::string::npos) << said;
  EXPECT_NE(said.find("2147483647 bytes"), std::string::npos) << said;
  const RunLog rest = read_run_log(log(), "", OnDamage::kSkip);
  EXPECT_NE(rest.damage.find("event 7"), std::string::npos) << rest.damage;
  EXPECT_GE(rest.measurement.size() + rest.estimate.size() + rest.reference.size(), 178u);
}

TEST_F(DamagedLog, OneThatEndsWithAWholeEventIsFoundByTheCountsOfItsManifest) {
  put_counts(60);
  EXPECT_EQ(refusal(put(test::file_of(whole_))), "");
  whole_.resize(100);
  const std::string said = refusal(put(test::file_of(whole_)));
  EXPECT_NE(said.find("of 60 messages of DRIVE_MEASUREMENT"), std::string::npos) << said;
}

// Without manifest.json beside it: the writer's marks say that it has an end (core/log_marks.hpp).
TEST_F(DamagedLog, OneThatWasCutAtTheEndOfAnyEventIsFound) {
  for (std::size_t events = 7; events < whole_.size(); ++events) {
    const std::vector<RawEvent> cut(whole_.begin(), whole_.begin() + static_cast<long>(events));
    const std::string said = refusal(put(test::file_of(cut)));
    ASSERT_NE(said.find("the log does not end"), std::string::npos) << events;
    ASSERT_NE(said.find("read the undamaged part with --repair"), std::string::npos) << events;
    ASSERT_NE(read_run_log(log(), "", OnDamage::kSkip).damage, "") << events;
  }
}

TEST_F(DamagedLog, APartThatWasCutOrIsMissingIsFound) {
  const auto middle = whole_.begin() + 100;
  std::vector<RawEvent> first(whole_.begin(), middle), second(whole_.begin(), whole_.begin() + 2);
  for (RawEvent& event : second) event.timestamp = middle->timestamp;
  second.insert(second.end(), middle, whole_.end());
  test::number(second);
  first.push_back(test::mark(kLogContinues, first.back().timestamp));
  test::number(first);
  const std::string directory = fs::path(log()).parent_path().string();
  put(test::file_of(first));
  EXPECT_NE(refusal(directory).find("the next part of the log is missing"), std::string::npos);
  EXPECT_EQ(refusal(log()), "") << "one part that the user names";
  std::ofstream(directory + "/log-001.lcm", std::ios::binary) << test::file_of(second);
  EXPECT_EQ(refusal(directory), "");
  first.pop_back();
  put(test::file_of(first));
  EXPECT_NE(refusal(directory).find("log.lcm does not end"), std::string::npos);
  second[1] = test::mark(kLogGoesOn, second[1].timestamp);
  test::number(second);
  std::ofstream(directory + "/log-001.lcm", std::ios::binary) << test::file_of(second);
  EXPECT_EQ(refusal(directory), "") << "its logger was lost and started again: the run says so";
}

TEST_F(DamagedLog, OneWithoutMarksIsOfAnEarlierProgramOrAnotherLogger) {
  whole_.erase(whole_.begin() + 1);
  whole_.pop_back();
  test::number(whole_);
  EXPECT_EQ(refusal(put(test::file_of(whole_))), "");
}

// Every reading in a process that may use little more memory than it has. The shadow memory of
// AddressSanitizer is larger than any such limit; it finds what is read out of bounds instead.
TEST_F(DamagedLog, NoneOfManyIsTakenForWholeAndNoneEndsTheReader) {
  const pid_t child = fork();
  if (child == 0) {
#ifndef __SANITIZE_ADDRESS__
    const rlimit limit{.rlim_cur = 400 << 20, .rlim_max = 400 << 20};
    setrlimit(RLIMIT_DATA, &limit);
#endif
    alarm(60);
    int kind = 0, wrong = 0;
    for (std::uint64_t seed = 1; seed <= 300; ++seed, kind = (kind + 1) % Damage::kKinds) {
      put(Damage(whole_, seed).apply(kind));
      if (refusal(log()).empty())
        std::fprintf(stderr, "kind %d, seed %d taken\n", kind, static_cast<int>(seed)), ++wrong;
      try {
        if (read_run_log(log(), "", OnDamage::kSkip).damage.empty()) ++wrong;
        MeasurementReader reader(log(), OnDamage::kSkip);
        std::int64_t last = -1;
        for (Measurement m; reader.next(m); last = m.k)
          if (m.k <= last) ++wrong;
      } catch (const BadInput&) {  // nothing is left
      }
    }
    _exit(wrong == 0 ? 0 : 1);
  }
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  EXPECT_TRUE(WIFEXITED(status)) << "signal " << WTERMSIG(status);
  EXPECT_EQ(WEXITSTATUS(status), 0);
}

}  // namespace
}  // namespace twinrate::event_log_test
