#include <fmt/format.h>

#include "embedded/instruction_counts.hpp"

namespace twinrate {
namespace {

// Dilys 2021, Table 2, us at 72 MHz: no optimisation, compiler, compiler and user.
struct PaperRow {
  const char *name, *step;
  double none, compiler, user;
};
constexpr PaperRow kTable2[] = {{"P^-", "P_prior", 97.2, 56.8, 13.4}, {"K", "K", 56.0, 34.0, 5.4},
                                {"P", "P", 78.0, 48.8, 9.6},          {"F, B", "F", 4.4, 3.2, 3.2},
                                {"x^-", "x_prior", 7.2, 4.4, 4.4},    {"x", "x", 17.6, 12.6, 1.7}};
constexpr double kPaperTotal[] = {260.4, 159.8, 37.7};
constexpr double kClock_MHz = 72;

StepCount sum(const CortexCounts& counts, const std::string& prefix) {
  StepCount total;
  for (const PaperRow& row : kTable2) {
    const StepCount& s = counts.at(prefix + row.step);
    total.instructions += s.instructions;
    total.cycles_low += s.cycles_low;
    total.cycles_high += s.cycles_high;
  }
  return total;
}

std::string cell(const StepCount& s) {
  return fmt::format("{:>7.0f} {:>6.0f}-{:<6.0f}", s.instructions, s.cycles_low, s.cycles_high);
}

constexpr const char* kVariants[] = {"matrix_O0.", "matrix_O2.", "simplified."};

std::string table_2(const CortexCounts& c) {
  std::string text = fmt::format(
      "Table 2: instructions and estimated cycles of a step; in brackets the paper's cycles\n"
      "{:8}{:^22}{:^9}{:^22}{:^9}{:^22}{:^9}\n",
      "", "generic -O0", "(none)", "generic -O2", "(compiler)", "simplified -O2", "(user)");
  for (const PaperRow& row : kTable2) {
    const double paper[] = {row.none, row.compiler, row.user};
    text += fmt::format("{:6}", row.name);
    for (int v = 0; v < 3; ++v)
      text += fmt::format("  {} ({:.0f})", cell(c.at(kVariants[v] + std::string(row.step))),
                          paper[v] * kClock_MHz);
    text += "\n";
  }
  text += fmt::format("{:6}", "total");
  for (int v = 0; v < 3; ++v)
    text += fmt::format("  {} ({:.0f})", cell(sum(c, kVariants[v])), kPaperTotal[v] * kClock_MHz);
  return text + fmt::format("\nsine and cosine, in neither column: {}\n", cell(c.at("sin_cos")));
}

std::string ratios(const CortexCounts& c) {
  const StepCount O2 = sum(c, "matrix_O2."), simple = sum(c, "simplified.");
  return fmt::format(
      "generic/simplified at -O2: {:.1f} in instructions, {:.1f} to {:.1f} in cycles (paper: 4.2 "
      "in "
      "time)\n",
      O2.instructions / simple.instructions, O2.cycles_low / simple.cycles_low,
      O2.cycles_high / simple.cycles_high);
}

std::string split(const CortexCounts& c) {
  std::string text =
      fmt::format("\nThe split filter, whole parts:{:13}instructions   cycles\n", "");
  const std::pair<const char*, const char*> rows[] = {
      {"simplified.fast", "fast step, policy paper"},
      {"simplified.background", "background step"},
      {"simplified.fast_rotate", "fast step, policy rotate"},
      {"scheduled.fast", "fast step, policy scheduled"},
      {"bits16.fast", "16-bit gain: fast step"},
      {"bits16.background", "16-bit: background step"}};
  for (const auto& [step, name] : rows) text += fmt::format("  {:36} {}\n", name, cell(c.at(step)));
  return text;
}

// Processor load at 72 MHz in %, from the middle of the band of cycles.
double share(const CortexCounts& c, double f_s_Hz, double f_b_Hz) {
  const auto middle = [](const StepCount& s) { return 0.5 * (s.cycles_low + s.cycles_high); };
  return 1e-4 / kClock_MHz *
         (f_s_Hz * middle(c.at("simplified.fast")) +
          f_b_Hz * middle(c.at("simplified.background")));
}

std::string table_4(const CortexCounts& c) {
  std::string text = fmt::format(
      "\nTable 4: share of a processor of 72 MHz at f_s = 5 kHz, %; paper: by its own times\n{:>8} "
      "{:>16} {:>10} {:>10}\n",
      "f_b Hz", "instructions/s", "ours", "paper");
  for (const double f_b : {5000.0, 2500.0, 1250.0, 1000.0, 500.0})
    text += fmt::format("{:>8.0f} {:>14.3f}e6 {:>10.2f} {:>10.2f}\n", f_b,
                        1e-6 * (5000 * c.at("simplified.fast").instructions +
                                f_b * c.at("simplified.background").instructions),
                        share(c, 5000, f_b), 1e-4 * (5000 * 6.1 + f_b * 31.6));
  return text;
}

}  // namespace

std::string cortex_table(const CortexCounts& c) {
  return table_2(c) + ratios(c) + split(c) + table_4(c) +
         fmt::format("\ncounted: {}\n({}; {}; revision {})\n", c.command, c.compiler, c.emulator,
                     c.revision);
}

}  // namespace twinrate
