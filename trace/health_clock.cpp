#include "trace/health_clock.hpp"

#include <algorithm>
#include <cmath>

#include "model/frames.hpp"

namespace twinrate {
namespace {

constexpr double kGap = 4;          // T_s: an interval of this length is a gap
constexpr double kFollow = 0.05;    // share of a stamp's deviation that the grid follows
constexpr double kDoubt = 0.3;      // T_s, of the first interval
constexpr double kOff = 0.05;       // T_s from a multiple: not on an even clock
constexpr double kFewOff = 0.02;    // of the intervals
constexpr double kToldApart = 0.2;  // largest sigma of a slope that distinguishes 0 from 1

// The cubic through rows [first, first + 4), or the line through two rows at an end.
double value_between(const RawLog& raw, const std::vector<double>& x, std::size_t first,
                     std::size_t end, double t) {
  double sum = 0;
  for (std::size_t j = first; j < end; ++j) {
    double weight = 1;
    for (std::size_t m = first; m < end; ++m)
      if (m != j) weight *= (t - raw.t[m]) / (raw.t[j] - raw.t[m]);
    sum += weight * x[j];
  }
  return sum;
}

// Voltage in stator axes, row by row.
void to_stator(RawLog& raw, int n_p) {
  if (raw.u_d.empty() || raw.u_q.empty() || !raw.u_alpha.empty()) return;
  for (std::size_t k = 0; k < raw.size(); ++k) {
    const Vec2 u = inverse_park({raw.u_d[k], raw.u_q[k]}, n_p * raw.theta_m[k]);
    raw.u_alpha.push_back(u[0]);
    raw.u_beta.push_back(u[1]);
  }
}

// The voltage of the interval after row j is the mean of a vector that turns with the rotor. So
// parts of the interval have their share of it without a lag, and together the whole. Without an
// angle the vector is constant.
class HeldVoltage {
 public:
  HeldVoltage(const RawLog& raw, int n_p) : raw_(raw), n_p_(raw.theta_m.empty() ? 0 : n_p) {}
  // Mean over [t, t + T], from row k on.
  Vec2 mean(std::size_t k, std::size_t end, double t, double T) const {
    Vec2 sum = Vec2::Zero();
    for (std::size_t j = k; j + 1 < end && raw_.t[j] < t + T; ++j)
      sum += part(j, std::max(raw_.t[j], t), std::min(raw_.t[j + 1], t + T)) / T;
    return sum;
  }

 private:
  // Integral over [from, to], within the interval after row j.
  Vec2 part(std::size_t j, double from, double to) const {
    const double T = raw_.t[j + 1] - raw_.t[j];
    const double turned = n_p_ == 0 ? 0 : n_p_ * (raw_.theta_m[j + 1] - raw_.theta_m[j]);
    const double later = (0.5 * (from + to) - 0.5 * (raw_.t[j] + raw_.t[j + 1])) / T;
    const Vec2 u = inverse_park({raw_.u_alpha[j], raw_.u_beta[j]}, turned * later);
    // The mean of a vector that turns by phi is shorter by sin(phi/2)/(phi/2).
    const double share = std::abs(turned) < 1e-6
                             ? (to - from) / T
                             : std::sin(0.5 * turned * (to - from) / T) / std::sin(0.5 * turned);
    return share * T * u;
  }

