// A session file that somebody else wrote.
#include "core/authority.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>

#include "core/config.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;

class Authority : public testing::Test {
 public:
  Authority() { fs::create_directories(directory_); }
  ~Authority() override { fs::remove_all(directory_); }

  const fs::path directory_ =
      fs::temp_directory_path() / ("twinrate-authority-" + std::to_string(getpid()));
};

TEST_F(Authority, TheSetThatRunsIsFoundByItsFile) {
  const SessionFile file({directory_.string(), "udpm://239.255.76.67:1", "_b", 7});
  const RunningSet set = find_running_set(directory_.string());
  EXPECT_EQ(set.session, 7);
  EXPECT_EQ(set.channel_suffix, "_b");
}

// Of two sets that run in ./runs, the one that began later.
TEST_F(Authority, WithoutADirectoryTheNewestSetIsFound) {
  const fs::path before = fs::current_path();
  fs::current_path(directory_);
  for (const char* name : {"a", "b"}) fs::create_directories(fs::path("runs") / name);
  {
    const SessionFile a({"runs/a", "", "", 1}), b({"runs/b", "", "", 2});
    const fs::file_time_type now = fs::file_time_type::clock::now();
    for (const std::int64_t newest : {1, 2}) {
      const auto since = [&](std::int64_t session) {
        return now - std::chrono::seconds(session == newest ? 1 : 100);
      };
      fs::last_write_time("runs/a/session.json", since(1));
      fs::last_write_time("runs/b/session.json", since(2));
      EXPECT_EQ(find_running_set("").session, newest);
    }
  }
  fs::current_path(before);
}

TEST_F(Authority, AFileOfAnotherFormIsNoRunningSet) {
  for (const char* text :
       {"", "[]", "{", "{\"pid\": \"x\", \"session\": 1}", "{\"pid\": -1, \"session\": 1}",
        "{\"pid\": 0, \"session\": 1}", "{\"pid\": 1e300, \"session\": 1}",
        "{\"pid\": 1, \"session\": []}", "{\"pid\": 1, \"session\": 1, \"url\": 5}",
        "{\"pid\": 4294967297, \"session\": 1}"}) {
    std::ofstream(directory_ / "session.json") << text;
    EXPECT_THROW(find_running_set(directory_.string()), BadInput) << text;
  }
}

}  // namespace
}  // namespace twinrate
