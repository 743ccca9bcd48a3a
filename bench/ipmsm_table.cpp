// ipmsm_table: every figure of docs/ipmsm-drive.md, from preset kim-ipmsm in closed loop.
//
//   ipmsm_table [table|starts|mtpa|zero|robustness|figure]...      default: all of them
//
// `figure` writes docs/ipmsm-robustness.svg (run it in the source tree). Output is Markdown. Each
// row lists its overrides of the preset.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cstdio>
#include <fstream>
#include <set>

#include "bench/robustness_figure.hpp"
#include "controller/make_controller.hpp"
#include "core/report_error.hpp"
#include "loop/estimator_loop.hpp"
#include "plant_sim/plant.hpp"

namespace twinrate {
namespace {

using Overrides = std::vector<std::string>;
constexpr double kDeg = 180 / kPi, kRpm = 30 / kPi;

Overrides join(Overrides left, const Overrides& right) {
  left.insert(left.end(), right.begin(), right.end());
  return left;
}

const Overrides kNoWatch{"controller.foc.synchronism.watch=false"};
const Overrides kFlying{"start=flying", "estimator.prediction=euler",
                        "controller.foc.synchronism.watch=false"};
const Overrides kHeavy{"machine.J_kgm2=1e-3", "controller.foc.speed_bandwidth_Hz=15"};
const Overrides kTruth{"controller.angle_source=truth"};
const Overrides kEqualQ{"estimator.backemf_printed.Q_diag=[2e3, 2e3, 1e8, 1e8]"};

// Plant from one config, filter and controller from another: a mismatch of parameters.
class Loop {
 public:
  Loop(const Overrides& plant, const Overrides& belief)
      : config_(Config::load("kim-ipmsm", belief)),
        drive_(config_.drive()),
        plant_(plant_of(plant)),
        estimator_(config_),
        controller_(make_controller(config_)) {}
  explicit Loop(const Overrides& both) : Loop(both, both) {}

  void tick() {
    const Measurement m = plant_.sample();
    truth = plant_.truth();
    estimate = estimator_.tick(m);
    command = controller_->step({m, estimate, drive_.reference_at(m.k), &truth});
    plant_.take_command(command);
    plant_.advance();
    t_s = static_cast<double>(m.k) * drive_.T_s();
  }
  bool running() const { return plant_.k() < drive_.steps(); }
  double angle_error_deg() const {
    return kDeg * wrap_pi(estimate.theta_e - drive_.machine.n_p * truth.theta_m);
  }
  const DriveConfig& drive() const { return drive_; }

  Truth truth;
  Estimate estimate;
  Command command;
  double t_s = 0;

