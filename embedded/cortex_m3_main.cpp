// cortex_m3: the Cortex-M3 firmware in the emulator.
//
//   cortex_m3 count [--json FILE]      instructions and estimated cycles beside the paper's tables
//   cortex_m3 loop DRIVE ..            a run of the drive with the processor in the loop
//   cortex_m3 estimator ..             the processor as a process of `twinrate launch`
//   cortex_m3 fbmin DRIVE ..           f_bmin of the fixed-point filter beside the double one (host)
//   cortex_m3 standstill DRIVE ..      hours at standstill, every operation checked (host)
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <fstream>

#include "core/config.hpp"
#include "core/report_error.hpp"
#include "embedded/cortex_loop.hpp"
#include "embedded/cortex_process.hpp"
#include "embedded/fixed_studies.hpp"
#include "embedded/instruction_counts.hpp"
#include "loop/load_drive.hpp"

namespace twinrate {
namespace {

void add_count(CLI::App& app) {
  CLI::App* verb = app.add_subcommand("count", "Count the instructions of each step of the filter");
  auto json = std::make_shared<std::string>();
  verb->add_option("--json", *json, "write the counts to this file");
  verb->callback([json] {
    const CortexCounts counts = count_instructions();
    fmt::print("{}", cortex_table(counts));
    if (!json->empty() && !(std::ofstream(*json) << to_json(counts)))
      throw BadInput(*json + ": cannot be written");
  });
}

struct LoopOptions {
  std::string drive, log, link = "semihosting";
  std::vector<std::string> overrides;
  double period_us = 200;
};

// 0: synchronism was kept.
int loop(const LoopOptions& o) {
  Config config = load_drive(o.drive, o.overrides);
  const CortexLink link = o.link == "uart" ? CortexLink::kUart : CortexLink::kSemihosting;
  const CortexRun run = run_cortex_loop(config, link, 1e-6 * o.period_us, o.log);
  fmt::print("{}", to_text(run, config.drive(), link));
  return run.locked ? 0 : 1;
}

void add_loop(CLI::App& app, int& exit_code) {
  CLI::App* verb = app.add_subcommand("loop", "Run a drive with the processor in the loop");
  auto o = std::make_shared<LoopOptions>();
  verb->add_option("DRIVE", o->drive, "run this drive file or preset")->required();
  verb->add_option("--set", o->overrides, "override a key of the drive file: key.path=value")
      ->allow_extra_args(false);
  verb->add_option("--link", o->link, "choose the link: semihosting, or uart (default semihosting)")
      ->check(CLI::IsMember({"semihosting", "uart"}));
  verb->add_option("--period-us", o->period_us,
                   "set the control period in the processor's own time, 31.25 instructions a us "
                   "(default 200)")
      ->check(CLI::Range(2.0, 1e5));
  verb->add_option("--log", o->log, "write every answer of the processor to this CSV file");
  verb->callback([o, &exit_code] { exit_code = loop(*o); });
}

// The options that launch gives to every process follow the options of this program.
void add_estimator(CLI::App& app, int& exit_code) {
  CLI::App* verb = app.add_subcommand(
      "estimator",
      "Estimate on the processor for a launched set: estimator and gain in one process");
  auto o = std::make_shared<LoopOptions>();
  verb->add_option("--link", o->link, "choose the link: semihosting, or uart (default semihosting)")
      ->check(CLI::IsMember({"semihosting", "uart"}));
  verb->add_option("--period-us", o->period_us,
                   "set the control period in the processor's own time (default 200)")
      ->check(CLI::Range(2.0, 1e5));
  verb->allow_extras();
  verb->callback([o, verb, &exit_code] {
    std::vector<std::string> rest = verb->remaining();
    rest.insert(rest.begin(), "cortex_m3 estimator");
    std::vector<char*> argv;
    argv.reserve(rest.size());
    for (std::string& argument : rest) argv.push_back(argument.data());
    const CortexLink link = o->link == "uart" ? CortexLink::kUart : CortexLink::kSemihosting;
    exit_code =
        run_cortex_process(static_cast<int>(argv.size()), argv.data(), link, 1e-6 * o->period_us);
  });
}

struct LimitOptions {
  std::string drive;
  std::vector<double> speeds_Hz = {10, 20, 30, 50, 64, 80, 100, 150, 200};
  std::string start = "ramp";
  LimitStudy study;
};

void limits(const LimitOptions& o) {
  LimitStudy study = o.study;
  study.switched = o.start == "switched";
  const double f_s_Hz = load_drive(o.drive).drive().rates.f_s_Hz;
  fmt::print("{:>7} {:>18} {:>18} {:>16}\n", "f_e Hz", "n_max fixed/double", "f_bmin Hz",
             "f_bmin/f_e");
  for (const double f_e : o.speeds_Hz) {
    const LimitPair p = find_limits(o.drive, study, f_e);
    const auto both = [](double fixed, double exact) {
      return fmt::format("{:.4g} / {:.4g}", fixed, exact);
    };
    const auto f_b = [&](int n) { return n > 0 ? f_s_Hz / n : 0.0; };
    fmt::print("{:>7g} {:>18} {:>18} {:>16}\n", f_e, both(p.n_max_fixed, p.n_max_double),
               both(f_b(p.n_max_fixed), f_b(p.n_max_double)),
               both(f_b(p.n_max_fixed) / f_e, f_b(p.n_max_double) / f_e));
    std::fflush(stdout);
  }
}

void add_limits(CLI::App& app) {
  CLI::App* verb =
      app.add_subcommand("fbmin", "Find f_bmin of the fixed-point filter and of the double one");
  auto o = std::make_shared<LimitOptions>();
  verb->add_option("DRIVE", o->drive, "run this drive file or preset")->required();
  verb->add_option("--speeds", o->speeds_Hz, "set the electrical frequencies f_e, Hz")
      ->delimiter(',');
  verb->add_option("--policy", o->study.policy,
                   "choose the policy: paper or rotate (default paper)")
      ->check(CLI::IsMember({"paper", "rotate"}));
  verb->add_option("--start", o->start,
                   "choose the start: ramp, or switched: n = 1 until 0.2 s at speed (default ramp)")
      ->check(CLI::IsMember({"ramp", "switched"}));
  verb->add_option("--seeds", o->study.seeds,
                   "run every point with this many noise seeds (default 5)")
      ->check(CLI::Range(1, 1000));
  verb->add_option("--n-max", o->study.n_max, "end the search at this n (default 200)")
      ->check(CLI::Range(1, 100000));
  verb->callback([o] { limits(*o); });
}

void add_standstill(CLI::App& app) {
  CLI::App* verb =
      app.add_subcommand("standstill", "Hold the rotor still with every operation checked");
  auto drive = std::make_shared<std::string>();
  auto hours = std::make_shared<double>(1);
  verb->add_option("DRIVE", *drive, "run this drive file or preset")->required();
  verb->add_option("--hours", *hours, "set the drive time (default 1)");
  verb->callback([=] { fmt::print("{}", standstill(*drive, *hours)); });
}

int run(int argc, char** argv) {
  CLI::App app("Runs the Cortex-M3 firmware in the emulator");
  app.require_subcommand(1);
  int exit_code = 0;
  add_count(app);
  add_loop(app, exit_code);
  add_estimator(app, exit_code);
  add_limits(app);
  add_standstill(app);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  } catch (...) {
    return report_error("cortex_m3");
  }
  return exit_code;
}

}  // namespace
}  // namespace twinrate

int main(int argc, char** argv) try { return twinrate::run(argc, argv); } catch (...) {
  return twinrate::report_error("cortex_m3");
}
