// The table of bench/faults: options, trials, rows.
#pragma once
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <map>
#include <string>
#include <vector>

#include "model/random.hpp"

namespace twinrate::faults {

struct Options {
  std::string drive = "dilys2021", only, twinrate;
  bool messages = false;
  int trials = 20, seed = 1;
};

// One of `count` numbers, by row and trial.
inline std::int64_t draw(const Options& o, std::size_t row, int trial, std::int64_t count) {
  const auto index = static_cast<std::uint64_t>(1000 * row) + static_cast<std::uint64_t>(trial);
  const double u = uniform(static_cast<std::uint64_t>(o.seed), 7, index);
  return std::min(count - 1, static_cast<std::int64_t>(u * static_cast<double>(count)));
}

inline std::string spread(std::vector<double> values, const char* unit) {
  if (values.empty()) return "-";
  std::sort(values.begin(), values.end());
  return fmt::format("{:.3g} ({:.3g}) {}", values.back(), values[values.size() / 2], unit);
}

struct Trial {
  bool detected = false, as_expected = false;
  double detected_after = 0, off_after = -1, end_after = -1;
  std::string did, lost;
};

// `ends`: the trials are of processes, which end.
inline void print_row(const std::string& fault, const std::vector<Trial>& trials, const char* unit,
                      bool ends) {
  std::vector<double> detected, off, end;
  std::map<std::string, int> did, lost;
  int expected = 0;
  for (const Trial& t : trials) {
    if (t.detected) detected.push_back(t.detected_after);
    if (t.off_after >= 0) off.push_back(t.off_after);
    if (t.end_after >= 0) end.push_back(t.end_after);
    ++did[t.did];
    ++lost[t.lost];
    expected += t.as_expected;
  }
  const auto counted = [&](const std::map<std::string, int>& texts) {
    std::vector<std::string> list;
    list.reserve(texts.size());
    for (const auto& [text, count] : texts)
      list.push_back(texts.size() > 1 ? fmt::format("{} ({})", text, count) : text);
    return fmt::format("{}", fmt::join(list, "; "));
  };
  fmt::print("| {} | {} of {} | {} | {} | {}{} | {} |\n", fault, expected, trials.size(),
             spread(detected, unit), spread(off, unit), ends ? spread(end, "s") + " | " : "",
             counted(did), counted(lost));
  std::fflush(stdout);
}

inline void print_header(bool ends) {
  fmt::print(
      "| fault | as expected | detected after | off after |{} what the drive did | what was lost "
      "|\n|---|---|---|---|---|---|{}\n",
      ends ? " end after |" : "", ends ? "---|" : "");
  std::fflush(stdout);  // a child would print it again
}

// Rows of processes of a launched set (process_faults.cpp). True where every trial is as expected.
bool run_set_rows(const Options& o);
// Rows of messages that somebody else sends to a launched set (message_faults.cpp). True where every
// trial is as expected.
bool run_message_rows(const Options& o);

}  // namespace twinrate::faults
