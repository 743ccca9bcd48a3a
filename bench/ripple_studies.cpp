// ripple_studies: the figures of docs/ripple-reduction.md, from preset niewiara2020 in closed loop.
//
//   ripple_studies [reference|rate|noise|sign]..      default: all of them
//
//   reference  speed ripple off, L = -700, L = -3000 at four speeds
//   rate       ripple and load-step error against f_b/f_s, for every gain policy the filter takes
//   noise      the filter against R of the speed
//   sign       the feed-forward with inverted sign
//
// Output is one JSON object; progress goes to stderr.
#include <fmt/format.h>

#include <cmath>
#include <iostream>
#include <nlohmann/json.hpp>
#include <set>

#include "analysis/order_spectrum.hpp"
#include "controller/make_controller.hpp"
#include "core/config.hpp"
#include "core/report_error.hpp"
#include "loop/estimator_loop.hpp"
#include "plant_sim/plant.hpp"

namespace twinrate {
namespace {

using Json = nlohmann::ordered_json;
using Overrides = std::vector<std::string>;

constexpr int kOrders = 60;
constexpr double kLoadStep_Nm = 4, kLoadStepAt_s = 4;

// `feed_forward_sign` = -1 inverts the estimated load for the controller, which uses it only in the
// feed-forward.
class Loop {
 public:
  explicit Loop(const Overrides& overrides, double feed_forward_sign = 1)
      : config_(Config::load("niewiara2020", overrides)),
        drive_(config_.drive()),
        plant_(config_),
        estimator_(config_),
        controller_(make_controller(config_)),
        sign_(feed_forward_sign) {}

  void tick() {
    const Measurement m = plant_.sample();
    truth = plant_.truth();
    estimate = estimator_.tick(m);
    Estimate seen = estimate;
    seen.T_load *= sign_;
    plant_.take_command(controller_->step({m, seen, drive_.reference_at(m.k), &truth}));
    plant_.advance();
    t_s = static_cast<double>(m.k) * drive_.T_s();
  }
  const Gain& gain() const { return estimator_.gain(); }

  Truth truth;
  Estimate estimate;
  double t_s = 0;

