#include "run/cpu_plan.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sched.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string_view>

#include "core/process.hpp"
#include "core/seconds_since.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> words_of(const fs::path& command_line) {
  std::ifstream file(command_line, std::ios::binary);
  std::vector<std::string> words;
  for (std::string word; std::getline(file, word, '\0');) words.push_back(word);
  return words;
}

std::string value_of(const std::vector<std::string>& words, std::string_view option) {
  const auto found = std::find(words.begin(), words.end(), option);
  return found == words.end() || found + 1 == words.end() ? "" : found[1];
}

std::optional<OtherSet> set_of(const fs::path& process, const fs::path& own_network) {
  const std::vector<std::string> words = words_of(process / "cmdline");
  if (words.empty()) return {};
  const std::string program = fs::path(words.front()).filename().string();
  if (program != "twinrate-plant" && program != "twinrate-bridge") return {};
  const std::string cpu = value_of(words, "--cpu");
  std::error_code unknown;
  const fs::path network = fs::read_symlink(process / "ns/net", unknown);
  return OtherSet{.run_dir = value_of(words, "--run-dir"),
                  .url = value_of(words, "--lcm-url"),
                  .ring_cpu = cpu.empty() ? -1 : std::atoi(cpu.c_str()),
                  .realtime = value_of(words, "--pace") == "realtime",
                  .same_network = unknown || network == own_network};
}

}  // namespace

std::vector<OtherSet> other_sets(const std::string& proc) {
  std::error_code refused;
  const fs::path own_network = fs::read_symlink(fs::path(proc) / "self/ns/net", refused);
  std::vector<std::pair<int, fs::path>> processes;
  for (const auto& entry : fs::directory_iterator(proc, refused))
    if (const int pid = std::atoi(entry.path().filename().c_str()); pid > 0)
      processes.emplace_back(pid, entry.path());
  std::sort(processes.begin(), processes.end());
  std::vector<OtherSet> sets;
  for (const auto& [pid, path] : processes)
    if (auto set = set_of(path, own_network)) sets.push_back(std::move(*set));
  return sets;
}

std::vector<int> allowed_cpus() {
  cpu_set_t allowed;
  std::vector<int> cpus;
  if (sched_getaffinity(0, sizeof allowed, &allowed) != 0) return cpus;
  for (int cpu = 0; cpu < CPU_SETSIZE; ++cpu)
    if (CPU_ISSET(static_cast<std::size_t>(cpu), &allowed)) cpus.push_back(cpu);
  return cpus;
}

void pin_to_first_cpu() {
  if (const std::vector<int> cpus = allowed_cpus(); !cpus.empty()) pin_to_cpu(cpus.front());
}

CpuPlan plan_cpus(std::vector<int> allowed, const std::vector<OtherSet>& sets) {
  if (allowed.size() < 2) return {};
  const auto rings = [&](int cpu) {
    return std::count_if(sets.begin(), sets.end(),
                         [cpu](const OtherSet& set) { return set.ring_cpu == cpu; });
  };
  std::stable_sort(allowed.begin(), allowed.end(),
                   [&](int a, int b) { return rings(a) < rings(b); });
  return {.ring = allowed[0], .others = allowed[1]};
}

// flock() of the directory: no file is made, and the kernel frees it with the process.
PlanLock::PlanLock() : directory_(open("/tmp", O_RDONLY | O_DIRECTORY | O_CLOEXEC)) {
  const auto begun = std::chrono::steady_clock::now();
  while (directory_ >= 0 && !held_ && seconds_since(begun) < kPatience_s) {
    held_ = flock(directory_, LOCK_EX | LOCK_NB) == 0;
    if (!held_) usleep(1000);
  }
}

PlanLock::~PlanLock() {
  if (directory_ >= 0) close(directory_);
}

void wait_until_it_shows(int plant_pid) {
  const fs::path process = fs::path("/proc") / std::to_string(plant_pid);
  const auto begun = std::chrono::steady_clock::now();
  while (!set_of(process, {}) && seconds_since(begun) < 0.2) usleep(500);
}

std::vector<std::string> realtime_beside(const std::vector<OtherSet>& sets, const CpuPlan& plan,
                                         const std::string& url, bool filtered) {
  std::vector<std::string> lines;
  for (const OtherSet& set : sets) {
    if (!set.realtime) continue;
    std::string line = fmt::format("another realtime set runs on this machine ({})",
                                   set.run_dir.empty() ? "started by hand" : set.run_dir);
    if (plan.ring >= 0 && plan.ring == set.ring_cpu)
      line += fmt::format(": both rings are on CPU {}, expect late ticks and trips", plan.ring);
    else if (plan.ring >= 0 && set.ring_cpu >= 0)
      line += fmt::format(": its ring is on CPU {}, that of this set on CPU {}; both may be late",
                          set.ring_cpu, plan.ring);
    else
      line += ": they share the CPUs, expect late ticks and trips";
    if (!filtered && set.same_network && set.url == url)
      line +=
          "; its messages wake the processes of this set: give one of them --lcm-url with "
          "another port";
    lines.push_back(line);
  }
  return lines;
}

}  // namespace twinrate
