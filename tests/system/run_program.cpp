#include "tests/system/run_program.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sched.h>
#include <sys/mount.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>

#include "core/multicast.hpp"

namespace twinrate::test {
namespace {

namespace fs = std::filesystem;

double now_s() {
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

std::string program_path(const std::string& name) {
  static const std::map<std::string, std::string> built = {
      {"twinrate", TWINRATE_PROGRAM},
      {"twinrate-plant", TWINRATE_PLANT_PROGRAM},
      {"twinrate-estimator", TWINRATE_ESTIMATOR_PROGRAM},
      {"twinrate-gain", TWINRATE_GAIN_PROGRAM},
      {"twinrate-controller", TWINRATE_CONTROLLER_PROGRAM},
      {"twinrate-logger", TWINRATE_LOGGER_PROGRAM},
      {"twinrate-monitor", TWINRATE_MONITOR_PROGRAM},
      {"twinrate-emulator", TWINRATE_EMULATOR_PROGRAM}};
  const auto found = built.find(name);
  return found == built.end() ? name : found->second;
}

std::string new_file(const char* what) {
  std::string name = fmt::format("/tmp/twinrate-test-{}-XXXXXX", what);
  const int fd = mkstemp(name.data());
  if (fd >= 0) close(fd);
  return name;
}

// Without root, a user namespace gives the permissions over the own namespaces. Once a process.
bool get_namespace_rights() {
  static const bool granted = [] {
    if (geteuid() == 0) return true;
    const uid_t uid = getuid();
    const gid_t gid = getgid();
    if (unshare(CLONE_NEWUSER) != 0) return false;
    write_text("/proc/self/setgroups", "deny");
    write_text("/proc/self/uid_map", fmt::format("0 {} 1", uid));
    write_text("/proc/self/gid_map", fmt::format("0 {} 1", gid));
    return true;
  }();
  return granted;
}

}  // namespace

Program::Program(std::vector<std::string> arguments)
    : begun_s_(now_s()), out_path_(new_file("out")), err_path_(new_file("err")) {
  arguments.front() = program_path(arguments.front());
  std::vector<char*> argv;
  argv.reserve(arguments.size() + 1);
  for (std::string& argument : arguments) argv.push_back(argument.data());
  argv.push_back(nullptr);
  pid_ = fork();
  if (pid_ == 0) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    setpgid(0, 0);
    dup2(open("/dev/null", O_RDONLY), STDIN_FILENO);
    dup2(open(out_path_.c_str(), O_WRONLY | O_TRUNC), STDOUT_FILENO);
    dup2(open(err_path_.c_str(), O_WRONLY | O_TRUNC), STDERR_FILENO);
    execvp(argv[0], argv.data());
    _exit(127);
  }
  setpgid(pid_, pid_);
}

Program::~Program() {
  if (!ended_) {
    kill(-pid_, SIGKILL);
    waitpid(pid_, nullptr, 0);
  }
  fs::remove(out_path_);
  fs::remove(err_path_);
}

bool Program::running() {
  if (!ended_ && waitpid(pid_, &status_, WNOHANG) == pid_) ended_ = true;
  return !ended_;
}

ProgramResult Program::wait(double limit_s) {
  ProgramResult result;
  result.timed_out = !wait_until([this] { return !running(); }, limit_s);
  if (result.timed_out) {
    kill(-pid_, SIGKILL);
    waitpid(pid_, &status_, 0);
    ended_ = true;
  }
  result.wall_s = now_s() - begun_s_;
  result.exit_code = WIFEXITED(status_) ? WEXITSTATUS(status_) : 128 + WTERMSIG(status_);
  result.out = out();
  result.err = err();
  return result;
}

void Program::signal(int number) const {
  kill(pid_, number);
}
void Program::signal_group(int number) const {
  kill(-pid_, number);
}
std::string Program::out() const {
  return read_text(out_path_);
}
std::string Program::err() const {
  return read_text(err_path_);
}

ProgramResult run_program(const std::vector<std::string>& arguments, double limit_s) {
  return Program(arguments).wait(limit_s);
}

ProgramResult twinrate(std::vector<std::string> arguments, double limit_s) {
  arguments.insert(arguments.begin(), "twinrate");
  return run_program(arguments, limit_s);
}

bool wait_until(const std::function<bool()>& condition, double limit_s) {
  const double begun = now_s();
  while (!condition()) {
    if (now_s() - begun > limit_s) return false;
    usleep(2000);
  }
  return true;
}

int count_lines(const std::string& text) {
  return static_cast<int>(std::count(text.begin(), text.end(), '\n'));
}

std::string read_text(const std::string& path) {
  std::ifstream in(path);
  return {std::istreambuf_iterator<char>(in), {}};
}

void write_text(const std::string& path, const std::string& text) {
  std::ofstream(path) << text;
}

std::vector<std::string> arguments_of(pid_t pid) {
  // std::getline() takes the end of a process that ends meanwhile for the end of the file.
  std::ifstream in(fmt::format("/proc/{}/cmdline", pid));
  std::vector<std::string> arguments;
  for (std::string argument; std::getline(in, argument, '\0');) arguments.push_back(argument);
  return arguments;
}

std::vector<pid_t> processes_with(const std::string& text, const std::string& program) {
  std::vector<pid_t> found;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator("/proc", error)) {
    const pid_t pid = std::atoi(entry.path().filename().c_str());
    if (pid <= 0 || pid == getpid()) continue;
    const std::vector<std::string> arguments = arguments_of(pid);  // a zombie has none
    if (arguments.empty()) continue;
    if (!program.empty() && fs::path(arguments.front()).filename() != program) continue;
    if (std::any_of(arguments.begin(), arguments.end(),
                    [&](const std::string& a) { return a.find(text) != std::string::npos; }))
      found.push_back(pid);
  }
  return found;
}

