#include "bench/blind/drawn_report.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <functional>
#include <map>
#include <regex>

namespace twinrate::blind {
namespace {

using json = nlohmann::json;

std::string encoder_class(int counts) {
  if (counts == 0) return "sine and cosine";
  if (counts <= 1024) return "512 to 1024";
  if (counts <= 4096) return "1440 to 4096";
  return counts <= 16384 ? "8192 to 16384" : "2^17 and 2^20";
}

// True if a sentence says that an error falls but gives a larger or equal value.
bool falls_upwards(const std::string& sentence) {
  static const std::regex kFall(R"(falls[^.;]*? from ([-+0-9.eE]+)[^0-9]*? to ([-+0-9.eE]+))");
  for (std::sregex_iterator m(sentence.begin(), sentence.end(), kFall), end; m != end; ++m)
    if (std::stod((*m)[2]) >= std::stod((*m)[1])) return true;
  return false;
}

// Effects with the fewest aliases come first, so that an alias group does not take a kind that
// another effect names alone.
void match_effects(const json& unsorted, DrawnRow& row) {
  constexpr std::size_t kLargeGroup = 3;
  std::vector<json> effects(unsorted.begin(), unsorted.end());
  std::stable_sort(effects.begin(), effects.end(), [](const json& a, const json& b) {
    return a.at("aliases").size() < b.at("aliases").size();
  });
  for (const json& e : effects) {
    std::vector<std::string> names = {e.at("kind")};
    for (const json& alias : e.at("aliases")) names.push_back(alias);
    row.found.push_back(fmt::format("{}", fmt::join(names, " or ")));
    const auto hit =
        std::find_first_of(row.missed.begin(), row.missed.end(), names.begin(), names.end());
    const auto known =
        std::find_first_of(row.truth.begin(), row.truth.end(), names.begin(), names.end());
    if (hit != row.missed.end())
      row.missed.erase(hit), row.large_group |= names.size() > kLargeGroup;
    else if (known == row.truth.end() || names.size() == 1)
      row.wrong.push_back(names[0]);
  }
  const auto not_shown = [&](const std::string& kind) {
    return std::find(row.visible.begin(), row.visible.end(), kind) == row.visible.end();
  };
  row.exact = row.missed.empty() && row.wrong.empty();
  row.right = row.wrong.empty() && std::all_of(row.missed.begin(), row.missed.end(), not_shown);
}

struct Tally {
  int logs = 0, exact = 0, right = 0, missed = 0, false_claims = 0, false_logs = 0, wrong_else = 0,
      flawed = 0, blind = 0;
  std::map<std::string, int> verdicts;
  void take(const DrawnRow& r) {
    ++logs, ++verdicts[r.verdict];
    exact += r.exact, right += r.right, missed += !r.missed.empty(), flawed += r.flawed_sentence;
    if (r.false_claim()) ++false_logs, false_claims += static_cast<int>(r.wrong.size());
    blind += r.verdict == "nothing_missing" && !r.visible.empty();
    wrong_else += r.verdict != "traced" && !r.wrong.empty();
  }
  std::string line(const std::string& name) const {
    const auto part = [&](int count) {
      return fmt::format("{} ({:.1f} %)", count, 100.0 * count / std::max(1, logs));
    };
    return fmt::format("| {} | {} | {} | {} | {} | {} | {} |\n", name, logs, part(exact),
                       part(right), part(missed), part(false_logs), part(wrong_else));
  }
};

constexpr const char* kHead =
    "| logs | exact | right as far as it shows | an effect missed | false claim | wrong kind, "
    "other verdict |\n"
    "|---|---|---|---|---|---|---|\n";

using Key = std::function<std::string(const DrawnRow&)>;

std::string by_class(const std::vector<DrawnRow>& rows, const char* title, const Key& key) {
  std::map<std::string, Tally> classes;
  for (const DrawnRow& r : rows) classes[key(r)].take(r);
  std::string text = fmt::format("| {} {}", title, kHead);
  for (const auto& [name, tally] : classes) text += tally.line(name);
  return text + "\n";
}

std::string rate_class(const DrawnRow& r) {
  if (r.rate_Hz > 5000) return r.mode + ", every tick";
  const double rates[] = {200, 500, 1000, 2000};
  for (double rate : rates)
    if (r.rate_Hz < 1.3 * rate) return fmt::format("{}, {} Hz", r.mode, rate);
  return r.mode;
}

std::string effect_count(const DrawnRow& r) {
  return fmt::format("{}", r.truth.size());
}

// True effects by their size in the log, except those on the samples, whose size is infinite.
std::string by_deviations(const std::vector<DrawnRow>& rows) {
  constexpr std::array kEdges = {0.0, 3.1, 6.2, 12.5, 25.0, 50.0, 1e300};
  std::string text = "| deviations | true effects | named |\n|---|---|---|\n";
  for (std::size_t j = 0; j + 1 < kEdges.size(); ++j) {
    int effects = 0, named = 0;
    for (const DrawnRow& r : rows)
      for (const auto& [kind, deviations] : r.deviations)
        if (deviations >= kEdges[j] && deviations < kEdges[j + 1])
          ++effects, named += std::count(r.missed.begin(), r.missed.end(), kind) == 0;
    text += fmt::format("| {} | {} | {} |\n",
                        j + 2 < kEdges.size() ? fmt::format("{} to {}", kEdges[j], kEdges[j + 1])
                                              : fmt::format("from {}", kEdges[j]),
                        effects, named);
  }
  return text + "\n";
}

std::string class_tables(const std::vector<DrawnRow>& rows) {
  std::vector<DrawnRow> all_show;
  for (const DrawnRow& r : rows)
    if (!r.truth.empty() && r.visible.size() == r.truth.size()) all_show.push_back(r);
  std::string text = by_class(rows, "true effects", effect_count);
  text += "Logs that can show all their effects:\n\n";
  text += by_class(all_show, "true effects", effect_count);
  text += by_deviations(rows);
  text += by_class(rows, "profile", [](const DrawnRow& r) { return r.profile; });
  if (!rows.front().spoilt.empty())
    text += by_class(rows, "spoilt by", [](const DrawnRow& r) { return r.spoilt; });
  text += by_class(rows, "mode, rate", rate_class);
  text += by_class(rows, "encoder", [](const DrawnRow& r) { return r.encoder; });
  text += by_class(rows, "counts declared", [](const DrawnRow& r) {
    return r.encoder == "sine and cosine" ? "no counts" : r.counts_declared ? "yes" : "no";
  });
  return text + by_class(rows, "verdict", [](const DrawnRow& r) { return r.verdict; });
}

std::string false_kinds(const std::vector<DrawnRow>& rows) {
  std::map<std::string, int> counts;
  for (const DrawnRow& r : rows)
    if (r.false_claim())
      for (const std::string& kind : r.wrong) ++counts[kind];
  std::vector<std::string> list;
  list.reserve(counts.size());
  for (const auto& [kind, count] : counts) list.push_back(fmt::format("{} {}", kind, count));
  return fmt::format("False claims by kind: {}.\n",
                     list.empty() ? "none" : fmt::format("{}", fmt::join(list, ", ")));
}

}  // namespace

DrawnRow compare(const DrawnCase& c, const std::vector<std::string>& truth,
                 const std::vector<std::string>& visible, const json& trace) {
  DrawnRow row{.name = c.name,
               .profile = c.profile,
               .mode = c.mode,
               .encoder = encoder_class(c.drawn.encoder_counts),
               .counts_declared = c.drawn.counts_declared,
               .rate_Hz = c.drawn.f_s / c.every,
               .truth = truth,
               .visible = visible,
               .found = {},
               .verdict = trace.at("verdict"),
               .sentence = trace.at("sentence"),
               .spoilt = "",
               .wrong = {},
               .missed = truth};
  match_effects(trace.at("effects"), row);
  for (const json& s : trace.at("unexplained").at("where")) {
    row.found.push_back("unexplained: " + s.at("regressor").get<std::string>());
    row.exact = row.right = false;
  }
  row.flawed_sentence = falls_upwards(row.sentence);
  row.seconds = trace.value("seconds", 0.0);
  return row;
}

nlohmann::ordered_json to_json(const DrawnRow& r) {
  return {{"name", r.name},
          {"profile", r.profile},
          {"mode", r.mode},
          {"rate_Hz", r.rate_Hz},
          {"encoder", r.encoder},
          {"counts_declared", r.counts_declared},
          {"spoilt", r.spoilt},
          {"truth", r.truth},
          {"visible", r.visible},
          {"deviations", r.deviations},
          {"found", r.found},
          {"verdict", r.verdict},
          {"exact", r.exact},
          {"right", r.right},
          {"large_group", r.large_group},
          {"false_claim", r.false_claim()},
          {"wrong", r.wrong},
          {"missed", r.missed},
          {"flawed_sentence", r.flawed_sentence},
          {"sentence", r.sentence},
          {"seconds", r.seconds}};
}

std::string tables(const std::vector<DrawnRow>& rows) {
  if (rows.empty()) return "no logs\n";
  Tally all;
  std::vector<double> seconds;
  for (const DrawnRow& r : rows) all.take(r), seconds.push_back(r.seconds);
  std::sort(seconds.begin(), seconds.end());
  const auto quantile = [&](double q) {
    return seconds[static_cast<std::size_t>(q * static_cast<double>(seconds.size() - 1))];
  };
  return fmt::format("| all {}{}\n", kHead, all.line("all")) + class_tables(rows) +
         false_kinds(rows) +
         fmt::format(
             "\"Nothing missing\" of a log that shows an effect: {} of {}.\n"
             "Sentences that say \"falls\" of an error that does not: {}.\n"
             "Time of a trace: median {:.2f} s, 95 % below {:.2f} s, longest {:.2f} s.\n",
             all.blind, all.verdicts["nothing_missing"], all.flawed, quantile(0.5), quantile(0.95),
             quantile(1));
}

}  // namespace twinrate::blind
