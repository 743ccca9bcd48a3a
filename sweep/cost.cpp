#include "sweep/cost.hpp"

#include <fmt/format.h>

namespace twinrate::sweep {
namespace {

// Instructions of one step on a Cortex-M3 in Q16.16 (qemu mps2-an385, -O2): fast part, background,
// and a whole step with the gain read from the table. One instruction a clock at 72 MHz.
constexpr double kFast = 139, kBackground = 347, kScheduled = 240, kClock_Hz = 72e6;

// Policy propagated: a background run computes n steps by doubling, six times. Counted on x86-64-v3
// (bench/count_instructions) and scaled to the Cortex-M3 with the ratio of a plain background step
// (kBackground/kBackgroundX86). The fast part is that of the gain read from the table.
struct Doubled {
  int n;
  double instructions_x86;
};
constexpr Doubled kDoubled[] = {{20, 2956}, {100, 4157}, {1000, 6369}};
constexpr double kBackgroundX86 = 127, kRunsOfDoubling = 6;

}  // namespace

std::string cost_table(const Halves& paper, double f_s_Hz, const std::vector<double>& f_b_Hz,
                       double gains_a_turn) {
  const Halves ours{kFast / kClock_Hz, kBackground / kClock_Hz};
  std::string text = fmt::format("{:>8} {:>5} {:>14} {:>12} {:>16}\n", "f_b Hz", "n",
                                 "paper's code %", "f_emax Hz", "counted code %");
  for (double f_b : f_b_Hz)
    text += fmt::format("{:>8g} {:>5g} {:>14.2f} {:>12.0f} {:>16.2f}\n", f_b, f_s_Hz / f_b,
                        100 * processor_share(paper, f_s_Hz, f_b), f_b / gains_a_turn,
                        100 * processor_share(ours, f_s_Hz, f_b));
  text += fmt::format("{:>8} {:>5} {:>14} {:>12} {:>16.2f}\n", "table", "-", "-", "no limit",
                      100 * f_s_Hz * kScheduled / kClock_Hz);
  text += "\npropagated, scaled from x86-64:\n";
  for (const Doubled& d : kDoubled) {
    const double background =
        kRunsOfDoubling * d.instructions_x86 * kBackground / kBackgroundX86 / kClock_Hz;
    const double f_b = f_s_Hz / d.n;
    text += fmt::format("{:>8g} {:>5} {:>14} {:>12} {:>16.2f}\n", f_b, d.n, "-", "no limit",
                        100 * processor_share({kScheduled / kClock_Hz, background}, f_s_Hz, f_b));
  }
  return text;
}

}  // namespace twinrate::sweep
