// closed_floquet: n_max as the Floquet multipliers of the closed loop predict it, beside the simulated
// drive: the table of docs/find-fbmin.md.
//
//   closed_floquet                                    the table
//   closed_floquet DRIVE F_E_HZ LIMIT [key=value..]   one row
//
// Simulated without noise and effects, switched on at speed: start = "flying", a gain every tick for 0.2 s,
// then every n-th, 1.8 s. "steady": the angle error of the last 0.2 s varies by less than 1 deg; "held": it
// stays below 90 deg (a limit cycle is held, but not steady). Both are the last n before the first that fails.
#include "loop/closed_floquet.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <iostream>

#include "core/report_error.hpp"
#include "loop/closed_loop.hpp"

namespace twinrate {
namespace {

using Overrides = std::vector<std::string>;

constexpr double kSwitch_s = 0.2, kEnd_s = 2, kLast_s = 0.2;
constexpr double kSteady = kPi / 180, kSteadySpeed = 0.01, kHeldSpeed = 0.5;

struct Held {
  bool steady = false, locked = false;
};

struct Range {
  double least = 1e9, most = -1e9;
  void add(double value) {
    least = std::min(least, value);
    most = std::max(most, value);
  }
  double width() const { return most - least; }
};

Held simulate(const std::string& preset, Overrides overrides, double T_s, int n) {
  overrides.push_back(fmt::format("rates.n={}", n));
  overrides.push_back(
      fmt::format("rates.n_from_s={}", (std::ceil(kSwitch_s / T_s / n) * n - 0.5) * T_s));
  Config config = Config::load(preset, overrides);
  const int n_p = config.drive().machine.n_p;
  ClosedLoop loop(config);
  const double omega_m_ref = config.drive().reference_at(0).omega_m_ref;
  Range angle, speed;
  for (double t_s = 0; t_s < kEnd_s; t_s += T_s) {
    const TickRecord& tick = loop.step();
    const double error = wrap_pi(tick.estimate.theta_e - n_p * tick.truth.theta_m);
    const double off_speed = tick.truth.omega_m / omega_m_ref - 1;
    if (!(std::abs(error) < kPi / 2 && std::abs(off_speed) < kHeldSpeed)) return {};
    if (t_s < kEnd_s - kLast_s) continue;
    angle.add(error);
    speed.add(off_speed);
  }
  return {angle.width() < kSteady && speed.width() < kSteadySpeed, true};
}

void print_row(const std::string& preset, double f_e_Hz, int limit, Overrides overrides) {
  overrides.insert(overrides.end(), {"start=flying", "sensors.i_noise_rms_A=0", "sensors.i_lsb_A=0",
                                     "effect=[]", "load.T_load_Nm=0"});
  const DriveConfig d = Config::load(preset, overrides).drive();
  overrides.push_back(d.reference.in_rpm
                          ? fmt::format("reference.speed_rpm={}", 60 * f_e_Hz / d.machine.n_p)
                          : fmt::format("reference.omega_e_rad_s={}", kTwoPi * f_e_Hz));
  Config config = Config::load(preset, overrides);
  const auto floquet = ClosedFloquet::of(config, kTwoPi * f_e_Hz);
  fmt::print("{:<12} {:<15} {:<4} {:>5} ", preset, d.estimator.kind, d.controller.kind, f_e_Hz);
  if (!floquet) {
    fmt::print("no prediction: not covered, or no operating point\n");
    return;
  }
  const int predicted = floquet->n_max(limit);
  int steady = 0, locked = 0;
  for (int n = 1; n <= limit && locked == n - 1; ++n) {
    const Held held = simulate(preset, overrides, d.T_s(), n);
    if (held.steady && steady == n - 1) steady = n;
    if (held.locked) locked = n;
  }
  const int filter = floquet->n_max_of_filter(limit);
  const bool beyond = predicted < limit;
  fmt::print("{:>7} {:>9} {:>7} {:>6} {:>6.3f} {:>6}  {:<8} {}\n", filter, predicted, steady,
             locked, floquet->spectral_radius(beyond ? predicted + 1 : limit),
             beyond ? fmt::format("{:.1f}", floquet->frequency_Hz(predicted + 1)) : "-",
             std::abs(predicted - steady) <= std::max(1.0, 0.1 * steady) ? "agrees" : "differs",
             !beyond                                            ? "no limit"
             : predicted < filter - std::max(1.0, 0.1 * filter) ? "controller"
                                                                : "filter");
  std::cout.flush();
}

void print_header() {
  fmt::print("{:<12} {:<15} {:<4} {:>5} {:>7} {:>9} {:>7} {:>6} {:>6} {:>6}  {:<8} {}\n", "drive",
             "filter", "ctrl", "f_e", "filter", "predicted", "steady", "held", "rho", "Hz", "",
             "limit");
}

// The weights of Niewiara's motor on Dilys's.
const Overrides kOtherWeights{"controller.kind=lqr", "controller.lqr.gains=weights",
                              "controller.lqr.Q_d=[0.063,82.5]",
                              "controller.lqr.Q_q=[5.55e-3,1.35e-4,17.7]"};

void print_table() {
  print_header();
  for (const char* controller : {"foc", "lqr"}) {
    const std::string kind = fmt::format("controller.kind={}", controller);
    for (const double f_e_Hz : {20, 50, 64, 100}) print_row("dilys2021", f_e_Hz, 50, {kind});
    for (const char* filter : {"ekf_joint", "eemf"})
      for (const double f_e_Hz : {50, 100})
        print_row("dilys2021", f_e_Hz, 50, {kind, fmt::format("estimator.kind={}", filter)});
  }
  for (const double f_e_Hz : {20, 50, 64, 100}) print_row("dilys2021", f_e_Hz, 50, kOtherWeights);
  for (const char* filter : {"eemf", "ekf_joint"})
    for (const char* controller : {"foc", "lqr"}) {
      const Overrides kinds{fmt::format("estimator.kind={}", filter),
                            fmt::format("controller.kind={}", controller)};
      print_row("kim-ipmsm", 50, 50, kinds);
      print_row("niewiara2020", 40, 50, kinds);
    }
  print_row("niewiara2020", 15, 50, {"estimator.kind=eemf"});
  // Without a limit: up to n = 20.
  for (const char* controller : {"foc", "lqr"}) {
    const std::string kind = fmt::format("controller.kind={}", controller);
    print_row("dilys2021", 64, 20, {kind, "estimator.kind=dq_ekf"});
    print_row("kim-ipmsm", 50, 20, {kind});
    print_row("niewiara2020", 10, 20, {kind});
    print_row("niewiara2020", 10, 20, {kind, "estimator.kind=ekf_harmonic"});
  }
  print_row("dilys2021", 64, 20, {"estimator.kind=active_flux", "controller.kind=lqr"});
  for (const char* bandwidth_Hz : {"4", "40", "100"})
    print_row("dilys2021", 64, 20,
              {"estimator.kind=active_flux",
               fmt::format("controller.foc.speed_bandwidth_Hz={}", bandwidth_Hz)});
  print_row("kim-ipmsm", 50, 20,
            {"estimator.kind=active_flux", "controller.foc.speed_bandwidth_Hz=15"});
  for (const char* controller : {"foc", "lqr"}) {
    const Overrides kinds{"estimator.kind=backemf_printed",
                          fmt::format("controller.kind={}", controller)};
    print_row("dilys2021", 64, 20, kinds);
    print_row("niewiara2020", 40, 20, kinds);
  }
}

}  // namespace
}  // namespace twinrate

int main(int argc, char** argv) try {
  using namespace twinrate;
  if (argc < 4)
    print_table();
  else
    print_header(),
        print_row(argv[1], std::atof(argv[2]), std::atoi(argv[3]), {argv + 4, argv + argc});
} catch (...) {
  return twinrate::report_error("closed_floquet");
}
