#include "tune/consistency.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

#include "analysis/summary.hpp"
#include "estimator/make_filter.hpp"
#include "loop/closed_loop.hpp"
#include "loop/estimator_loop.hpp"
#include "loop/load_drive.hpp"
#include "sweep/plan.hpp"
#include "tune/knobs.hpp"

namespace twinrate::tune {
namespace {

using Outputs = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxOutputs, 1>;
using Square = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxOutputs, kMaxOutputs>;
using StateSquare =
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxStates, kMaxStates>;
using StateByOutput =
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxStates, kMaxOutputs>;

// 95 % quantiles of chi-square with 1 to 4 degrees of freedom.
constexpr double kQuantile[] = {3.841, 5.991, 7.815, 9.488};

// R of the filter's outputs; the reduced disturbance filter has only the last output.
std::vector<double> noise_of(Config& config) {
  for (const auto& [key, values] : knobs_of(config).keys)
    if (key.ends_with(".R_diag") || key.ends_with(".R")) return values;
  throw BadInput("estimator." + config.drive().estimator.kind + ": has no R to tune");
}

Outputs noise_of(const std::vector<double>& all, int n_y) {
  Outputs R(n_y);
  const int count = static_cast<int>(all.size());
  for (int i = 0; i < n_y; ++i)
    R[i] = all[static_cast<std::size_t>(count == 1 ? 0 : count - n_y + i)];
  return R;
}

// (I - H K)^-1 R with H K = R K' P^-1 K. P is scaled to a diagonal of ones, because its units
// differ. Empty if it is singular.
std::optional<Square> innovation_covariance(const Gain& gain, const Outputs& R) {
  const StateByOutput K = gain.K.topLeftCorner(gain.n_x, gain.n_y);
  const Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxStates, 1> size =
      gain.P.diagonal().head(gain.n_x).cwiseSqrt();
  if (!(size.minCoeff() > 0)) return {};
  const StateSquare P = size.cwiseInverse().asDiagonal() *
                        gain.P.topLeftCorner(gain.n_x, gain.n_x) * size.cwiseInverse().asDiagonal();
  const StateByOutput scaled = size.cwiseInverse().asDiagonal() * K;
  const Eigen::LDLT<StateSquare> factor(P);
  if (factor.info() != Eigen::Success || !factor.isPositive()) return {};
  const Square HK = R.asDiagonal() * Square(scaled.transpose() * factor.solve(scaled));
  const Square rest = Square::Identity(gain.n_y, gain.n_y) - HK;
  const Square S = rest.partialPivLu().solve(Square(R.asDiagonal()));
  if (!S.allFinite() || !(S.diagonal().minCoeff() > 0)) return {};
  return Square(0.5 * (S + S.transpose()));
}

// Sums over the judged ticks for the figures of Consistency.
class Sums {
 public:
  void add(std::int64_t k, const Outputs& innov, const Square& S) {
    const Eigen::LLT<Square> factor(S);
    if (factor.info() != Eigen::Success) return;
    const Outputs white = factor.matrixL().solve(innov);
    const double nis = white.squaredNorm();
    const int n_y = static_cast<int>(innov.size());
    nis_ += nis / n_y;
    const double log_det = 2 * factor.matrixLLT().diagonal().array().log().sum();
    log_det_ += log_det;
    of_tick_.push_back({k, log_det, nis, n_y});
    inside_ += nis < kQuantile[n_y - 1] ? 1 : 0;
    if (last_.size() == innov.size()) product_ += white.dot(last_), square_ += nis;
    last_ = white;
    n_y_ = n_y;
    ++ticks_;
  }
  void interrupt() { last_.resize(0); }
  void write(Consistency& c) const {
    c.of_tick = of_tick_;
    const auto count = static_cast<double>(ticks_);
    c.ticks = ticks_;
    c.nis = nis_ / count;
    c.inside = static_cast<double>(inside_) / count;
    c.autocorrelation = square_ > 0 ? product_ / square_ : 0;
    c.log_likelihood = -0.5 * (log_det_ / count + n_y_ * c.nis);
    c.best_log_likelihood = -0.5 * (log_det_ / count + n_y_ * (std::log(c.nis) + 1));
  }
  bool empty() const { return ticks_ == 0; }

