// Every option of the reference page, one at a time, with every filter, controller and start: it changes
// the run, is refused by name, or acts elsewhere (tests/support/option_probe.hpp). Exit code 1 if one
// is silent or ends in an error.
//
//   silent_options [--preset P] [--estimator K] [--controller K] [--start S] [--key BEGINNING] [--all]
//
// --all prints every option; without it those that are silent or end in an error, and the counts.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <map>
#include <thread>

#include "controller/controller.hpp"
#include "core/report_error.hpp"
#include "estimator/registry.hpp"
#include "tests/support/option_probe.hpp"

namespace twinrate::test {
namespace {

constexpr const char* kAnswers[] = {"changes", "refused", "elsewhere", "silent", "error"};

struct Selection {
  std::string preset = "kim-ipmsm", estimator, controller, start, key;
  bool all = false;
};

struct Rows {
  std::string text;
  std::map<OptionAnswer, int> counts;
};

Rows rows_of(const Pairing& p, const Selection& s) {
  Rows rows;
  OptionProber prober(p);
  for (const Option& option : options_of(p)) {
    if (!option.key.starts_with(s.key)) continue;
    const OptionProbe probe = prober.probe(option);
    ++rows.counts[probe.answer];
    if (s.all || probe.answer == OptionAnswer::kSilent || probe.answer == OptionAnswer::kError)
      rows.text +=
          fmt::format("{:<15} {:<4} {:<8} {:<45} {:<9} {}\n", p.estimator, p.controller, p.start,
                      option.key, kAnswers[static_cast<int>(probe.answer)], probe.why);
  }
  return rows;
}

int print_table(const Selection& s) {
  std::vector<Pairing> pairings;
  for (const std::string& estimator : filter_kinds())
    for (const std::string& controller : controller_kinds())
      for (const char* start : kStartNames)
        if ((s.estimator.empty() || s.estimator == estimator) &&
            (s.controller.empty() || s.controller == controller) &&
            (s.start.empty() || s.start == start))
          pairings.push_back({s.preset, estimator, controller, start});
  std::vector<Rows> rows(pairings.size());
  {
    std::atomic<std::size_t> next = 0;
    std::vector<std::jthread> threads;
    for (unsigned i = 0; i < std::max(1u, std::thread::hardware_concurrency()); ++i)
      threads.emplace_back([&] {
        for (std::size_t at = next++; at < pairings.size(); at = next++)
          rows[at] = rows_of(pairings[at], s);
      });
  }
  std::map<OptionAnswer, int> counts;
  for (const Rows& some : rows) {
    fmt::print("{}", some.text);
    for (const auto& [answer, count] : some.counts) counts[answer] += count;
  }
  fmt::print("{} pairings\n", pairings.size());
  for (const auto& [answer, count] : counts)
    fmt::print("{} {}\n", count, kAnswers[static_cast<int>(answer)]);
  return counts[OptionAnswer::kSilent] + counts[OptionAnswer::kError] > 0 ? 1 : 0;
}

}  // namespace
}  // namespace twinrate::test

int main(int argc, char** argv) try {
  using namespace twinrate;
  CLI::App app("Set every option one at a time and see what it does");
  test::Selection s;
  app.add_option("--preset", s.preset, "machine of this preset");
  app.add_option("--estimator", s.estimator, "only this filter");
  app.add_option("--controller", s.controller, "only this controller");
  app.add_option("--start", s.start, "only this start");
  app.add_option("--key", s.key, "only options that begin so");
  app.add_flag("--all", s.all, "print every option");
  CLI11_PARSE(app, argc, argv);
  return test::print_table(s);
} catch (...) {
  return twinrate::report_error("silent_options");
}
