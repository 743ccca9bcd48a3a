// twinrate doctor: checks that this machine can run the process set; prints the commands that mend
// it.
#include <fmt/format.h>

#include <algorithm>
#include <iostream>
#include <iterator>
#include <nlohmann/json.hpp>

#include "core/bus.hpp"
#include "core/multicast.hpp"
#include "core/realtime_setup.hpp"
#include "run/cpu_plan.hpp"
#include "run/udp_ring.hpp"
#include "tools/doctor/checks.hpp"
#include "tools/verb.hpp"

namespace twinrate {
namespace {

struct DoctorOptions {
  std::string url;
  bool json = false, mend = false, realtime = false, normal = false;
  double rate_Hz = 0, seconds = 2;
};

constexpr const char* kSeverityNames[] = {"ok", "warn", "fail"};

void print(const Finding& finding, bool json) {
  const char* health = kSeverityNames[static_cast<int>(finding.severity)];
  if (json) {
    nlohmann::ordered_json line = {
        {"check", finding.check}, {"health", health}, {"text", finding.text}};
    if (!finding.mend.empty()) line["mend"] = finding.mend;
    std::cout << line.dump() << std::endl;
    return;
  }
  fmt::print("{:<5} {:<15} {}\n", health, finding.check, finding.text);
  if (!finding.mend.empty()) fmt::print("      {:<15} mend: {}\n", "", finding.mend);
  std::fflush(stdout);
}

std::vector<Finding> examine(const DoctorOptions& options) {
  const std::string url = resolve_url(options.url);
  const std::string address = multicast_address_of(url);
  std::vector<Finding> findings{
      {"url", Severity::kOk, url, ""}, check_loopback(), check_multicast_route(address)};
  // Without a route, LCM reports the same failure after a long wait.
  if (findings.back().severity == Severity::kOk) {
    findings.push_back(check_lcm_loopback(address));
    // Loopback is not needed if multicast works over another interface.
    if (findings.back().severity == Severity::kOk && findings[1].severity == Severity::kFail)
      findings[1].severity = Severity::kWarn;
  }
  for (const auto check : {check_receive_buffer, check_cpus, check_clock, check_realtime_rights,
                           check_governor, check_stock_tools, check_disk})
    findings.push_back(check());
  return findings;
}

// -- doctor --realtime ----------------------------------------------------------------------------

constexpr double kRates_Hz[] = {1000, 2000, 5000, 10000, 20000};

void print(double rate_Hz, const RingResult& ring, bool json) {
  const auto list = [](const Percentiles& p) {
    return nlohmann::ordered_json{
        {"p50", p.p50}, {"p99", p.p99}, {"p99_9", p.p99_9}, {"max", p.max}};
  };
  if (json) {
    std::cout << nlohmann::ordered_json{{"rate_Hz", rate_Hz},
                                        {"ticks", ring.ticks},
                                        {"missed", ring.missed},
                                        {"late_us", list(ring.late_us)},
                                        {"round_us", list(ring.round_us)}}
                     .dump()
              << std::endl;
    return;
  }
  const auto text = [](const Percentiles& p) {
    return fmt::format("{:.0f}, {:.0f}, {:.0f}, {:.0f}", p.p50, p.p99, p.p99_9, p.max);
  };
  fmt::print("{:>8.0f} {:>8} {:>8}   {:<24} {}\n", rate_Hz, ring.ticks, ring.missed,
             text(ring.late_us), text(ring.round_us));
  std::fflush(stdout);
}

// A set of processes without a drive: the remaining time of a tick is available for the drive.
int measure_realtime(const DoctorOptions& o) {
  const RealtimeParameters wanted;
  for (const OtherSet& set : other_sets())
    if (set.realtime)
      fmt::print(stderr,
                 "twinrate: a realtime set runs on this machine ({}): the figures are those "
                 "beside it\n",
                 set.run_dir);
  UdpRing ring(o.normal ? 0 : wanted.priority, !o.normal);
  const bool fifo = has_realtime_policy();
  if (!o.json)
    fmt::print(
        "a datagram passes through three processes each tick, {}{}\n"
        "{:>8} {:>8} {:>8}   {:<24} {}\n",
        fifo ? "SCHED_FIFO, one CPU" : "normal scheduler",
        !fifo && !o.normal ? " (SCHED_FIFO is refused: twinrate doctor)" : "", "Hz", "ticks",
        "missed", "late p50, p99, p99.9, max", "round p50, p99, p99.9, max (us)");
  std::vector<double> rates(std::begin(kRates_Hz), std::end(kRates_Hz));
  if (o.rate_Hz > 0) rates = {o.rate_Hz};
  double held_Hz = 0;
  bool all_before = true;
  for (const double rate_Hz : rates) {
    const RingResult result = ring.run(rate_Hz, o.seconds);
    print(rate_Hz, result, o.json);
    all_before = all_before && result.missed == 0;
    if (all_before) held_Hz = rate_Hz;
  }
  if (o.json)
    std::cout << nlohmann::ordered_json{{"held_Hz", held_Hz}}.dump() << "\n";
  else if (held_Hz > 0)
    fmt::print("up to {:.0f} Hz no datagram was late in {:g} s; a drive computes besides\n",
               held_Hz, o.seconds);
  else
    fmt::print("at {:.0f} Hz datagrams were late\n", rates.front());
  return held_Hz > 0 ? 0 : 3;
}

int run_doctor(const DoctorOptions& options) {
  if (options.realtime) return measure_realtime(options);
  if (options.mend) {
    std::string done;
    const bool works = try_bring_up_multicast(done);
    print({"mended", works ? Severity::kOk : Severity::kFail, done.empty() ? "nothing to do" : done,
           works ? "" : multicast_mend()},
          options.json);
  }
  bool runs = true, mendable = true;
  for (const Finding& finding : examine(options)) {
    print(finding, options.json);
    if (finding.severity != Severity::kFail) continue;
    runs = false;
    mendable = mendable && (finding.check == "loopback" || finding.check == "multicast");
  }
  const bool mends = !runs && mendable;
  if (options.json)
    std::cout
        << nlohmann::ordered_json{{"launch_can_run", runs}, {"launch_tries_to_mend", mends}}.dump()
        << "\n";
  else
    fmt::print("{}\n", runs    ? "launch can run here"
                       : mends ? "launch cannot run here as it is; at its start it tries the same "
                                 "as doctor --mend"
                               : "launch cannot run here");
  return runs ? 0 : 3;
}

}  // namespace

void add_doctor_verb(CLI::App& app, int& exit_code) {
  auto options = std::make_shared<DoctorOptions>();
  auto* verb = app.add_subcommand("doctor", "Check whether this machine can run a drive over LCM");
  verb->add_option("--lcm-url", options->url, "check this LCM URL instead of LCM_DEFAULT_URL");
  verb->add_flag("--mend", options->mend,
                 "bring loopback and the multicast route up first, if permitted");
  verb->add_flag("--json", options->json, "print one JSON line per check");
  verb->add_flag(
      "--realtime", options->realtime,
      "measure at which rates a datagram passes through three processes within its tick");
  verb->add_option("--rate", options->rate_Hz, "with --realtime: measure this rate only, Hz")
      ->check(CLI::Range(1.0, 1e5));
  verb->add_option("--seconds", options->seconds,
                   "with --realtime: measure each rate for this time, s")
      ->check(CLI::Range(0.01, 3600.0));
  verb->add_flag("--normal", options->normal,
                 "with --realtime: use the normal scheduler, do not pin");
  verb->callback([options, &exit_code] { exit_code = run_doctor(*options); });
}

}  // namespace twinrate
