// twinrate doctor: checks that this machine can run the process set; prints the commands that mend
// it.
#include <fmt/format.h>

#include <algorithm>
#include <iostream>
#include <nlohmann/json.hpp>

#include "core/bus.hpp"
#include "core/multicast.hpp"
#include "tools/doctor/checks.hpp"
#include "tools/verb.hpp"

namespace twinrate {
namespace {

struct DoctorOptions {
  std::string url;
  bool json = false, mend = false;
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
    // Loopback is not needed where multicast works over another interface.
    if (findings.back().severity == Severity::kOk && findings[1].severity == Severity::kFail)
      findings[1].severity = Severity::kWarn;
  }
  for (const auto check : {check_receive_buffer, check_cpus, check_clock, check_realtime_rights,
                           check_governor, check_stock_tools, check_disk})
    findings.push_back(check());
  return findings;
}

int run_doctor(const DoctorOptions& options) {
  if (options.mend) {
    std::string done;
    const bool works = try_bring_up_multicast(done);
    print({"mended", works ? Severity::kOk : Severity::kFail, done.empty() ? "nothing to do" : done,
           works ? "" : multicast_mend()},
          options.json);
  }
  Severity worst = Severity::kOk;
  for (const Finding& finding : examine(options)) {
    print(finding, options.json);
    worst = std::max(worst, finding.severity);
  }
  const bool runs = worst != Severity::kFail;
  if (options.json)
    std::cout << nlohmann::ordered_json{{"launch_can_run", runs}}.dump() << "\n";
  else
    fmt::print("{}\n", runs ? "launch can run here" : "launch cannot run here");
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
  verb->callback([options, &exit_code] { exit_code = run_doctor(*options); });
}

}  // namespace twinrate