 private:
  std::int64_t ticks_ = 0, inside_ = 0;
  double nis_ = 0, log_det_ = 0, product_ = 0, square_ = 0;
  int n_y_ = 0;
  Outputs last_;
  std::vector<TickLikelihood> of_tick_;
};

// The innovation in rotor axes if the filter is in the stationary frame.
Outputs in_rotor_axes(Outputs innov, const Estimate& e, bool turns) {
  if (turns) innov.head<2>() = rotate(Vec2(innov.head<2>()), -e.theta_e);
  return innov;
}

Square in_rotor_axes(Square S, const Gain& gain, bool turns) {
  if (!turns) return S;
  Square T = Square::Identity(S.rows(), S.cols());
  const double c = std::cos(gain.theta_e), s = std::sin(gain.theta_e);
  T.topLeftCorner<2, 2>() << c, s, -s, c;
  return T * S * T.transpose();
}

std::vector<std::string> with(std::vector<std::string> list, const std::vector<std::string>& more) {
  list.insert(list.end(), more.begin(), more.end());
  return list;
}

void require_rate(const RunLog& log, const DriveConfig& drive, const std::string& file) {
  if (log.measurement.size() < 2) throw BadInput(log.path + ": holds no measurements");
  const Measurement &a = log.measurement.front(), &b = log.measurement.back();
  const double T_s = 1e-9 * static_cast<double>(b.t_ns - a.t_ns) / static_cast<double>(b.k - a.k);
  if (std::abs(T_s / drive.T_s() - 1) > 1e-3)
    throw BadInput(fmt::format("{}: recorded at {:.6g} Hz, but {} has rates.f_s_Hz = {:.6g}",
                               log.path, 1 / T_s, file, drive.rates.f_s_Hz));
}

// The log with the estimates of this filter. COMMAND is left out: in open loop the speed is not
// judged.
RunLog with_estimates(const RunLog& log, std::vector<Estimate> estimate) {
  RunLog own;
  own.path = log.path;
  own.measurement = log.measurement;
  own.truth = log.truth;
  own.estimate = std::move(estimate);
  return own;
}

bool judged(const Estimate& e, const Measurement& m) {
  constexpr int kWithout =
      kBeforeFirstGain | kGapBridged | kNotFinite | kAngleForced | kScheduledGain;
  return e.gain_seq >= 0 && (e.status & kWithout) == 0 && m.mode == Mode::kRun;
}

}  // namespace

Consistency consistency_of(const std::string& drive, const std::vector<std::string>& overrides,
                           const RunLog& log, double from, double to, Angle angle) {
  Config config = load_drive(drive, with(overrides, {"gain.policy=paper", "rates.f_b_Hz=0",
                                                     "rates.n=1", "rates.n_from=start"}));
  const DriveConfig& d = config.drive();
  require_rate(log, d, drive);
  const std::vector<double> noise = noise_of(config);
  const bool turns = make_filter(config)->turning_pairs() > 0;
  EstimatorLoop loop(config);
  const double begin = 1e-9 * static_cast<double>(log.measurement.front().t_ns) + d.run.settle_s,
               end = 1e-9 * static_cast<double>(log.measurement.back().t_ns);
  const double first = begin + from * (end - begin), last = begin + to * (end - begin);
  Sums sums;
  std::vector<Estimate> estimates;
  estimates.reserve(log.measurement.size());
  Gain used;
  std::optional<Square> S;  // of `used`
  for (const Measurement& m : log.measurement) {
    const double t = 1e-9 * static_cast<double>(m.t_ns);
    if (t > last) break;
    const Estimate& e = loop.tick(m);
    estimates.push_back(e);
    if (S && t >= first && judged(e, m) && used.k == e.gain_seq)
      sums.add(m.k, in_rotor_axes(Outputs(e.innov.head(e.n_y)), e, turns), *S);
    else
      sums.interrupt();
    if (!loop.has_gain() || t < first) continue;
    used = loop.gain();
    S = innovation_covariance(used, noise_of(noise, used.n_y));
    if (S) S = in_rotor_axes(*S, used, turns);
  }
  if (sums.empty())
    throw BadInput(fmt::format("{}: no tick after run.settle_s = {:g} s at which the filter ran",
                               log.path, d.run.settle_s));
  Consistency c;
  sums.write(c);
  constexpr double kNothing =
      1e-9;  // NIS of innovations a thirty-thousandth of the expected deviation
  if (!(c.nis > kNothing))
    throw BadInput(
        fmt::format("{}: every innovation is zero: the log has no current to tune with", log.path));
  if (angle == Angle::kLeftOut) return c;
  const Summary summary = summarise(with_estimates(log, std::move(estimates)), d);
  c.locked = summary.locked;
  c.angle_error_rms = summary.angle_error_rms;
  c.speed_error_rms = summary.speed_error_rms;
  return c;
}

Gained gained(const Consistency& before, const Consistency& after) {
  constexpr std::size_t kBlocks = 20;
  std::vector<double> differences;
  auto b = before.of_tick.begin();
  for (const TickLikelihood& a : after.of_tick) {
    while (b != before.of_tick.end() && b->k < a.k) ++b;
    if (b != before.of_tick.end() && b->k == a.k)
      differences.push_back(a.of(1) - b->of(before.nis));
  }
  const std::size_t blocks = std::min(kBlocks, differences.size() / 10);
  Gained g{0, std::numeric_limits<double>::infinity()};
  for (const double d : differences) g.mean += d / static_cast<double>(differences.size());
  if (blocks < 4) return g;
  double square = 0;
  for (std::size_t i = 0; i < blocks; ++i) {
    const std::size_t from = differences.size() * i / blocks;
    const std::size_t to = differences.size() * (i + 1) / blocks;
    double mean = 0;
    for (std::size_t k = from; k < to; ++k) mean += differences[k] / static_cast<double>(to - from);
    square += (mean - g.mean) * (mean - g.mean);
  }
  const auto n = static_cast<double>(blocks);
  g.sigma = std::sqrt(square / (n * (n - 1)));
  return g;
}

std::optional<int> n_max_on(const std::string& drive, const std::vector<std::string>& overrides,
                            const RunLog& log, int most, const std::function<bool()>& stop) {
  int held = 0;
  while (held < most && !stop()) {
    const int n = std::min(most, sweep::next_n(held));
    Config config = load_drive(
        drive,
        with(overrides, {"rates.f_b_Hz=0", fmt::format("rates.n={}", n), "rates.n_from=start"}));
    EstimatorLoop loop(config);
    std::vector<Estimate> estimates;
    estimates.reserve(log.measurement.size());
    for (const Measurement& m : log.measurement) estimates.push_back(loop.tick(m));
    const auto locked = summarise(with_estimates(log, std::move(estimates)), config.drive()).locked;
    if (!locked) return {};
    if (!*locked) break;
    held = n;
  }
  return held;
}

bool holds_in_closed_loop(const std::string& drive, const std::vector<std::string>& overrides) {
  Config config = load_drive(drive, overrides);
  ClosedLoop loop(config);
  RunLog log;
  while (loop.k() < config.drive().steps()) {
    const TickRecord& tick = loop.step();
    log.measurement.push_back(tick.measurement);
    log.truth.push_back(tick.truth);
    log.estimate.push_back(tick.estimate);
    log.command.push_back(tick.command);
    if (is_trip(tick.event.reason)) return false;
    for (const PlantEvent& event : tick.plant_events)
      if (is_trip(event.reason)) return false;
  }
  return summarise(log, config.drive()).locked.value_or(false);
}

}  // namespace twinrate::tune
