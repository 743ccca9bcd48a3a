// Starts from standstill without alignment, from 24 rotor angles: how many run locked at the end, for
// a gain every n ticks from the first tick on (rates.n_from = "start") and from the filter's
// agreement on ("locked"). Output is Markdown.
//
//   direct_starts [--n N ..] [--load SHARE ..] [--filter KIND] [--span DEG] [--set KEY=VALUE ..]
//
// dq_ekf starts from anywhere on the salient motor; the others start at 0 and find a rotor within 75
// deg of it, on the motor without saliency. Load: share of rated torque, from the first tick on.
#include <fmt/format.h>

#include "bench/command_line.hpp"
#include "core/report_error.hpp"
#include "loop/closed_loop.hpp"
#include "loop/load_drive.hpp"

namespace twinrate {
namespace {

constexpr int kAngles = 24;

struct Row {
  std::string filter, preset;
  double span_deg;
};

struct Count {
  int locked = 0;
  double latest_s = 0;  // agreement of the filter with itself
};

// What every row of a call has in common.
struct Selection {
  std::vector<int> ns = {1, 3, 5, 10, 20};
  std::vector<double> loads = {0, 0.6};
  std::string filter;
  double span_deg = 0;  // 0: of the row
  std::vector<std::string> overrides;
};

Config drive_of(const Row& row, const std::string& n_from, int n, double share, int angle,
                const Selection& s) {
  const double theta_e = (angle + 0.5 - 0.5 * kAngles) / kAngles *
                         (s.span_deg > 0 ? s.span_deg : row.span_deg) * kPi / 180;
  const double T_rated = Config::load(row.preset).drive().machine.T_rated;
  std::vector<std::string> list = {"estimator.kind=" + row.filter,
                                   fmt::format("rates.n={}", n),
                                   "rates.n_from=" + n_from,
                                   "start=aligned",
                                   fmt::format("plant.theta_e_start_rad={}", theta_e),
                                   fmt::format("load.T_load_Nm={}", share * T_rated),
                                   "run.duration_s=1.2"};
  list.insert(list.end(), s.overrides.begin(), s.overrides.end());
  return load_drive(row.preset, list);
}

// Locked: angle within 90 deg and speed within 20 % over the last 0.2 s.
bool runs_locked(Config& config, double& agreed_s) {
  const DriveConfig drive = config.drive();
  ClosedLoop loop(config);
  while (loop.k() < drive.steps()) {
    const TickRecord& tick = loop.step();
    const double t = drive.T_s() * static_cast<double>(tick.measurement.k);
    if (tick.gain_every_nth) agreed_s = std::max(agreed_s, t);
    if (t < drive.run.duration_s - 0.2) continue;
    const double error = wrap_pi(tick.estimate.theta_e - drive.machine.n_p * tick.truth.theta_m);
    const double off = tick.truth.omega_m / tick.reference.omega_m_ref - 1;
    if (!(std::abs(error) < kPi / 2 && std::abs(off) < 0.2)) return false;
  }
  return true;
}

Count starts(const Row& row, const std::string& n_from, int n, double share, const Selection& s) {
  Count count;
  for (int angle = 0; angle < kAngles; ++angle) {
    Config config = drive_of(row, n_from, n, share, angle, s);
    count.locked += runs_locked(config, count.latest_s);
  }
  return count;
}

void print_row(const Row& row, double share, const Selection& s) {
  for (const char* n_from : kNFromNames) {
    fmt::print("| `{}` | {} | {:g} | {} |", row.filter, row.preset, share, n_from);
    double latest_s = 0;
    for (const int n : s.ns) {
      const Count count = starts(row, n_from, n, share, s);
      latest_s = std::max(latest_s, count.latest_s);
      fmt::print(" {} |", count.locked);
      std::fflush(stdout);
    }
    fmt::print(" {} |\n", latest_s > 0 ? fmt::format("{:.3f}", latest_s) : "");
  }
}

}  // namespace
}  // namespace twinrate

int main(int argc, char** argv) try {
  using namespace twinrate;
  bench::CommandLine command_line("Direct starts from 24 angles");
  Selection s;
  command_line.option("--n", &s.ns, "ticks from gain to gain");
  command_line.option("--load", &s.loads, "shares of rated torque");
  command_line.option("--filter", &s.filter, "only this filter");
  command_line.option("--span", &s.span_deg, "angles over this span instead, deg");
  command_line.option("--set", &s.overrides, "keys of the drive files, as elsewhere");
  if (const auto status = command_line.parse(argc, argv)) return *status;
  fmt::print("| filter | motor | load | n_from |");
  for (const int n : s.ns) fmt::print(" n = {} |", n);
  fmt::print(" latest agreement, s |\n|---|---|---|---|");
  for (std::size_t i = 0; i <= s.ns.size(); ++i) fmt::print("---|");
  fmt::print("\n");
  for (const Row& row :
       {Row{"dq_ekf", "kim-ipmsm", 360}, Row{"dq_ekf", "dilys2021", 360},
        Row{"ekf_sensorless", "dilys2021", 150}, Row{"backemf_printed", "dilys2021", 150},
        Row{"ekf_joint", "dilys2021", 150}, Row{"ekf_joint", "kim-ipmsm", 150}})
    for (const double share : s.loads)
      if (s.filter.empty() || s.filter == row.filter) print_row(row, share, s);
} catch (...) {
  return twinrate::report_error("direct_starts");
}
