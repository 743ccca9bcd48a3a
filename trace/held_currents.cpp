#include "trace/held_currents.hpp"

#include <cmath>

namespace twinrate {
namespace {

constexpr double kSure = 3.5;  // sigmas
constexpr std::size_t kSide = 3;
static_assert(kSide + 1 <= kStaleReach);

}  // namespace

CurrentPair current_pair(const RawLog& raw, std::size_t k, double T_s) {
  const auto& x = raw.i_a.empty() ? raw.i_alpha : raw.i_a;
  const auto& y = raw.i_b.empty() ? raw.i_beta : raw.i_b;
  CurrentPair pair;
  if (x.empty() || y.empty() || k < kSide + 1 || k + kSide >= raw.size()) return pair;
  constexpr double kRows = 2 * kSide + 1;
  if (std::abs(raw.t[k + kSide] - raw.t[k - kSide - 1] - kRows * T_s) > T_s / 2) return pair;
  const auto row = [&](std::size_t j) { return Vec2(x[j], y[j]); };
  pair.known = true;
  pair.x_repeats = x[k] == x[k - 1];
  pair.y_repeats = y[k] == y[k - 1];
  pair.step = row(k) - row(k - 1);
  // Least squares of a parabola about the middle of the two rows: its slope, its value.
  constexpr double kSlope[kSide] = {1.5 / 41.5, 2.5 / 41.5, 3.5 / 41.5};
  constexpr double kValue[kSide] = {18.0 / 19, 8.0 / 19, -7.0 / 19};
  pair.ahead = row(k) + row(k - 1);
  for (std::size_t j = 0; j < kSide; ++j) {
    const Vec2 after = row(k + 1 + j), before = row(k - 2 - j);
    pair.way += kSlope[j] * (after - before);
    pair.ahead -= kValue[j] * (after + before);
  }
  return pair;
}

void HeldCurrents::add(const CurrentPair& pair, bool turning) {
  constexpr int kFew = 32;
  ++seen_;
  if (seen_ - few_.begin > 2 * kFew) few_ = {.begin = seen_};
  if (!pair.known) return;
  squares_ += pair.way.squaredNorm();
  if (pair.repeats()) {
    const double behind = -pair.ahead.dot(pair.way);
    behind_ += behind;
    scatter_ += behind * behind;
  }
  for (double step : pair.step.cwiseAbs())
    if (step > kSameCurrent) least_step_ = std::min(least_step_, step);
  if (!turning || pair.way.norm() > least_step_) return;
  ++few_.rows;
  few_.x += pair.x_repeats;
  few_.y += pair.y_repeats;
  few_.both += pair.repeats();
  const Vec2 noise = pair.step - pair.way;
  steps_ += noise * noise.transpose();
  ++rows_;
  if (few_.rows == kFew) close_few();
}

void HeldCurrents::close_few() {
  const double n = few_.rows, x = few_.x / n, y = few_.y / n;
  both_ += few_.both;
  by_chance_ += n * x * y;
  variance_ += n * x * (1 - x) * y * (1 - y);
  others_ += n * (1 - x) * (1 - y);
  few_ = {.begin = seen_};
}

double HeldCurrents::beyond_chance(double i_lsb) const {
  constexpr double kSurer = 4.5;
  constexpr double kReach =
      0.57;  // steps squared, which noise of half a step makes; 1/6 is the converter's own
  if (variance_ <= 0 || i_lsb <= 0 ||
      (steps_.diagonal().array() < kReach * i_lsb * i_lsb * rows_).any())
    return 0;
  const double rho2 = std::pow(steps_(0, 1), 2) / (steps_(0, 0) * steps_(1, 1));
  const double more = both_ - by_chance_ / std::sqrt(std::max(1e-6, 1 - rho2));
  return more > kSurer * std::sqrt(variance_) ? more / others_ : 0;
}

double HeldCurrents::share(double i_lsb) const {
  return behind_ > kSure * std::sqrt(scatter_) && squares_ > 0 ? behind_ / squares_
                                                               : beyond_chance(i_lsb);
}

}  // namespace twinrate
