#include "core/process_set.hpp"

#include <fmt/format.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstring>
#include <filesystem>

#include "core/machine_error.hpp"
#include "core/paths.hpp"
#include "core/seconds_since.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;

// In an installed tree all programs share bin/; in a build tree each sits in its folder.
std::string find_program(const std::string& program) {
  if (program.find('/') != std::string::npos && access(program.c_str(), X_OK) == 0) return program;
  const fs::path here = executable_directory();
  for (const char* folder : {"", "../plant_sim", "../estimator", "../controller", "../logger",
                             "../monitor", "../bridge", "../emulator", "../embedded"}) {
    const fs::path candidate = here / folder / program;
    if (access(candidate.c_str(), X_OK) == 0) return candidate.lexically_normal().string();
  }
  throw MachineError(fmt::format("{}: not found beside {}; install or build the whole project",
                                 program, here.string()));
}

// In the child, between fork and exec: only async-signal-safe calls.
[[noreturn]] void become(const std::string& path, char* const* arguments, pid_t parent) {
  prctl(PR_SET_PDEATHSIG, SIGTERM);
  if (getppid() != parent) _exit(1);
  setpgid(0, 0);
  execv(path.c_str(), arguments);
  _exit(127);
}

}  // namespace

ProcessSet::~ProcessSet() {
  for (const Child& child : children_)
    if (!child.ended) kill(child.pid, SIGKILL);
  for (Child& child : children_)
    if (!child.ended) waitpid(child.pid, nullptr, 0);
}

static pid_t start_program(const std::string& program, const std::vector<std::string>& arguments) {
  const std::string path = find_program(program);
  std::vector<char*> argv{const_cast<char*>(program.c_str())};
  for (const std::string& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
  argv.push_back(nullptr);
  const pid_t parent = getpid(), pid = fork();
  if (pid < 0)
    throw MachineError(fmt::format("{}: fork failed: {}", program, std::strerror(errno)));
  if (pid == 0) become(path, argv.data(), parent);
  return pid;
}

void ProcessSet::start(Role role, const std::string& program,
                       const std::vector<std::string>& arguments) {
  const pid_t pid = start_program(program, arguments);
  children_.push_back({.role = role, .program = program, .pid = pid, .arguments = arguments});
}

void ProcessSet::restart(Role role, const std::vector<std::string>& more) {
  for (Child& child : children_) {
    if (child.role != role || !child.ended) continue;
    std::vector<std::string> arguments = child.arguments;
    arguments.insert(arguments.end(), more.begin(), more.end());
    child.pid = start_program(child.program, arguments);
    child.ended = false;
    child.exit_code = -1;
  }
}

void ProcessSet::reap() {
  for (Child& child : children_) {
    int status = 0;
    if (child.ended || waitpid(child.pid, &status, WNOHANG) != child.pid) continue;
    child.ended = true;
    child.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  }
}

bool ProcessSet::all_running() {
  reap();
  return std::none_of(children_.begin(), children_.end(), [](const Child& c) { return c.ended; });
}

const Child* ProcessSet::child(Role role) const {
  for (const Child& child : children_)
    if (child.role == role) return &child;
  return nullptr;
}

void ProcessSet::stop(const std::vector<Role>& roles, double patience_s) {
  const auto concerned = [&](const Child& child) {
    return !child.ended && std::find(roles.begin(), roles.end(), child.role) != roles.end();
  };
  for (const Child& child : children_)
    if (concerned(child)) {
      kill(child.pid, SIGTERM);
      kill(child.pid, SIGCONT);  // a stopped process cannot hear
    }
  const auto begun = std::chrono::steady_clock::now();
  bool killed = false;
  while (true) {
    reap();
    if (std::none_of(children_.begin(), children_.end(), concerned)) return;
    const double waited = seconds_since(begun);
    if (waited > patience_s && !killed) {
      killed = true;
      for (const Child& child : children_)
        if (concerned(child)) kill(child.pid, SIGKILL);
    }
    usleep(2000);
  }
}

std::string describe_end(const Child& child) {
  if (child.exit_code < 128) return fmt::format("exit code {}", child.exit_code);
  return fmt::format("signal {} ({})", child.exit_code - 128, strsignal(child.exit_code - 128));
}

}  // namespace twinrate
