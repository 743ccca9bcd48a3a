#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "controller/foc.hpp"
#include "controller/make_controller.hpp"
#include "controller/scaled_tuning.hpp"
#include "loop/estimator_loop.hpp"
#include "loop/load_drive.hpp"
#include "model/per_unit.hpp"
#include "model/profile.hpp"
#include "plant_sim/plant.hpp"
#include "response/response.hpp"

namespace twinrate {
namespace {

using Complex = std::complex<double>;
constexpr int kLines = 24, kPeriods = 4, kSpan = 60;  // lines 1 .. kSpan over T_p
constexpr double kLowest = 0.1;                       // of the loop's bandwidth
// Amplitude of the test signal, relative to the rating.
constexpr double kSpeedShare = 0.03, kCurrentShare = 0.15, kLoadShare = 0.1;

// The functions of loop/closed_loop.hpp with a test signal added.
class DisturbedLoop {
 public:
  explicit DisturbedLoop(Config& config)
      : drive_(config.drive()),
        unlimited_(without_slew_of_load(config)),
        plant_(unlimited_),
        estimator_(config),
        controller_(make_controller(config)) {}

  struct Tick {
    Truth truth;
    bool finite_and_in_step = true;
  };
  // `k_profile`: the tick for which reference and load of the drive file are evaluated.
  Tick step(ResponseOf of, double x, std::int64_t k_profile) {
    Tick tick;
    const Measurement& m = plant_.sample();
    tick.truth = plant_.truth();
    const Estimate& estimate = estimator_.tick(m);
    Reference reference = drive_.reference_at(k_profile);
    if (of == ResponseOf::kSpeed) reference.omega_m_ref += x;
    if (of == ResponseOf::kCurrent) reference.i_d_ref += x;
    const double t = static_cast<double>(k_profile) * drive_.T_s();
    T_load_ = slew(T_load_, drive_.load.T_load_Nm.at(t), drive_.load.slew_Nm_s, drive_.T_s());
    plant_.follow_load(Profile(T_load_ + (of == ResponseOf::kLoad ? x : 0)));
    const double error = wrap_pi(estimate.theta_e - drive_.machine.n_p * tick.truth.theta_m);
    tick.finite_and_in_step = std::isfinite(tick.truth.omega_m) && std::abs(error) < kPi / 2;
    plant_.take_command(controller_->step({m, estimate, reference, &tick.truth}));
    plant_.advance();
    tick.finite_and_in_step = tick.finite_and_in_step && !plant_.tripped();
    return tick;
  }

 private:
  // load.slew_Nm_s limits the load of the drive file, not the test signal, whose fast lines would
  // otherwise be below the noise.
  static Config without_slew_of_load(const Config& config) {
    Config copy = Config::parse(config.resolved(), "response", {"load.slew_Nm_s=0"});
    read_all_tables(copy);
    return copy;
  }

  const DriveConfig drive_;
  double T_load_ = 0;  // Nm, of the drive file
  Config unlimited_;
  Plant plant_;
  EstimatorLoop estimator_;
  std::unique_ptr<Controller> controller_;
};

FocParameters foc_of(Config& config) {
  FocParameters p;
  scale(p, config.drive());
  if (config.drive().controller.kind == "foc")
    config.read_table("controller.foc", [&](FieldVisitor& f) { p.fields(f); });
  return p;
}

Complex pi(const PiGains& gains, Complex z, double T_s) {
  return gains.K_p + gains.K_i * T_s / (z - 1.0);
}

Complex current_design(const DriveConfig& d, const FocParameters& p, double L, Complex z) {
  const double T_s = d.T_s(), R = d.machine.R_s, a = std::exp(-R * T_s / L);
  const Complex plant = std::pow(z, -d.plant.delay_samples) * (1 - a) / (R * (z - a));
  const Complex loop = pi(current_pi(kTwoPi * p.current_bandwidth, R, L), z, T_s) * plant;
  return loop / (1.0 + loop);
}

Complex design(ResponseOf of, const DriveConfig& d, const FocParameters& p, double f) {
  const MachineParameters& m = d.machine;
  const double T_s = d.T_s(), K_t = m.torque_constant();
  const Complex z = std::polar(1.0, kTwoPi * f * T_s);
  if (of == ResponseOf::kCurrent) return current_design(d, p, m.L_d, z);
  const Complex from_torque = T_s / m.J / (z - 1.0 + m.B * T_s / m.J);
  const Complex loop = pi(speed_pi(kTwoPi * p.speed_bandwidth, m.J, K_t), z, T_s) *
                       current_design(d, p, m.L_q, z) * K_t * from_torque * 0.5 * (z + 1.0);
  return of == ResponseOf::kSpeed ? loop / (1.0 + loop) : -from_torque / (1.0 + loop);
}

struct Multisine {
  int period = 0;          // ticks
  std::vector<int> lines;  // multiples of 1/T_p
  std::vector<double> amplitude, phase;

