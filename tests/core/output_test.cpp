// What a program may overwrite: a name that is free, and with --force the files of its own result.
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <fstream>

#include "core/authority.hpp"
#include "core/config.hpp"
#include "core/output_file.hpp"
#include "core/result_directory.hpp"

namespace twinrate::output_test {
namespace {

namespace fs = std::filesystem;

class Output : public testing::Test {
 public:
  Output() : root_(fs::temp_directory_path() / ("twinrate-output-" + std::to_string(getpid()))) {
    fs::remove_all(root_);
    fs::create_directories(root_);
  }
  ~Output() override { fs::remove_all(root_); }
  std::string path(const std::string& name) const { return (root_ / name).string(); }
  void put(const std::string& name, const std::string& text) const {
    fs::create_directories(fs::path(path(name)).parent_path());
    std::ofstream(path(name)) << text;
  }
  std::string text(const std::string& name) const {
    std::ifstream file(path(name));
    return {std::istreambuf_iterator<char>(file), {}};
  }
  // A finished run with a log of two parts.
  void run(const std::string& directory, bool force = false) const {
    ResultDirectory result(path(directory), ResultKind::kRun, force);
    result.begin();
    for (const char* name : {"/config.toml", "/log.lcm", "/log-001.lcm", "/summary.json",
                             "/manifest.json", "/report.html"})
      write_new(path(directory) + name, "run");
    result.finish();
  }