 private:
  Config config_;
  DriveConfig drive_;
  Plant plant_;
  EstimatorLoop estimator_;
  std::unique_ptr<Controller> controller_;
  double sign_;
};

Overrides join(Overrides left, const Overrides& right) {
  left.insert(left.end(), right.begin(), right.end());
  return left;
}

Overrides at_speed(double speed_rpm) {
  return {fmt::format("reference.speed_rpm={}", speed_rpm)};
}

double rms_about(const std::vector<double>& values, double mean) {
  double square = 0;
  for (const double value : values) square += (value - mean) * (value - mean);
  return std::sqrt(square / static_cast<double>(values.size()));
}

double mean_of(const std::vector<double>& values) {
  double sum = 0;
  for (const double value : values) sum += value;
  return sum / static_cast<double>(values.size());
}

struct Ripple {
  double rms = 0, orders_rms = 0;  // of omega_m, rad/s
  double T_o_noise = 0;            // rms of T_o_hat less its mean and orders 1 to 60, Nm
};

// Ripple over `turns` whole turns from 3 s on.
Ripple ripple(const Overrides& overrides, double speed_rpm, int turns, double sign = 1) {
  constexpr double kFrom_s = 3;
  Loop loop(join(at_speed(speed_rpm), overrides), sign);
  std::vector<double> theta_m, omega_m, T_o_hat;
  double from_rad = 0;
  for (;;) {
    loop.tick();
    if (loop.t_s < kFrom_s) continue;
    if (theta_m.empty()) from_rad = loop.truth.theta_m;
    const double past = loop.truth.theta_m - from_rad;
    if (past >= kTwoPi * turns || !std::isfinite(loop.truth.omega_m) || loop.t_s > 60) break;
    theta_m.push_back(loop.truth.theta_m);
    omega_m.push_back(loop.truth.omega_m);
    T_o_hat.push_back(loop.estimate.T_load);
  }
  Ripple found;
  found.rms = rms_about(omega_m, mean_of(omega_m));
  found.orders_rms = order_spectrum(theta_m, omega_m, kOrders).rms(kOrders);
  const OrderSpectrum torque = order_spectrum(theta_m, T_o_hat, kOrders);
  std::vector<double> noise;
  for (std::size_t i = torque.first; i < torque.last; ++i)
    noise.push_back(T_o_hat[i] - torque.mean - torque.at(theta_m[i], kOrders));
  found.T_o_noise = noise.empty() ? NAN : rms_about(noise, 0);
  return found;
}

struct LoadStep {
  double dip_rad_s = 0;       // largest fall of the speed below its reference within 1 s
  double overshoot = 0;       // of T_o_hat beyond its mean of 0.5 to 1 s after, share of the step
  double gain_settled_s = 0;  // last time at which K of T_o is off its final value by over 1 %
};

LoadStep load_step(const Overrides& overrides, double speed_rpm) {
  Loop loop(join(join(at_speed(speed_rpm), overrides),
                 {fmt::format("load.T_load_Nm=[[0,0],[{},{}]]", kLoadStepAt_s, kLoadStep_Nm)}));
  const double omega_m_ref = speed_rpm * kTwoPi / 60;
  LoadStep step;
  std::vector<double> times_s, K_o, late;
  double highest = 0;
  while (loop.t_s < kLoadStepAt_s + 1) {
    loop.tick();
    times_s.push_back(loop.t_s);
    K_o.push_back(loop.gain().K(3, 2));
    if (loop.t_s < kLoadStepAt_s) continue;
    step.dip_rad_s = std::max(step.dip_rad_s, omega_m_ref - loop.truth.omega_m);
    highest = std::max(highest, loop.estimate.T_load);
    if (loop.t_s > kLoadStepAt_s + 0.5) late.push_back(loop.estimate.T_load);
  }
  step.overshoot = (highest - mean_of(late)) / kLoadStep_Nm;
  for (std::size_t i = 0; i < K_o.size(); ++i)
    if (std::abs(K_o[i] - K_o.back()) > 0.01 * std::abs(K_o.back()))
      step.gain_settled_s = times_s[i];
  return step;
}

double dB(double before, double after) {
  return 20 * std::log10(after / before);
}

double rounded(double value) {
  return std::isfinite(value) ? std::stod(fmt::format("{:.4g}", value)) : value;
}

const Overrides kOff{"controller.compensation=off"};
const Overrides kPaper{"controller.compensation=paper"};

Json reference_table() {
  Json rows = Json::array();
  for (const double speed_rpm : {10, 20, 30, 50}) {
    fmt::print(stderr, "reference {} rpm\n", speed_rpm);
    const int turns = 6;
    const Ripple off = ripple(kOff, speed_rpm, turns);
    const Ripple paper = ripple(kPaper, speed_rpm, turns);
    const Ripple fast =
        ripple(join(kPaper, {"estimator.ekf_disturbance.L_Nm_rad=-3000"}), speed_rpm, turns);
    rows.push_back({{"speed_rpm", speed_rpm},
                    {"off_rad_s", rounded(off.rms)},
                    {"paper_rad_s", rounded(paper.rms)},
                    {"L3000_rad_s", rounded(fast.rms)},
                    {"paper_dB", rounded(dB(off.rms, paper.rms))},
                    {"L3000_dB", rounded(dB(off.rms, fast.rms))}});
  }
  return rows;
}

// P0_diag from the covariance after 1 s at f_b = f_s: from P0 = 1 a slow background needs hundreds
// of updates to settle.
std::string settled_P0() {
  Loop loop({});
  while (loop.t_s < 1) loop.tick();
  const auto& P = loop.gain().P;
  return fmt::format("estimator.ekf_disturbance.P0_diag=[{}, {}, {}, {}]", P(0, 0), P(1, 1),
                     P(2, 2), P(3, 3));
}

Json rate_study() {
  Json rows = Json::array();
  const double speed_rpm = 50;
  const int turns = 4;
  const double off = ripple(kOff, speed_rpm, turns).rms;
  for (const char* policy : kGainPolicyNames) {
    if (std::string(policy) == "scheduled") continue;  // has no background rate
    for (const int n : {1, 2, 5, 10, 20, 50, 100, 200, 500, 1000}) {
      fmt::print(stderr, "rate {} n = {}\n", policy, n);
      const Overrides set =
          join(kPaper, {fmt::format("gain.policy={}", policy), fmt::format("rates.n={}", n)});
      try {
        const Ripple r = ripple(set, speed_rpm, turns);
        const LoadStep step = load_step(set, speed_rpm);
        const Overrides warm = join(set, {settled_P0()});
        rows.push_back({{"policy", policy},
                        {"n", n},
                        {"f_b_Hz", 10000.0 / n},
                        {"ripple_rad_s", rounded(r.rms)},
                        {"ripple_dB", rounded(dB(off, r.rms))},
                        {"dip_rad_s", rounded(step.dip_rad_s)},
                        {"gain_settled_s", rounded(step.gain_settled_s)},
                        {"warm_ripple_rad_s", rounded(ripple(warm, speed_rpm, turns).rms)},
                        {"warm_dip_rad_s", rounded(load_step(warm, speed_rpm).dip_rad_s)}});
      } catch (const BadInput& refusal) {
        rows.push_back({{"policy", policy}, {"n", n}, {"refused", refusal.what()}});
        break;
      }
    }
  }
  return rows;
}

Json noise_study() {
  Json rows = Json::array();
  const double speed_rpm = 20;
  for (const double R : {0.001, 0.01, 0.1, 1.0, 10.0, 50.0, 150.0, 190.0, 400.0, 1e3, 2e3, 3e3, 5e3,
                         1e4, 1e5, 1e6}) {
    fmt::print(stderr, "R = {}\n", R);
    const Overrides set =
        join(kPaper, {fmt::format("estimator.ekf_disturbance.R_diag=[10.0, 10.0, {:.6f}]", R)});
    const Ripple r = ripple(set, speed_rpm, 2);
    const LoadStep step = load_step(set, speed_rpm);
    rows.push_back({{"R_speed", R},
                    {"ripple_rad_s", rounded(r.rms)},
                    {"T_o_noise_mNm", rounded(1e3 * r.T_o_noise)},
                    {"T_o_overshoot", rounded(step.overshoot)},
                    {"dip_rad_s", rounded(step.dip_rad_s)}});
  }
  return rows;
}

Json sign_study() {
  Json rows = Json::array();
  for (const double speed_rpm : {10, 20, 30, 50}) {
    fmt::print(stderr, "sign {} rpm\n", speed_rpm);
    const int turns = speed_rpm < 20 ? 1 : 3;
    const double off = ripple(kOff, speed_rpm, turns).rms;
    Json row = {{"speed_rpm", speed_rpm}, {"off_rad_s", rounded(off)}};
    for (const int L : {-700, -3000}) {
      const Overrides set =
          join(kPaper, {fmt::format("estimator.ekf_disturbance.L_Nm_rad={}.0", L)});
      const double turned = ripple(set, speed_rpm, turns, -1).rms;
      row[fmt::format("wrong_sign_L{}_rad_s", -L)] = rounded(turned);
      row[fmt::format("ratio_L{}", -L)] = rounded(turned / off);
    }
    rows.push_back(row);
  }
  return rows;
}

int run(const std::set<std::string>& wanted) {
  const std::pair<const char*, Json (*)()> studies[] = {{"reference", reference_table},
                                                        {"rate", rate_study},
                                                        {"noise", noise_study},
                                                        {"sign", sign_study}};
  Json results = {{"what", "studies of preset niewiara2020, see docs/ripple-reduction.md"},
                  {"settled_P0", settled_P0()}};
  for (const auto& [name, study] : studies)
    if (wanted.empty() || wanted.contains(name)) results[name] = study();
  std::cout << results.dump(1) << "\n";
  return 0;
}

}  // namespace
}  // namespace twinrate

int main(int argc, char** argv) try { return twinrate::run({argv + 1, argv + argc}); } catch (...) {
  return twinrate::report_error("ripple_studies");
}