  const RawLog& raw_;
  int n_p_;
};

bool is_mean(const RawColumn& c) {
  return c.values == &RawLog::u_alpha || c.values == &RawLog::u_beta;
}

}  // namespace

std::int64_t EvenGrid::steps_to(double t, double T_s) {
  if (!at_) {
    at_ = t;
    return 0;
  }
  // Two stamps may stray by more than half a row. Until the grid is known they add no row.
  const double doubt = kDoubt / (rows_ + 1);
  const auto steps = std::max<std::int64_t>(1, std::llround((t - *at_) / T_s - doubt));
  const double there = *at_ + static_cast<double>(steps) * T_s;
  // The first stamp, and the first after a gap, may stray: the mean of the first rows corrects it.
  rows_ = static_cast<double>(steps) > kGap ? 0 : rows_ + 1;
  at_ = there + std::max(kFollow, 1 / (rows_ + 1)) * (t - there);
  return steps;
}

void ClockScan::add(double t, const double* theta_m, double T_s) {
  const std::int64_t steps = grid_.steps_to(t, T_s);
  const Row row{t, theta_m ? *theta_m : 0};
  ++rows_;
  if (!last_) {
    first_t_ = t;
    last_ = row;
    return;
  }
  const double d = t - last_->t, row_number = static_cast<double>(rows_ - 1);
  shortest_ = std::max(shortest_, (t - first_t_ - 2 * T_s) / row_number);
  longest_ = std::min(longest_, (t - first_t_ + 2 * T_s) / row_number);
  steps_ += steps;
  missing_ += static_cast<std::size_t>(steps - 1);
  if (d > kGap * T_s) {
    gaps_ += static_cast<std::size_t>(std::llround(d / T_s)) - 1;
    before_.reset();
    last_ = row;
    return;
  }
  const double own = d / T_s - 1;
  ++intervals_;
  time_ += d;
  time_squares_ += d * d;
  off_ += std::abs(d / T_s - std::max(1.0, std::round(d / T_s))) > kOff;
  if (before_) {
    const double d_before = last_->t - before_->t, own_before = d_before / T_s - 1;
    if (own < 0.9 && own_before < 0.9) {  // else a row is missing
      ++pairs_;
      squares_ += own * own;
      products_ += own * own_before;
    }
    const double turned = std::remainder(row.theta_m - last_->theta_m, kTwoPi),
                 turned_before = std::remainder(last_->theta_m - before_->theta_m, kTwoPi);
    const double omega_m = (turned + turned_before) / (d + d_before);
    const double stamps = omega_m * (d - d_before), angle = turned - turned_before;
    ++turning_;
    angle_squares_ += angle * angle;
    stamp_squares_ += stamps * stamps;
    both_ += angle * stamps;
  }
  before_ = last_;
  last_ = row;
}

ClockScan::Stamps ClockScan::result(double T_s) const {
  Stamps s{.T_s = T_s, .missing = missing_};
  const double intervals = static_cast<double>(intervals_);
  s.stray = static_cast<double>(off_) > kFewOff * intervals;
  const double sigma = std::sqrt(angle_squares_ / std::max(1.0, static_cast<double>(turning_)) /
                                 std::max(1e-300, stamp_squares_));
  // Stamps of few digits: single and double intervals within two of even rows, and the angle follows
  // the row.
  if (static_cast<double>(missing_) > kFewOff * intervals && gaps_ == 0 && shortest_ <= longest_ &&
      sigma < kToldApart && 2 * both_ <= stamp_squares_) {
    const double T = time_ / intervals;
    return {.stray = true,
            .T_s = T,
            .jitter = std::sqrt(0.5 * std::max(0.0, time_squares_ / (intervals * T * T) - 1))};
  }
  if (!s.stray) return s;
  s.uneven = sigma < kToldApart ? 2 * both_ > stamp_squares_
                                : products_ > -0.25 * squares_;  // -0.5: around a grid; 0: no grid
  if (s.uneven) {
    s.T_s = time_ / static_cast<double>(intervals_);
    s.missing = gaps_;
    s.jitter = std::sqrt(squares_ / std::max(1.0, static_cast<double>(pairs_)));
  } else if (last_ && steps_ > 0) {
    s.T_s = (last_->t - first_t_) / static_cast<double>(steps_);
    // An interval has two stray stamps.
    s.jitter = std::sqrt(0.5 * squares_ / std::max(1.0, static_cast<double>(pairs_)));
  }
  return s;
}

RawLog even_rows(const RawLog& uneven, int n_p, double T_s) {
  RawLog raw = uneven;
  to_stator(raw, n_p);
  RawLog even;
  even.path = raw.path;
  const HeldVoltage held(raw, n_p);
  std::size_t k = 0;
  for (std::size_t first = 0, end = 0; first < raw.size(); first = end) {
    for (end = first + 1; end < raw.size() && raw.t[end] - raw.t[end - 1] <= kGap * T_s;) ++end;
    // The grid's times whose whole interval is in this stretch.
    k = first;
    double n = std::ceil((raw.t[first] - raw.t[0]) / T_s - 1e-9);
    for (; raw.t[0] + (n + 1) * T_s <= raw.t[end - 1]; ++n) {
      const double t = raw.t[0] + n * T_s;
      while (k + 1 < end && raw.t[k + 1] <= t) ++k;
      const bool cubic = k > first && k + 2 < end;
      even.t.push_back(t);
      for (const RawColumn& c : raw_columns()) {
        const std::vector<double>& x = raw.*c.values;
        if (x.empty()) continue;
        if (is_mean(c)) continue;
        (even.*c.values)
            .push_back(cubic ? value_between(raw, x, k - 1, k + 3, t)
                             : value_between(raw, x, k, k + 2, t));
      }
      if (raw.u_alpha.empty()) continue;
      const Vec2 u = held.mean(k, end, t, T_s);
      even.u_alpha.push_back(u[0]);
      even.u_beta.push_back(u[1]);
    }
  }
  return even;
}

}  // namespace twinrate
