#include "tools/doctor/checks.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sched.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "core/multicast.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;

std::string first_line(const char* path) {
  std::ifstream in(path);
  std::string line;
  std::getline(in, line);
  return line;
}

bool on_path(const std::string& program) {
  const char* path = std::getenv("PATH");
  std::istringstream directories(path ? path : "");
  for (std::string directory; std::getline(directories, directory, ':');)
    if (access((std::filesystem::path(directory) / program).c_str(), X_OK) == 0) return true;
  return false;
}

// Median lateness of a 1 ms sleep, microseconds.
double sleep_lateness_us() {
  std::vector<double> late;
  for (int i = 0; i < 25; ++i) {
    timespec before{}, after{};
    const timespec pause{.tv_sec = 0, .tv_nsec = 1'000'000};
    clock_gettime(CLOCK_MONOTONIC, &before);
    clock_nanosleep(CLOCK_MONOTONIC, 0, &pause, nullptr);
    clock_gettime(CLOCK_MONOTONIC, &after);
    late.push_back(1e6 * static_cast<double>(after.tv_sec - before.tv_sec) +
                   1e-3 * static_cast<double>(after.tv_nsec - before.tv_nsec) - 1000);
  }
  std::nth_element(late.begin(), late.begin() + 12, late.end());
  return late[12];
}

}  // namespace

Finding check_loopback() {
  if (loopback_is_up()) return {"loopback", Severity::kOk, "lo is up", ""};
  return {"loopback", Severity::kFail, "lo is down", "ip link set lo up multicast on"};
}

Finding check_multicast_route(const std::string& address) {
  if (multicast_route_exists(address))
    return {"multicast", Severity::kOk, "there is a route to " + address, ""};
  return {"multicast", Severity::kFail, "no route to " + address, multicast_mend()};
}

Finding check_receive_buffer() {
  const long bytes = std::atol(first_line("/proc/sys/net/core/rmem_max").c_str());
  Finding finding{"receive_buffer", Severity::kOk, fmt::format("net.core.rmem_max is {}", bytes),
                  ""};
  if (bytes >= kWantedReceiveBuffer) return finding;
  finding.severity = Severity::kWarn;
  finding.text += fmt::format(", the logger wants {}: it may miss messages in realtime runs",
                              kWantedReceiveBuffer);
  finding.mend = fmt::format("sysctl -w net.core.rmem_max={}", kWantedReceiveBuffer);
  return finding;
}

Finding check_cpus() {
  cpu_set_t set;
  CPU_ZERO(&set);
  const int usable = sched_getaffinity(0, sizeof set, &set) == 0 ? CPU_COUNT(&set) : 1;
  const long online = sysconf(_SC_NPROCESSORS_ONLN);
  Finding finding{"cpus", Severity::kOk, fmt::format("{} of {} CPUs usable", usable, online), ""};
  if (usable >= 2) return finding;
  finding.severity = Severity::kWarn;
  finding.text += ": loop and logger share one, realtime runs will be late";
  finding.mend = online > 1 ? fmt::format("taskset -c 0-{} twinrate ..", online - 1)
                            : "run on a machine with two CPUs, or --pace lockstep";
  return finding;
}

Finding check_clock() {
  const std::string source =
      first_line("/sys/devices/system/clocksource/clocksource0/current_clocksource");
  timespec resolution{};
  clock_getres(CLOCK_MONOTONIC, &resolution);
  Finding finding{
      "clock", Severity::kOk,
      fmt::format("source {}, resolution {} ns, a 1 ms sleep is {:.0f} us late",
                  source.empty() ? "unknown" : source, resolution.tv_nsec, sleep_lateness_us()),
      ""};
  if (resolution.tv_nsec <= 1000 && source != "hpet" && source != "acpi_pm" && source != "jiffies")
    return finding;
  finding.severity = Severity::kWarn;
  finding.text += ": slow to read";
  finding.mend = "echo tsc > /sys/devices/system/clocksource/clocksource0/current_clocksource";
  return finding;
}

Finding check_realtime_rights() {
  const int policy_before = sched_getscheduler(0);
  sched_param before{}, wanted{};
  sched_getparam(0, &before);
  wanted.sched_priority = 1;
  if (sched_setscheduler(0, SCHED_FIFO, &wanted) == 0) {
    sched_setscheduler(0, policy_before, &before);
    return {"realtime", Severity::kOk, "SCHED_FIFO is allowed", ""};
  }
  const int error = errno;
  rlimit limit{};
  getrlimit(RLIMIT_RTPRIO, &limit);
  return {"realtime", Severity::kWarn,
          fmt::format("SCHED_FIFO is refused ({}; limit rtprio {}): realtime runs use the normal "
                      "scheduler",
                      std::strerror(error), limit.rlim_cur),
          "echo '@realtime - rtprio 50' >> /etc/security/limits.conf (and join that group), or run "
          "with CAP_SYS_NICE"};
}

Finding check_governor() {
  const std::string governor = first_line("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor");
  if (governor.empty()) return {"governor", Severity::kOk, "no CPU frequency governor here", ""};
  if (governor == "performance") return {"governor", Severity::kOk, "performance", ""};
  return {"governor", Severity::kWarn, governor + ": the clock changes while a loop runs",
          "cpupower frequency-set -g performance"};
}

Finding check_stock_tools() {
  std::vector<std::string> missing;
  for (const char* program : {"lcm-logger", "lcm-logplayer"})
    if (!on_path(program)) missing.emplace_back(program);
  if (missing.empty())
    return {"lcm_tools", Severity::kOk, "lcm-logger and lcm-logplayer are on PATH", ""};
  return {"lcm_tools", Severity::kWarn, fmt::format("{} not on PATH", fmt::join(missing, ", ")),
          "apt-get install liblcm-bin"};
}

Finding check_disk() {
  std::error_code error;
  const fs::space_info space = fs::space(".", error);
  const double free_MB = error ? 0 : static_cast<double>(space.available) / 1e6;
  Finding finding{"disk", Severity::kOk, fmt::format("{:.0f} MB free in this directory", free_MB),
                  ""};
  if (access(".", W_OK) != 0) {
    finding.severity = Severity::kWarn;
    finding.text += ", but it cannot be written to";
    finding.mend = "cd to a directory of yours, or launch --run-dir DIR";
  } else if (free_MB < 1000) {
    finding.severity = free_MB < 10 ? Severity::kFail : Severity::kWarn;
    finding.text += "; a log takes about 1 MB a 1000 ticks";
    finding.mend = "make room, or launch --run-dir DIR on another disk";
  }
  return finding;
}

std::string multicast_address_of(const std::string& url) {
  constexpr std::string_view kScheme = "udpm://";
  if (!url.starts_with(kScheme)) return kDefaultMulticastAddress;
  const std::string address_and_port = url.substr(kScheme.size());
  const std::string address = address_and_port.substr(0, address_and_port.find_first_of(":?/"));
  return address.empty() ? kDefaultMulticastAddress : address;
}

}  // namespace twinrate
