// Load of a small processor by an estimator, from the times of its two parts.
//
//   share of the processor = f_s t_fast + f_b t_background
//   f_emax                 = f_b / gains an electrical turn; no limit by f_b if the gain is turned
//                            with the rotor or read from a table
//
// Dilys 2021, Tables 2 and 4: t_fast = 4.4 + 1.7 us, t_background = 13.4 + 5.4 + 9.6 + 3.2 us. The
// paper prints 6.21 % for 500 Hz, which is the value of 1 kHz; its own times give 4.63 %.
//
// Beside it, counted instructions: of the fixed-point filter on an emulated Cortex-M3 (`cortex_m3
// count`) if available, else of the double-precision kernels of this program
// (bench/count_instructions):
//
//   instructions a second = f_s N_fast + f_b N_background
#pragma once
#include <optional>
#include <string>
#include <vector>

namespace twinrate::sweep {

struct Halves {
  double fast_s = 6.1e-6, background_s = 31.6e-6;
};

inline double processor_share(const Halves& t, double f_s_Hz, double f_b_Hz) {
  return f_s_Hz * t.fast_s + f_b_Hz * t.background_s;
}

// Of one step; `what`, `compiler` and `revision` describe the count.
struct Counts {
  std::string what, compiler, revision;
  double fast = 0, background = 0;
  // One propagation through n ticks of policy propagated, by doubling: (n, instructions).
  std::vector<std::pair<int, double>> doubled;
  double scheduled = 0;  // fast step of policy scheduled; 0: not counted
};
// Of bench/results/instructions.json; empty if the file is missing or of another kind.
std::optional<Counts> read_counts(const std::string& path);

// Of bench/results/cortex_m3.json, likewise.
std::optional<Counts> read_cortex_counts(const std::string& path);

// The rows of policy propagated, which is counted on the host only.
std::string propagated_table(const Counts& host, double f_s_Hz);

// The table, for `sweep cost`. It reports missing counts.
std::string cost_table(const Halves& paper, const std::optional<Counts>& counts, double f_s_Hz,
                       const std::vector<double>& f_b_Hz, double gains_a_turn);

}  // namespace twinrate::sweep
