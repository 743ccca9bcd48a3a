// Runs the programs in a network namespace of the test and returns their results.
//
// A fixture derived from ProgramTest gives each test a new namespace with a multicast route and an
// empty directory. If namespaces are not permitted, the test is skipped with a message. All
// programs end with the test.
#pragma once
#include <gtest/gtest.h>
#include <sys/types.h>

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace twinrate::test {

struct ProgramResult {
  bool timed_out = false;
  int exit_code = -1;  // 128 + signal if a signal ended it
  std::string out, err;
  double wall_s = 0;
};

// A running program in its own process group; the destructor kills the group.
class Program {
 public:
  // The first argument is a program of this project ("twinrate-gain"), or one found on PATH.
  explicit Program(std::vector<std::string> arguments);
  ~Program();
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  pid_t pid() const { return pid_; }
  bool running();
  // SIGKILL after the limit, and timed_out in the result.
  ProgramResult wait(double limit_s);
  void signal(int number) const;        // to the program alone
  void signal_group(int number) const;  // as Ctrl-C on a terminal does
  std::string out() const;
  std::string err() const;

 private:
  pid_t pid_ = -1;
  int status_ = 0;
  bool ended_ = false;
  double begun_s_ = 0;
  std::string out_path_, err_path_;
};

ProgramResult run_program(const std::vector<std::string>& arguments, double limit_s = 60);
ProgramResult twinrate(std::vector<std::string> arguments, double limit_s = 60);

// Polls until `condition` is true; false after `limit_s`.
bool wait_until(const std::function<bool()>& condition, double limit_s = 20);

int count_lines(const std::string& text);
std::string read_text(const std::string& path);
void write_text(const std::string& path, const std::string& text);

// Running processes (without zombies) with `text` in one of their arguments and, if given, the
// program name `program`.
std::vector<pid_t> processes_with(const std::string& text, const std::string& program = "");
std::vector<std::string> arguments_of(pid_t pid);

class ProgramTest : public ::testing::Test {
 protected:
  void SetUp() override;
  void TearDown() override;
  // A fresh namespace in place of the present one; `up`: with loopback and a multicast route.
  void enter_network_namespace(bool up);
  std::string path(const std::string& name) const { return directory_ + "/" + name; }
  // Mounts a file system of `size` bytes at path(name); false where that is not permitted.
  bool mount_small_disk(const std::string& name, const std::string& size);

 private:
  std::string directory_;
  std::vector<std::string> mounts_;
};

// A set whose run directory is path("run").
class SetTest : public ProgramTest {
 protected:
  // Of its first log; 0 where there is none yet.
  std::uintmax_t log_size() const;
  // The one process of this name; 0 and a failure where there is not one.
  pid_t child(const std::string& program) const;
  void expect_nothing_left(double limit_s = 2) const;
};

}  // namespace twinrate::test