void ProgramTest::SetUp() {
  enter_network_namespace(true);
  char name[] = "/tmp/twinrate-test-XXXXXX";
  ASSERT_NE(mkdtemp(name), nullptr);
  directory_ = name;
  unsetenv("LCM_DEFAULT_URL");
}

void ProgramTest::TearDown() {
  for (const std::string& mount : mounts_) umount2(mount.c_str(), MNT_DETACH);
  std::error_code ignored;
  if (!directory_.empty() && !HasFailure()) fs::remove_all(directory_, ignored);
  if (HasFailure()) fmt::print("files are left in {}\n", directory_);
}

void ProgramTest::enter_network_namespace(bool up) {
  if (!get_namespace_rights() || unshare(CLONE_NEWNET) != 0)
    GTEST_SKIP() << "network namespaces are not permitted here (unshare -n, or unshare -rn)";
  std::string done;
  if (up && !try_bring_up_multicast(done))
    GTEST_SKIP() << "no multicast in the namespace: " << done;
}

bool ProgramTest::mount_small_disk(const std::string& name, const std::string& size) {
  if (unshare(CLONE_NEWNS) != 0 || mount(nullptr, "/", nullptr, MS_REC | MS_PRIVATE, nullptr) != 0)
    return false;
  fs::create_directory(path(name));
  if (mount("tmpfs", path(name).c_str(), "tmpfs", 0, ("size=" + size).c_str()) != 0) return false;
  mounts_.push_back(path(name));
  return true;
}

std::uintmax_t SetTest::log_size() const {
  std::error_code error;
  const std::uintmax_t size = fs::file_size(path("run") + "/log.lcm", error);
  return error ? 0 : size;
}

pid_t SetTest::child(const std::string& program) const {
  const std::vector<pid_t> found = processes_with(path("run"), program);
  EXPECT_EQ(found.size(), 1u) << program;
  return found.size() == 1 ? found.front() : 0;
}

void SetTest::expect_nothing_left(double limit_s) const {
  EXPECT_TRUE(wait_until([&] { return processes_with(path("run")).empty(); }, limit_s));
}

}  // namespace twinrate::test
