// Every filter with every controller, on every paper's drive, at n = 1, 5, 20, from every start:
// locked, warned, refused, lost, tripped or error, one line each, and the counts. A pairing must run
// locked, or be refused, or be warned of: exit code 1 if one is lost without a warning, or ends in
// an error.
//
//   pairings [--preset P] [--estimator K] [--controller K] [--start S] [--n N] [--only STATUS]
//   pairings --random COUNT [--seed S]     machines drawn at random (bench/random_drive.hpp)
//   pairings --show INDEX [--seed S]       the drive file of one of them
//   pairings --theory ..                   the warnings of theory alone, without the trial of `check`
//
// 2.4 s of drive time with the last third judged.
#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <map>
#include <mutex>
#include <thread>

#include "bench/command_line.hpp"
#include "bench/random_drive.hpp"
#include "controller/controller.hpp"
#include "core/report_error.hpp"
#include "estimator/registry.hpp"
#include "loop/load_drive.hpp"
#include "loop/runnable.hpp"
#include "loop/trial_run.hpp"

namespace twinrate {
namespace {

struct Pairing {
  std::string preset, estimator, controller, start;
  int n = 1;
  std::string status, why;
  std::string text;  // the drive file, where no preset
};

constexpr double kDuration_s = 2.4;

std::vector<std::string> overrides_of(const Pairing& p) {
  return {"estimator.kind=" + p.estimator,
          "controller.kind=" + p.controller,
          "start=" + p.start,
          fmt::format("rates.n={}", p.n),
          fmt::format("run.duration_s={}", kDuration_s),
          fmt::format("run.settle_s={}", kDuration_s * 2 / 3)};
}

// What check says, and what the run does.
void judge(Pairing& p, bool theory_alone) {
  try {
    std::optional<Config> config;
    std::vector<std::string> warnings;
    try {
      if (p.text.empty()) {
        config = load_drive(p.preset, overrides_of(p));
      } else {
        config = Config::parse(p.text, p.preset);
        read_all_tables(*config);
      }
      warnings = theory_alone ? texts_of(check_runnable(*config))
                              : check_by_trial(*config, Trial::kAlways);
    } catch (const BadInput& refusal) {
      p.status = "refused";
      p.why = refusal.what();
      return;
    }
    const TrialRun run = try_run(*config, config->drive().steps());
    p.status = run.bad_at_s < 0 ? "locked" : run.tripped ? "tripped" : "lost";
    if (run.bad_at_s >= 0) p.why = fmt::format("{:.3f} s: {}", run.bad_at_s, run.why);
    if (warnings.empty()) return;
    p.why = p.status + "; " + warnings.front();
    if (p.status != "locked") p.status = "warned";
  } catch (const std::exception& error) {
    p.status = "error";
    p.why = error.what();
  }
}

void judge_all(std::vector<Pairing>& all, bool theory_alone) {
  std::atomic<std::size_t> next = 0;
  std::vector<std::jthread> threads;
  for (unsigned i = 0; i < std::max(1u, std::thread::hardware_concurrency()); ++i)
    threads.emplace_back([&] {
      for (std::size_t at = next++; at < all.size(); at = next++) judge(all[at], theory_alone);
    });
}

struct Selection {
  std::string preset, estimator, controller, start, only;
  int n = 0;
  bool takes(const Pairing& p) const {
    const auto fits = [](const std::string& wanted, const std::string& is) {
      return wanted.empty() || wanted == is;
    };
    return fits(preset, p.preset) && fits(estimator, p.estimator) &&
           fits(controller, p.controller) && fits(start, p.start) && (n == 0 || n == p.n);
  }
};

std::vector<Pairing> pairings(const Selection& filter) {
  std::vector<Pairing> all;
  for (const char* preset : {"dilys2021", "niewiara2020", "kim-ipmsm"})
    for (const std::string& estimator : filter_kinds())
      for (const std::string& controller : controller_kinds())
        for (const char* start : kStartNames)
          for (const int n : {1, 5, 20})
            if (const Pairing p{preset, estimator, controller, start, n, "", "", ""};
                filter.takes(p))
              all.push_back(p);
  return all;
}

std::vector<Pairing> random_pairings(const Selection& filter, int count, int seed) {
  std::vector<Pairing> all;
  for (int i = 0; i < count; ++i) {
    const bench::RandomDrive d =
        bench::draw_drive(static_cast<std::uint64_t>(seed), static_cast<std::uint64_t>(i));
    const Pairing p{fmt::format("{:>4} {} {}", i, d.machine, d.policy),
                    d.estimator,
                    d.controller,
                    d.start,
                    d.n,
                    "",
                    "",
                    d.text};
    if (filter.takes(p)) all.push_back(p);
  }
  return all;
}

}  // namespace
}  // namespace twinrate

int main(int argc, char** argv) try {
  using namespace twinrate;
  bench::CommandLine command_line(
      "Run every filter with every controller, drive, rate ratio and start");
  Selection filter;
  command_line.option("--preset", &filter.preset, "only this preset");
  command_line.option("--estimator", &filter.estimator, "only this filter");
  command_line.option("--controller", &filter.controller, "only this controller");
  command_line.option("--start", &filter.start, "only this start");
  command_line.option("--n", &filter.n, "only this n");
  command_line.option("--only", &filter.only, "print only pairings of this status");
  int random = 0, show = -1, seed = 1;
  bool theory_alone = false;
  command_line.flag("--theory", theory_alone, "take the warnings of theory without the trial");
  command_line.option("--random", &random,
                      "this many machines drawn at random instead of the presets");
  command_line.option("--seed", &seed, "of the draw");
  command_line.option("--show", &show, "print the drive file of this one of them");
  if (const auto status = command_line.parse(argc, argv)) return *status;
  if (show >= 0) {
    fmt::print(
        "{}",
        bench::draw_drive(static_cast<std::uint64_t>(seed), static_cast<std::uint64_t>(show)).text);
    return 0;
  }
  std::vector<Pairing> all = random > 0 ? random_pairings(filter, random, seed) : pairings(filter);
  judge_all(all, theory_alone);
  std::map<std::string, int> counts;
  for (const Pairing& p : all) {
    ++counts[p.status];
    if (filter.only.empty() || filter.only == p.status)
      fmt::print("{:<12} {:<15} {:<4} {:<8} {:>2}  {:<8} {}\n", p.preset, p.estimator, p.controller,
                 p.start, p.n, p.status, p.why);
  }
  for (const auto& [status, count] : counts) fmt::print("{} {}\n", count, status);
  fmt::print("{} locked though check warned\n", std::count_if(all.begin(), all.end(), [](auto& p) {
               return p.status == "locked" && !p.why.empty();
             }));
  return counts["lost"] + counts["tripped"] + counts["error"] > 0 ? 1 : 0;
} catch (...) {
  return twinrate::report_error("pairings");
}