 private:
  fs::path root_;
};

TEST_F(Output, AFileIsReplacedOnlyWithForceAndADirectoryNever) {
  put("page.html", "mine");
  fs::create_directories(path("directory"));
  EXPECT_NO_THROW(expect_free(path("new.html"), false));
  EXPECT_THROW(expect_free(path("page.html"), false), BadInput);
  EXPECT_NO_THROW(expect_free(path("page.html"), true));
  EXPECT_THROW(expect_free(path("directory"), true), BadInput);
  fs::create_symlink(path("nowhere"), path("link"));
  EXPECT_THROW(expect_free(path("link"), true), BadInput);
  EXPECT_THROW(write_new(path("page.html"), "other"), BadInput);
  EXPECT_EQ(text("page.html"), "mine");
}

TEST_F(Output, AFileThatCannotBeReplacedStaysAsItWas) {
  put("drive.toml", "old");
  replace_file(path("drive.toml"), "new");
  EXPECT_EQ(text("drive.toml"), "new");
  rlimit limit{}, none{};
  getrlimit(RLIMIT_FSIZE, &limit);
  none = {.rlim_cur = 4, .rlim_max = limit.rlim_max};
  std::signal(SIGXFSZ, SIG_IGN);
  setrlimit(RLIMIT_FSIZE, &none);
  EXPECT_THROW(replace_file(path("drive.toml"), "longer than it may be"), std::runtime_error);
  setrlimit(RLIMIT_FSIZE, &limit);
  EXPECT_EQ(text("drive.toml"), "new");
  EXPECT_FALSE(fs::exists(path("drive.toml.part")));
}

TEST_F(Output, ANameThatCannotBeOneIsBadInput) {
  put("file", "mine");
  for (const std::string& name : {path("file/x"), path("no/such/x"), path(std::string(300, 'a'))})
    EXPECT_THROW(write_new(name, "x"), BadInput) << name;
}

TEST_F(Output, APartFileLeavesAUsersPartFileAloneAndReplacesNoFileThatCameMeanwhile) {
  put("log.csv.part", "mine");
  {
    PartFile part(path("log.csv"));
    put("log.csv", "came meanwhile");
    EXPECT_THROW(part.finish(), BadInput);
  }
  EXPECT_EQ(text("log.csv.part"), "mine");
  EXPECT_EQ(text("log.csv"), "came meanwhile");
  EXPECT_FALSE(fs::exists(path("log.csv.part-2")));
}

TEST_F(Output, FilesOfTheUserBesideAResultStayWithForceToo) {
  const std::vector<std::string> users = {"run/log-notes.lcm", "run/logbook.lcm", "run/log.lcm.bak",
                                          "run/notes/log.lcm"};
  for (const std::string& name : users) put(name, "mine");
  run("run");
  put("run/learnt.toml", "mine");  // a name of a run, but this run did not make it
  EXPECT_THROW(run("run"), BadInput);
  EXPECT_THROW(run("run", true), BadInput);
  fs::remove(path("run/learnt.toml"));
  run("run", true);
  for (const std::string& name : users) EXPECT_EQ(text(name), "mine") << name;
}

TEST_F(Output, ANameOfTheResultThatIsTakenIsRefusedAndKept) {
  for (const char* name : {"log.lcm", "log-001.lcm", "report.html", "manifest.json"}) {
    put(std::string("other/") + name, "mine");
    for (const bool force : {false, true}) {
      EXPECT_THROW(run("other", force), BadInput) << name;
      EXPECT_EQ(text(std::string("other/") + name), "mine");
    }
    EXPECT_EQ(std::distance(fs::directory_iterator(path("other")), {}), 1);
    fs::remove_all(path("other"));
  }
}

TEST_F(Output, AnUnfinishedResultIsReplacedWithForceOnly) {
  {
    ResultDirectory killed(path("run"), ResultKind::kRun, false);
    killed.begin();
    write_new(path("run/log.lcm"), "first");
  }
  EXPECT_THROW(run("run"), BadInput);
  EXPECT_EQ(text("run/log.lcm"), "first");
  run("run", true);
  EXPECT_EQ(text("run/log.lcm"), "run");
}

TEST_F(Output, ARunThatIsStillOnIsNotReplacedUntilItsProcessEnded) {
  ResultDirectory running(path("run"), ResultKind::kRun, false);
  running.begin();
  write_new(path("run/log.lcm"), "first");
  {
    const SessionFile session({.directory = path("run"), .session = 7});  // of this process
    for (const bool force : {false, true}) EXPECT_THROW(run("run", force), BadInput) << force;
    EXPECT_EQ(text("run/log.lcm"), "first");
  }
  constexpr const char* kEnded = R"({"pid": 2147483647, "session": 7})";  // no machine has so many
  put("run/session.json", kEnded);
  run("run", true);
  EXPECT_EQ(text("run/log.lcm"), "run");
}

TEST_F(Output, AResultOfAnotherKindIsNeverReplaced) {
  run("run");
  const auto trace = [&](bool force) {
    ResultDirectory(path("run"), ResultKind::kTrace, force).begin();
  };
  EXPECT_THROW(trace(false), BadInput);
  EXPECT_THROW(trace(true), BadInput);  // both have a report.html
  EXPECT_EQ(text("run/report.html"), "run");
  EXPECT_THROW(ResultDirectory(path("run"), ResultKind::kSweep, false), BadInput);
  ResultDirectory(path("run"), ResultKind::kSweep, true).begin();
  EXPECT_EQ(text("run/log.lcm"), "run");
}

// The disk was full, or the process was killed.
TEST_F(Output, AResultThatLacksAFileIsNotFinished) {
  {
    ResultDirectory result(path("run"), ResultKind::kRun, false);
    result.begin();
    for (const char* name : {"/config.toml", "/log.lcm", "/summary.json", "/report.html"})
      write_new(path("run") + name, "run");
    result.finish();
  }
  EXPECT_NE(text("run/.twinrate.json").find("\"finished\": false"), std::string::npos);
}

TEST_F(Output, ARecordOfAnotherFormIsRefusedInOneLine) {
  for (const char* record : {R"({"program": 5})", R"([])", R"({"program": "twinrate", "run": 1})",
                             R"({"program": "twinrate", "run": {"finished": "yes"}})",
                             R"({"program": "twinrate", "sweep": {"finished": null}})"}) {
    put("record/.twinrate.json", record);
    EXPECT_THROW(ResultDirectory(path("record"), ResultKind::kRun, true), BadInput) << record;
  }
}

TEST_F(Output, ARefusedDirectoryIsNotMade) {
  { ResultDirectory never_begun(path("a/b"), ResultKind::kTrace, false); }
  EXPECT_FALSE(fs::exists(path("a/b")));
  put("file", "mine");
  EXPECT_THROW(ResultDirectory(path("file"), ResultKind::kRun, true), BadInput);
  put("foreign/.twinrate.json", "[]");
  EXPECT_THROW(ResultDirectory(path("foreign"), ResultKind::kRun, true), BadInput);
}

}  // namespace
}  // namespace twinrate::output_test
