#include "sweep/cost.hpp"

#include <fmt/format.h>

#include <fstream>
#include <nlohmann/json.hpp>

namespace twinrate::sweep {
namespace {

constexpr double kRunsOfDoubling = 6;  // of a background run with policy propagated
constexpr int kDoubledSteps[] = {20, 100, 1000};

std::string how_counted(const Counts& c) {
  return fmt::format("{}\n({}, revision {}): fast {:.0f}, background {:.0f} a step{}\n", c.what,
                     c.compiler, c.revision, c.fast, c.background,
                     c.scheduled > 0 ? fmt::format(", scheduled {:.0f}", c.scheduled) : "");
}

std::string propagated_rows(const Counts& c, double f_s_Hz) {
  if (c.doubled.empty()) return "";
  std::string text = "\nbackground of policy propagated, six propagations by doubling:\n";
  for (const auto& [n, instructions] : c.doubled)
    text += fmt::format("{:>8g} {:>5} {:>14} {:>12} {:>16.3f}\n", f_s_Hz / n, n, "-", "no limit",
                        1e-6 * f_s_Hz / n * kRunsOfDoubling * instructions);
  return text;
}

}  // namespace

std::optional<Counts> read_counts(const std::string& path) {
  std::ifstream file(path);
  const auto json = nlohmann::json::parse(file, nullptr, false);
  if (!json.is_object()) return {};
  Counts c;
  try {
    json.at("what").get_to(c.what);
    json.at("compiler").get_to(c.compiler);
    json.at("revision").get_to(c.revision);
    json.at("fast").get_to(c.fast);
    json.at("background").get_to(c.background);
    for (const int n : kDoubledSteps)
      c.doubled.emplace_back(n, json.at(fmt::format("doubled_{}", n)).get<double>());
  } catch (const nlohmann::json::exception&) {
    return {};
  }
  return c;
}

std::optional<Counts> read_cortex_counts(const std::string& path) {
  std::ifstream file(path);
  const auto json = nlohmann::json::parse(file, nullptr, false);
  if (!json.is_object()) return {};
  Counts c;
  try {
    const auto instructions = [&](const char* step) {
      return json.at("steps").at(step).at("instructions").get<double>();
    };
    c.what = fmt::format("instructions a step on an emulated Cortex-M3, fixed point, by {}",
                         json.at("command").get<std::string>());
    c.compiler = fmt::format("{}; {}", json.at("compiler").get<std::string>(),
                             json.at("emulator").get<std::string>());
    json.at("revision").get_to(c.revision);
    c.fast = instructions("simplified.fast");
    c.background = instructions("simplified.background");
    c.scheduled = instructions("scheduled.fast");
  } catch (const nlohmann::json::exception&) {
    return {};
  }
  return c;
}

std::string propagated_table(const Counts& host, double f_s_Hz) {
  return propagated_rows(host, f_s_Hz) + "\ncounted: " + how_counted(host);
}

std::string cost_table(const Halves& paper, const std::optional<Counts>& counts, double f_s_Hz,
                       const std::vector<double>& f_b_Hz, double gains_a_turn) {
  std::string text = fmt::format("{:>8} {:>5} {:>14} {:>12} {:>16}\n", "f_b Hz", "n",
                                 "paper's code %", "f_emax Hz", "counted, 1e6/s");
  for (double f_b : f_b_Hz) {
    const std::string counted =
        counts ? fmt::format("{:.3f}", 1e-6 * (f_s_Hz * counts->fast + f_b * counts->background))
               : "-";
    text += fmt::format("{:>8g} {:>5g} {:>14.2f} {:>12.0f} {:>16}\n", f_b, f_s_Hz / f_b,
                        100 * processor_share(paper, f_s_Hz, f_b), f_b / gains_a_turn, counted);
  }
  if (!counts)
    return text + "\nnothing is counted here: bench/count_instructions in the source tree counts\n";
  return text + propagated_rows(*counts, f_s_Hz) + "\ncounted: " + how_counted(*counts);
}

}  // namespace twinrate::sweep