 private:
  static Plant plant_of(const Overrides& overrides) {
    Config config = Config::load("kim-ipmsm", overrides);
    return Plant(config);
  }
  Config config_;
  DriveConfig drive_;
  Plant plant_;
  EstimatorLoop estimator_;
  std::unique_ptr<Controller> controller_;
};

struct Figures {
  double mean_deg = 0, max_deg = 0, speed_error_rpm = 0, rpm = 0;
  Vec2 i_dq = Vec2::Zero();
  double T_em = 0;
};

// Figures over [from, to] seconds.
Figures run(Loop& loop, double from, double to) {
  Figures f;
  int count = 0;
  while (loop.running() && loop.t_s < to) {
    loop.tick();
    if (loop.t_s < from) continue;
    ++count;
    f.mean_deg += loop.angle_error_deg();
    f.max_deg = std::max(f.max_deg, std::abs(loop.angle_error_deg()));
    f.speed_error_rpm += kRpm * (loop.estimate.omega_m - loop.truth.omega_m);
    f.rpm += kRpm * loop.truth.omega_m;
    f.i_dq += loop.truth.i_dq;
    f.T_em += loop.truth.T_em;
  }
  for (double* sum : {&f.mean_deg, &f.speed_error_rpm, &f.rpm, &f.T_em}) *sum /= count;
  f.i_dq /= count;
  return f;
}

void table_row(const char* name, const Overrides& overrides) {
  Loop steady(overrides), transient(overrides);
  const Figures at_load = run(steady, 0.8, 0.95), stepping = run(transient, 0.6, 0.75);
  fmt::print("| {} | {:.2f} | {:.2f} | {:.2f} | {:+.1f} |\n", name, at_load.mean_deg,
             at_load.max_deg, stepping.max_deg, at_load.speed_error_rpm);
}

void table() {
  const auto kind = [](const char* name) {
    return Overrides{fmt::format("estimator.kind={}", name)};
  };
  const auto flying = [&](const char* name) { return join(kFlying, kind(name)); };
  const Overrides exact{"estimator.prediction=rk4"};
  fmt::print(
      "### 0.6 of rated torque at 2000 rpm (flying start, load over 50 ms, noise 5 mA)\n\n"
      "| estimator | angle error, deg | largest | in the load transient | speed error, rpm |\n"
      "|---|---|---|---|---|\n");
  table_row("`backemf_printed`, parallel", join(flying("backemf_printed"), kTruth));
  table_row("`backemf_printed`, closed loop, J = 1e-3, 15 Hz",
            join(flying("backemf_printed"), kHeavy));
  table_row("`backemf_printed`, equal Q_0 of 1e8, parallel",
            join(join(flying("backemf_printed"), kTruth), kEqualQ));
  table_row("`active_flux`, J = 1e-3, 15 Hz", join(flying("active_flux"), kHeavy));
  table_row("`eemf`", flying("eemf"));
  table_row("`eemf`, rk4", join(flying("eemf"), exact));
  table_row("`dq_ekf`, euler", flying("dq_ekf"));
  table_row("`dq_ekf`, rk4", join(flying("dq_ekf"), exact));
  const Overrides fixed{"plant.saliency=fixed_axes"};
  fmt::print(
      "\nThe same on the paper's fixed-axes machine, parallel:\n\n"
      "| estimator | angle error, deg | largest | in the load transient | speed error, rpm |\n"
      "|---|---|---|---|---|\n");
  for (const char* name : {"backemf_printed", "active_flux", "eemf", "dq_ekf"})
    table_row(fmt::format("`{}`", name).c_str(), join(join(flying(name), kTruth), fixed));
  table_row("`backemf_printed`, closed loop, J = 1e-3, 15 Hz",
            join(join(flying("backemf_printed"), kHeavy), fixed));
}

// Number of successful starts from 24 initial angles: 2000 rpm and a small angle error over the
// last 0.2 s.
int starts(const Overrides& overrides) {
  int locked = 0;
  for (int i = 0; i < 24; ++i) {
    Loop loop(join(overrides, {fmt::format("plant.theta_e_start_rad={}", i * kTwoPi / 24)}));
    const double end = loop.drive().run.duration_s;
    const Figures f = run(loop, end - 0.2, end);
    locked += f.max_deg < 45 && std::abs(f.rpm - 2000) < 60;
  }
  return locked;
}

void all_starts() {
  fmt::print(
      "\n### Starts from 24 initial angles, 0 to 2000 rpm\n\n| estimator | start | of 24 "
      "|\n|---|---|---|\n");
  const auto row = [](const char* what, const char* start, const Overrides& overrides) {
    fmt::print("| {} | {} | {} |\n", what, start, starts(overrides));
    std::fflush(stdout);
  };
  const Overrides none{"load.T_load_Nm=0", "run.duration_s=1.0"};
  const Overrides loaded{"load.T_load_Nm=1.452", "run.duration_s=1.0"};
  const Overrides slow{"load.T_load_Nm=0", "run.duration_s=3.0", "start=align_if"};
  const auto kind = [](const char* name) {
    return join(kNoWatch, {fmt::format("estimator.kind={}", name)});
  };
  row("`dq_ekf`", "direct, no load", none);
  row("`dq_ekf`", "direct, 0.6 of rated torque from standstill", loaded);
  row("`eemf`", "direct, no load", join(kind("eemf"), none));
  row("`active_flux`", "direct, no load", join(kind("active_flux"), none));
  row("`backemf_printed`", "direct, no load", join(kind("backemf_printed"), none));
  row("`eemf`", "alignment and I/f, J = 1e-4", join(kind("eemf"), slow));
  row("`eemf`", "alignment and I/f, J = 1e-3, 15 Hz", join(join(kind("eemf"), slow), kHeavy));
  const Overrides gentle{"reference.slew_rad_s2=1000"};
  row("`active_flux`", "alignment and I/f, J = 1e-3, 15 Hz, 1000 rad/s2",
      join(join(join(kind("active_flux"), slow), kHeavy), gentle));
  row("`backemf_printed`", "the same",
      join(join(join(kind("backemf_printed"), slow), kHeavy), gentle));
  row("`backemf_printed`, speed from the angle's rate, (32)", "the same",
      join(join(join(join(kind("backemf_printed"), slow), kHeavy), gentle),
           {"estimator.backemf_printed.speed_from=angle_rate",
            "estimator.backemf_printed.lowpass_Hz=30"}));
}

// Smallest current for a torque by a search over i_d, independent of the closed form.
double smallest_current(const MachineParameters& m, double T) {
  double best = 1e9;
  for (double i_d = -3; i_d <= 1; i_d += 1e-5)
    best = std::min(best, std::hypot(i_d, T / m.torque(i_d, 1)));
  return best;
}

void mtpa_rows() {
  fmt::print(
      "\n### Maximum torque per ampere at 1500 rpm\n\n"
      "| load, of rated | current, A | optimum by scan, A | above the optimum | with i_d = 0, A | "
      "current saved | copper loss saved |\n|---|---|---|---|---|---|---|\n");
  for (double load : {0.1, 0.2, 0.4, 0.6, 0.8, 1.0}) {
    const Overrides at{"reference.speed_rpm=1500", "run.duration_s=1.2",
                       fmt::format("load.T_load_Nm={}", load * 2.42 - 0.0314)};
    Loop best(at),
        plain(join(at, {"controller.foc.current_angle=reference", "controller.foc.i_max_A=3.5"}));
    const Figures f = run(best, 0.8, 1.2), g = run(plain, 0.8, 1.2);
    const double I_s = f.i_dq.norm(), optimum = smallest_current(best.drive().machine, f.T_em);
    const double without = g.i_dq.norm();
    fmt::print("| {:.1f} | {:.4f} | {:.4f} | {:.2f} % | {:.4f} | {:.1f} % | {:.1f} % |\n", load,
               I_s, optimum, 100 * (I_s / optimum - 1), without, 100 * (1 - I_s / without),
               100 * (1 - I_s * I_s / (without * without)));
  }
}

void through_zero() {
  fmt::print(
      "\n### 2000 -> -2000 rpm through zero (1000 rad/s2 electrical, rk4)\n\n"
      "| estimator | load, of rated | keeps synchronism | largest angle error afterwards, deg |\n"
      "|---|---|---|---|\n");
  for (const char* kind : {"backemf_printed", "active_flux", "eemf", "dq_ekf"})
    for (double load : {0.0, 0.3}) {
      Loop loop(join(join(kHeavy, kNoWatch),
                     {"start=flying", fmt::format("estimator.kind={}", kind),
                      "reference.speed_rpm=[[0, 2000], [0.6, -2000]]", "run.duration_s=2.4",
                      fmt::format("load.T_load_Nm=[[0, 0], [0.2, {}]]", load * 2.42),
                      "reference.slew_rad_s2=1000"}));
      const Figures f = run(loop, 2.0, 2.4);
      const bool survives = f.max_deg < 45 && std::abs(f.rpm + 2000) < 60;
      fmt::print("| `{}` | {:.1f} | {} | {:.1f} |\n", kind, load, survives ? "yes" : "no",
                 f.max_deg);
    }
}

// Angle error of a filter with wrong parameters `belief`; the controller uses the true angle. NaN
// if synchronism is lost.
double riding_error_deg(const char* kind, const std::string& belief) {
  const Overrides base =
      join(join(kNoWatch, kTruth), {"start=flying", fmt::format("estimator.kind={}", kind)});
  Loop loop(base, join(base, {belief}));
  const Figures f = run(loop, 0.8, 0.95);
  return f.max_deg < 90 ? f.mean_deg : NAN;
}

void robustness() {
  fmt::print(
      "\n### Angle error in deg at 0.6 of rated torque, 2000 rpm, with wrong parameters\n\n"
      "The filters (rk4) run parallel, with wrong parameters of the machine.\n\n"
      "| parameters of the filter | `backemf_printed` | `active_flux` | `eemf` | `dq_ekf` "
      "|\n|---|---|---|---|---|\n");
  struct Case {
    const char* what;
    const char* override_text;
  };
  for (const Case& c :
       {Case{"those of the plant", "machine.n_p=2"}, Case{"R_s -50 %", "machine.R_s_Ohm=5.5"},
        Case{"R_s +50 %", "machine.R_s_Ohm=16.5"}, Case{"L_q -20 %", "machine.L_q_H=0.1064"},
        Case{"L_q +20 %", "machine.L_q_H=0.1596"}, Case{"psi_f -10 %", "machine.psi_f_Wb=0.2565"},
        Case{"psi_f +10 %", "machine.psi_f_Wb=0.3135"}}) {
    fmt::print("| {} |", c.what);
    for (const char* kind : {"backemf_printed", "active_flux", "eemf", "dq_ekf"}) {
      const double e_deg = riding_error_deg(kind, c.override_text);
      fmt::print(" {} |", std::isfinite(e_deg) ? fmt::format("{:.1f}", e_deg) : "lost");
    }
    fmt::print("\n");
  }
}

void robustness_figure() {
  const MachineParameters m = Config::load("kim-ipmsm", {}).drive().machine;
  const std::pair<const char*, double> parameters[] = {
      {"machine.R_s_Ohm", m.R_s}, {"machine.L_q_H", m.L_q}, {"machine.psi_f_Wb", m.psi_f}};
  std::vector<RobustnessCurve> curves;
  for (const char* kind : {"backemf_printed", "eemf", "active_flux", "dq_ekf"})
    for (int parameter = 0; parameter < 3; ++parameter) {
      RobustnessCurve curve{kind, parameter, {}, {}};
      const auto& [key, value] = parameters[parameter];
      for (int step = -4; step <= 4; ++step) {
        const double pct = kParameterSpan_pct[parameter] * step / 4;
        curve.x_pct.push_back(pct);
        curve.e_deg.push_back(
            riding_error_deg(kind, fmt::format("{}={}", key, value * (1 + pct / 100))));
      }
      curves.push_back(curve);
    }
  std::ofstream("docs/ipmsm-robustness.svg") << robustness_svg(curves);
}

}  // namespace
}  // namespace twinrate

int main(int argc, char** argv) try {
  using namespace twinrate;
  const std::set<std::string> wanted(argv + 1, argv + argc);
  const auto want = [&](const char* part) { return wanted.empty() || wanted.count(part) > 0; };
  if (want("table")) table();
  if (want("starts")) all_starts();
  if (want("mtpa")) mtpa_rows();
  if (want("zero")) through_zero();
  if (want("robustness")) robustness();
  if (want("figure")) robustness_figure();
} catch (...) {
  return twinrate::report_error("ipmsm_table");
}
