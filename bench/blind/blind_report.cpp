#include "bench/blind/blind_report.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

namespace twinrate::blind {
namespace {

using json = nlohmann::ordered_json;

template <class Condition>
double share(const std::vector<double>& values, Condition&& condition) {
  const auto count = std::count_if(values.begin(), values.end(), condition);
  return 100.0 * static_cast<double>(count) /
         std::max<double>(1, static_cast<double>(values.size()));
}

double quantile(std::vector<double> values, double q) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(q * static_cast<double>(values.size() - 1))];
}

std::string by_set(const std::vector<Row>& rows) {
  std::string text =
      "| set | logs | right | share | median CPU time | longest |\n|---|---|---|---|---|---|\n";
  for (const char* set : {"single", "double", "triple", "poor", "none"}) {
    std::vector<double> right, seconds;
    for (const Row& r : rows)
      if (r.set == set) right.push_back(r.exact), seconds.push_back(r.seconds);
    if (right.empty()) continue;
    const double part = share(right, [](double x) { return x > 0; });
    text += fmt::format("| {} | {} | {:.0f} | {:.1f} % | {:.1f} s | {:.1f} s |\n", set,
                        right.size(), part * static_cast<double>(right.size()) / 100, part,
                        quantile(seconds, 0.5), quantile(seconds, 1));
  }
  return text;
}

std::string confusion(const std::vector<Row>& rows) {
  std::map<std::string, std::map<std::string, int>> cells;
  for (const Row& r : rows)
    if (r.set == "single" || r.set == "none")
      ++cells[r.kinds.empty() ? "(nothing)" : r.kinds[0]]
             [r.found.empty() ? "nothing" : fmt::format("{}", fmt::join(r.found, " + "))];
  std::string text = "| missing in the model | found (logs) |\n|---|---|\n";
  for (const auto& [kind, found] : cells) {
    std::vector<std::string> list;
    list.reserve(found.size());
    for (const auto& [name, count] : found) list.push_back(fmt::format("{} ({})", name, count));
    text += fmt::format("| {} | {} |\n", kind, fmt::join(list, ", "));
  }
  return text;
}

}  // namespace

std::vector<Row> read_rows(const std::string& path) {
  std::vector<Row> rows;
  std::ifstream file(path);
  if (!file) return rows;
  const json all = json::parse(file);
  for (const json& j : all.at("cases")) {
    Row r{.name = j.at("name"), .set = j.at("set"), .kinds = j.at("kinds"), .found = j.at("found")};
    r.exact = j.at("exact");
    r.sigmas = j.at("sigmas").get<std::vector<double>>();
    r.electrical_ratio = j.at("electrical_ratio");
    r.mechanical_ratio = j.at("mechanical_ratio");
    r.seconds = j.at("seconds");
    rows.push_back(std::move(r));
  }
  return rows;
}

void write_rows(const std::string& path, const std::vector<Row>& rows) {
  json list = json::array();
  for (const Row& r : rows)
    list.push_back({{"name", r.name},
                    {"set", r.set},
                    {"kinds", r.kinds},
                    {"found", r.found},
                    {"exact", r.exact},
                    {"sigmas", r.sigmas},
                    {"electrical_ratio", r.electrical_ratio},
                    {"mechanical_ratio", r.mechanical_ratio},
                    {"seconds", r.seconds}});
  std::ofstream(path) << json{{"cases", list}}.dump(1) << "\n";
}

std::string tables(const std::vector<Row>& rows) {
  constexpr double kMaxErrorRatio = 1.15;
  std::vector<double> sigmas, ratios;
  for (const Row& r : rows) {
    sigmas.insert(sigmas.end(), r.sigmas.begin(), r.sigmas.end());
    for (double ratio : {r.electrical_ratio, r.mechanical_ratio})
      if (ratio > 0) ratios.push_back(ratio);
  }
  std::string text = by_set(rows);
  text += fmt::format(
      "\n{} parameters: {:.1f} % within one standard deviation, {:.1f} % within three.\n",
      sigmas.size(), share(sigmas, [](double s) { return std::abs(s) < 1; }),
      share(sigmas, [](double s) { return std::abs(s) < 3; }));
  if (!ratios.empty())
    text += fmt::format(
        "Held-out error after, over that of the true model ({} equations): median {:.3f}, 95 % "
        "below {:.3f}; {:.1f} % at most {}.\n",
        ratios.size(), quantile(ratios, 0.5), quantile(ratios, 0.95),
        share(ratios, [](double r) { return r <= kMaxErrorRatio; }), kMaxErrorRatio);
  return text + "\n" + confusion(rows);
}

}  // namespace twinrate::blind
