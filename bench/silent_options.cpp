// Every option of the reference page, one at a time, with every filter, controller and start: it changes
// the run, is refused by name, or acts elsewhere (tests/support/option_probe.hpp). Exit code 1 if one
// is silent or ends in an error.
//
//   silent_options [--preset P ..] [--estimator K] [--controller K] [--start S] [--key BEGINNING]
//                  [--all | --table]
//
// --all prints every option; without it those that are silent or end in an error, and the counts.
// --table prints a row per option, in Markdown: the table of docs/options-that-act.md.
#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <map>
#include <thread>

#include "bench/command_line.hpp"
#include "controller/controller.hpp"
#include "core/report_error.hpp"
#include "estimator/registry.hpp"
#include "tests/support/option_probe.hpp"

namespace twinrate::test {
namespace {

constexpr const char* kAnswers[] = {"changes", "refused", "elsewhere", "silent", "error"};

struct Selection {
  std::vector<std::string> presets{"kim-ipmsm"};
  std::string estimator, controller, start, key;
  bool all = false, table = false;
};

// One option over all pairings.
struct OptionRow {
  std::map<OptionAnswer, int> counts;
  std::map<std::string, int> with;       // situations in which it acts, "": the pairing's own run
  std::map<std::string, int> read_with;  // of the refusals
  std::string elsewhere;
  void add(const OptionProbe& probe) {
    ++counts[probe.answer];
    if (probe.answer == OptionAnswer::kChanges) ++with[probe.with];
    if (probe.answer == OptionAnswer::kElsewhere) elsewhere = probe.why;
    const std::string mark = "it is read with ";
    const auto at = probe.why.find(mark);
    if (probe.answer == OptionAnswer::kRefused && at != std::string::npos)
      ++read_with[probe.why.substr(at + mark.size())];
  }
  void add(const OptionRow& other) {
    for (const auto& [answer, count] : other.counts) counts[answer] += count;
    for (const auto& [text, count] : other.with) with[text] += count;
    for (const auto& [text, count] : other.read_with) read_with[text] += count;
    if (!other.elsewhere.empty()) elsewhere = other.elsewhere;
  }
};

struct Rows {
  std::string text;
  std::map<OptionAnswer, int> counts;
  std::vector<std::string> keys;  // in the order of the reference page
  std::map<std::string, OptionRow> options;
};

std::string most_frequent(const std::map<std::string, int>& texts) {
  const auto more = [](const auto& a, const auto& b) { return a.second < b.second; };
  const auto most = std::max_element(texts.begin(), texts.end(), more);
  return most == texts.end() ? "" : most->first;
}

std::string words_of(const OptionRow& row) {
  std::string words;
  const auto add = [&](const std::string& text) { words += (words.empty() ? "" : "; ") + text; };
  if (!row.with.empty() && !row.with.contains(""))
    add("acts with `" + most_frequent(row.with) + "`");
  if (row.with.contains("")) add("acts in the run itself");
  if (!row.elsewhere.empty()) add("acts elsewhere: " + row.elsewhere);
  if (!row.read_with.empty()) add("else refused: read with " + most_frequent(row.read_with));
  return words;
}

void print_markdown(const std::vector<Rows>& all) {
  std::vector<std::string> keys;
  std::map<std::string, OptionRow> options;
  for (const Rows& rows : all) {
    for (const std::string& key : rows.keys)
      if (!options.contains(key)) options[key], keys.push_back(key);
    for (const auto& [key, row] : rows.options) options[key].add(row);
  }
  fmt::print(
      "| option | changes | refused | elsewhere | silent | words |\n|---|---|---|---|---|---|\n");
  for (const std::string& key : keys) {
    OptionRow& row = options[key];
    fmt::print("| `{}` | {} | {} | {} | {} | {} |\n", key, row.counts[OptionAnswer::kChanges],
               row.counts[OptionAnswer::kRefused], row.counts[OptionAnswer::kElsewhere],
               row.counts[OptionAnswer::kSilent] + row.counts[OptionAnswer::kError], words_of(row));
  }
  fmt::print("\n");
}

Rows rows_of(const Pairing& p, const Selection& s) {
  Rows rows;
  OptionProber prober(p);
  for (const Option& option : options_of(p)) {
    if (!option.key.starts_with(s.key)) continue;
    const OptionProbe probe = prober.probe(option);
    ++rows.counts[probe.answer];
    if (s.table) {
      rows.keys.push_back(option.key);
      rows.options[option.key].add(probe);
    }
    if (s.all || probe.answer == OptionAnswer::kSilent || probe.answer == OptionAnswer::kError)
      rows.text +=
          fmt::format("{:<15} {:<4} {:<8} {:<45} {:<9} {}\n", p.estimator, p.controller, p.start,
                      option.key, kAnswers[static_cast<int>(probe.answer)], probe.why);
  }
  return rows;
}

int print_table(const Selection& s) {
  std::vector<Pairing> pairings;
  for (const std::string& preset : s.presets)
    for (const std::string& estimator : filter_kinds())
      for (const std::string& controller : controller_kinds())
        for (const char* start : kStartNames)
          if ((s.estimator.empty() || s.estimator == estimator) &&
              (s.controller.empty() || s.controller == controller) &&
              (s.start.empty() || s.start == start))
            pairings.push_back({preset, estimator, controller, start});
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
  if (s.table) print_markdown(rows);
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
  bench::CommandLine command_line("Set every option one at a time and see what it does");
  test::Selection s;
  command_line.option("--preset", &s.presets, "machines of these presets");
  command_line.option("--estimator", &s.estimator, "only this filter");
  command_line.option("--controller", &s.controller, "only this controller");
  command_line.option("--start", &s.start, "only this start");
  command_line.option("--key", &s.key, "only options that begin so");
  command_line.flag("--all", s.all, "print every option");
  command_line.flag("--table", s.table, "print a row per option, in Markdown");
  if (const auto status = command_line.parse(argc, argv)) return *status;
  return test::print_table(s);
} catch (...) {
  return twinrate::report_error("silent_options");
}
