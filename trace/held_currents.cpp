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
  pair.repeats = x[k] == x[k - 1] && y[k] == y[k - 1];
  const auto row = [&](std::size_t j) { return Vec2(x[j], y[j]); };
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

void HeldCurrents::add(const CurrentPair& pair) {
  squares_ += pair.way.squaredNorm();
  if (!pair.repeats) return;
  const double behind = -pair.ahead.dot(pair.way);
  behind_ += behind;
  scatter_ += behind * behind;
}

double HeldCurrents::share() const {
  return behind_ > kSure * std::sqrt(scatter_) && squares_ > 0 ? behind_ / squares_ : 0;
}

}  // namespace twinrate