  double at(std::int64_t k) const {
    double x = 0;
    for (std::size_t l = 0; l < lines.size(); ++l)
      x += amplitude[l] *
           std::cos(kTwoPi * lines[l] * static_cast<double>(k % period) / period + phase[l]);
    return x;
  }
};

// `slew_rate`: rate limit of the drive file; 0: none.
Multisine multisine(const DriveConfig& d, double f_c, double size, double slew_rate) {
  Multisine s;
  s.period = static_cast<int>(std::lround(d.rates.f_s_Hz / (kLowest * f_c)));
  for (int l = 0; l < kLines; ++l) {
    const int line = static_cast<int>(std::lround(std::pow(kSpan, l / (kLines - 1.0))));
    if ((s.lines.empty() || line > s.lines.back()) && 4 * line < s.period) s.lines.push_back(line);
  }
  const auto n = static_cast<double>(s.lines.size());
  double fastest = 0;
  for (std::size_t l = 0; l < s.lines.size(); ++l) {
    const auto rank = static_cast<double>(l);
    s.amplitude.push_back(size / std::sqrt(n));
    s.phase.push_back(-kPi * rank * (rank + 1) / n);
    fastest += s.amplitude.back() * kTwoPi * s.lines[l] * d.rates.f_s_Hz / s.period;
  }
  if (slew_rate > 0 && fastest > 0.8 * slew_rate)
    for (double& a : s.amplitude) a *= 0.8 * slew_rate / fastest;
  return s;
}

Multisine signal_of(const DriveConfig& d, const FocParameters& p, ResponseOf of) {
  const PerUnit base = per_unit(d.machine, d.inverter.v_dc, d.T_s());
  switch (of) {
    case ResponseOf::kCurrent:
      return multisine(d, p.current_bandwidth, kCurrentShare * base.i, 0);
    case ResponseOf::kLoad:
      return multisine(d, p.speed_bandwidth, kLoadShare * base.T, 0);
    case ResponseOf::kSpeed:
      break;
  }
  return multisine(d, p.speed_bandwidth, kSpeedShare * base.omega_e / d.machine.n_p,
                   d.reference.slew_rate_rad_s2 / d.machine.n_p);
}

}  // namespace

Response measure_response(Config& config, ResponseOf of, const std::function<bool()>& stop) {
  const DriveConfig d = config.drive();
  const FocParameters foc = foc_of(config);
  const Multisine x = signal_of(d, foc, of);
  DisturbedLoop loop(config);
  Response response{of, d.rates.n, true, {}};
  const auto settling = static_cast<std::int64_t>(std::llround(d.run.settle_s / d.T_s()));
  std::vector<std::vector<Complex>> Y(kPeriods, std::vector<Complex>(x.lines.size()));
  for (std::int64_t k = 0; k < settling + (1 + kPeriods) * x.period; ++k) {
    if (stop && stop()) return response;
    const std::int64_t since = k - settling;
    const auto tick = loop.step(of, since < 0 ? 0 : x.at(since), std::min(k, settling));
    if (since < 0) continue;
    if (!tick.finite_and_in_step) {
      response.locked = false;
      return response;
    }
    const auto period = since / x.period - 1;
    if (period < 0) continue;
    const double y = of == ResponseOf::kCurrent ? tick.truth.i_dq[0] : tick.truth.omega_m;
    const double turn = kTwoPi * static_cast<double>(since % x.period) / x.period;
    for (std::size_t l = 0; l < x.lines.size(); ++l)
      Y[static_cast<std::size_t>(period)][l] += y * std::polar(2.0 / x.period, -turn * x.lines[l]);
  }
  const bool has_design = d.controller.kind == "foc";
  for (std::size_t l = 0; l < x.lines.size(); ++l) {
    Complex mean;
    double square = 0;
    for (const auto& lines : Y) mean += lines[l] / static_cast<double>(kPeriods);
    for (const auto& lines : Y) square += std::norm(lines[l]) / kPeriods;
    ResponseLine line;
    line.f = x.lines[l] * d.rates.f_s_Hz / x.period;
    line.H = mean / std::polar(x.amplitude[l], x.phase[l]);
    line.coherence = std::norm(mean) / square;
    line.sigma = std::abs(line.H) * std::sqrt(std::max(0.0, 1 / line.coherence - 1) /
                                              static_cast<double>(kPeriods - 1));
    if (has_design) line.design = design(of, d, foc, line.f);
    response.lines.push_back(line);
  }
  return response;
}

bool ResponseLine::measured() const {
  return 2 * sigma <= (1 - std::numbers::sqrt2 / 2) * std::abs(H);
}

std::optional<double> bandwidth(const Response& response, bool of_design) {
  if (response.lines.empty() || !(of_design || response.lines.front().measured())) return {};
  const auto gain = [&](const ResponseLine& l) {
    return of_design ? (l.design ? std::abs(*l.design) : NAN) : std::abs(l.H);
  };
  const double level = gain(response.lines.front()) * std::numbers::sqrt2 / 2;
  const ResponseLine* below = &response.lines.front();
  for (const ResponseLine& line : response.lines) {
    if (!of_design && !line.measured()) continue;
    const double a = gain(*below), b = gain(line);
    if (a >= level && b < level)
      return below->f * std::pow(line.f / below->f, std::log(a / level) / std::log(a / b));
    below = &line;
  }
  return {};
}

}  // namespace twinrate
