#include "scope/traces.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <thread>

#include "core/config.hpp"

namespace twinrate::scope {

namespace fs = std::filesystem;

namespace {

constexpr int kMostTraces = 10'000, kNice = 5, kPatience_ms = 2000;

std::string read_text(const fs::path& path) {
  std::ifstream in(path);
  return {std::istreambuf_iterator<char>(in), {}};
}

void write_text(const fs::path& path, const std::string& text) {
  std::ofstream out(path, std::ios::binary);
  out << text;
  if (!out.flush()) throw BadInput(path.string() + ": cannot be written");
}

std::string escaped(const std::string& text) {
  std::string html;
  for (const char c : text)
    html += c == '<' ? "&lt;" : c == '>' ? "&gt;" : c == '&' ? "&amp;" : std::string(1, c);
  return html;
}

std::string small_page(const std::string& title, const std::string& text, bool again) {
  return fmt::format(
      "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\">{}<title>{}</title>"
      "<body style=\"font: 15px system-ui, sans-serif; margin: 2em\"><h1>{}</h1><pre>{}</pre>\n",
      again ? "<meta http-equiv=\"refresh\" content=\"1\">" : "", escaped(title), escaped(title),
      escaped(text));
}

// Creates the directory of the next trace.
fs::path new_directory(const fs::path& parent) {
  std::error_code error;
  fs::create_directories(parent, error);
  for (int i = 1; i < kMostTraces && !error; ++i)
    if (const fs::path path = parent / fmt::format("trace-{}", i);
        fs::create_directory(path, error))
      return path;
  throw BadInput(parent.string() + ": no directory can be made there");
}

// Starts `twinrate trace` with its output in a file. After the fork only calls that are safe there.
pid_t start_trace(const std::string& program, const fs::path& directory) {
  const std::string drive = directory / "drive.toml", data = directory / "drive-log.csv",
                    result = directory / "result", out = directory / "trace.txt";
  const char* const arguments[] = {"twinrate",   "trace", drive.c_str(),  "--data",
                                   data.c_str(), "--out", result.c_str(), nullptr};
  const pid_t child = fork();
  if (child != 0) return child;
  prctl(PR_SET_PDEATHSIG, SIGTERM);
  setpriority(PRIO_PROCESS, 0, kNice);
  const int file = open(out.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
  dup2(file, STDOUT_FILENO);
  dup2(file, STDERR_FILENO);
  closefrom(STDERR_FILENO + 1);
  execv(program.c_str(), const_cast<char* const*>(arguments));
  _exit(127);
}

}  // namespace

Traces::Traces(std::string program, std::string directory)
    : program_(std::move(program)), directory_(std::move(directory)) {}

Traces::~Traces() {
  if (running_ < 0) return;
  kill(running_, SIGTERM);
  for (int i = 0; i < kPatience_ms / 10 && running_ >= 0; ++i, reap())
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  if (running_ < 0) return;
  kill(running_, SIGKILL);
  waitpid(running_, nullptr, 0);
}

void Traces::reap() {
  int status = 0;
  if (running_ < 0 || waitpid(running_, &status, WNOHANG) != running_) return;
  State& state = traces_.at(running_id_);
  state.running = false;
  state.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  running_ = -1;
}

int Traces::start(const std::string& drive_toml, const std::string& csv, const std::string& what) {
  const std::lock_guard lock(mutex_);
  reap();
  if (program_.empty() || directory_.empty()) throw BadInput("trace: not offered here");
  if (running_ >= 0)
    throw BadInput(fmt::format("trace: one at a time allowed; {} runs", traces_[running_id_].what));
  const fs::path directory = new_directory(directory_);
  write_text(directory / "drive.toml", drive_toml);
  write_text(directory / "drive-log.csv", csv);
  const pid_t child = start_trace(program_, directory);
  if (child < 0) throw BadInput("trace: no process can be started");
  running_ = child;
  running_id_ = static_cast<int>(traces_.size()) + 1;
  traces_[running_id_] = {.directory = directory.string(), .what = what, .running = true};
  return running_id_;
}

std::optional<Traces::State> Traces::state(int id) {
  const std::lock_guard lock(mutex_);
  reap();
  const auto found = traces_.find(id);
  if (found == traces_.end()) return {};
  return found->second;
}

std::string Traces::page(int id) {
  const std::optional<State> trace = state(id);
  if (!trace) throw BadInput("trace: no such one");
  const fs::path directory = trace->directory;
  if (trace->running) return small_page("Tracing " + trace->what, "in " + trace->directory, true);
  const std::string report = read_text(directory / "result" / "report.html");
  if (trace->has_page() && !report.empty()) return report;
  return small_page("No result of tracing " + trace->what,
                    fmt::format("exit code {}, in {}\n{}", trace->exit_code, trace->directory,
                                read_text(directory / "trace.txt")),
                    false);
}

}  // namespace twinrate::scope
