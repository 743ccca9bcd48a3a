#include "trace/held_currents.hpp"

#include <cmath>

namespace twinrate {
namespace {

// Sigmas that a claim needs, from the side on which repeated rows lie and from their number. The
// scatter of the sides has long tails: of 150 drawn logs without held currents the largest is 4.1,
// of 800 one was 4.7 (1000 counts); of five found with them four are 8.3 to 12.6, and one is 4.7.
constexpr double kSureOfSide = 6, kSure = 4.5;
constexpr double kOneWay = 3.5;  // sigmas of a preferred side that rule out a claim
constexpr double kFewSteps = 2;  // steps of the converter
constexpr std::size_t kSide = 3;
constexpr std::size_t kStill = 256;  // rows of one angle after which the rotor stands still
static_assert(kSide + 1 <= kStaleReach && CurrentPair::kDistances <= kSide + 1);
// Mean squared change over two to four rows, over that of one row. Of 23 drawn logs with repeated
// rows 17 have ratios of 0.82 to 1.42; the other six are judged as before, by other rules. Five
// logs whose currents leap at each count of an encoder have at least one ratio of 0.3, or 1.57 to
// 2.6.
constexpr double kWhiteLeast = 0.75, kWhiteMost = 1.45;

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
  const bool third = !raw.i_a.empty() && !raw.i_c.empty();
  pair.third = third && std::abs(x[k] + y[k] + raw.i_c[k]) > Health::kSumOfPhases;
  const auto same = [&](std::size_t as) -> Repeated {
    return {x[k] == x[as], y[k] == y[as], !third || raw.i_c[k] == raw.i_c[as]};
  };
  pair.repeated = same(k - 1);
  pair.over_one = same(k - 2);
  pair.here = row(k);
  pair.step = row(k) - row(k - 1);
  // Least squares of a parabola about the middle of the two rows: its slope and its value there.
  constexpr double kSlope[kSide] = {1.5 / 41.5, 2.5 / 41.5, 3.5 / 41.5};
  constexpr double kValue[kSide] = {18.0 / 19, 8.0 / 19, -7.0 / 19};
  pair.ahead = row(k) + row(k - 1);
  for (std::size_t j = 0; j < kSide; ++j) {
    const Vec2 after = row(k + 1 + j), before = row(k - 2 - j);
    pair.way += kSlope[j] * (after - before);
    pair.ahead -= kValue[j] * (after + before);
  }
  for (std::size_t m = 1; m <= CurrentPair::kDistances; ++m)
    pair.changes[m - 1] = (row(k) - row(k - m) - static_cast<double>(m) * pair.way).squaredNorm();
  if (!third) return pair;
  pair.noise_z = raw.i_c[k] - raw.i_c[k - 1];
  for (std::size_t j = 0; j < kSide; ++j)
    pair.noise_z -= kSlope[j] * (raw.i_c[k + 1 + j] - raw.i_c[k - 2 - j]);
  return pair;
}

void HeldCurrents::add(const CurrentPair& pair, bool angle_moves) {
  constexpr int kFew = 32;
  ++seen_;
  if (seen_ - few_.begin > 2 * kFew) few_ = {.begin = seen_};
  if (angle_moves) moved_ = seen_;
  if (!pair.known) return;
  third_ |= pair.third;
  for (double step : pair.step.cwiseAbs())
    if (step > kSameCurrent) least_step_ = std::min(least_step_, step);
  if (pair.way.norm() > least_step_) {
    const auto [x, y, z] = pair.repeated;
    const Vec2 behind = -pair.ahead.cwiseProduct(pair.way);
    squares_ += pair.way.squaredNorm();
    if (pair.repeats()) together_.add(behind.sum());
    if (x && !y) x_alone_.add(behind[0]);
    if (y && !x) y_alone_.add(behind[1]);
    return;
  }
  const bool turning = moved_ > 0 && seen_ - moved_ < kStill;
  if (!turning || pair.here.norm() < kFewSteps * least_step_) return;
  ++few_.rows;
  few_.next.add(pair.repeated, third_);
  few_.over_one.add(pair.over_one, third_);
  Eigen::Vector3d noise;
  noise << pair.step - pair.way, pair.noise_z;
  steps_ += noise * noise.transpose();
  for (std::size_t m = 0; m < changes_.size(); ++m) changes_[m] += pair.changes[m];
  ++rows_;
  if (few_.rows == kFew) close_few();
}

void HeldCurrents::Counts::add(const Repeated& repeated, bool third) {
  x += repeated.x;
  y += repeated.y;
  z += repeated.z || !third;
  all += repeated.all();
}

void HeldCurrents::close_few() {
  const double n = few_.rows;
  const auto chance = [n](const Counts& of) { return n * (of.x / n) * (of.y / n) * (of.z / n); };
  const double x = few_.next.x / n, y = few_.next.y / n, z = few_.next.z / n;
  const double left = 1 - x * y - y * z - z * x + 2 * x * y * z;  // share not equal by chance
  all_ += few_.next.all;
  by_chance_ += chance(few_.next);
  variance_ += chance(few_.next) * left;
  others_ += n * left;
  all_over_one_ += few_.over_one.all;
  by_chance_over_one_ += chance(few_.over_one);
  few_ = {.begin = seen_};
}

double HeldCurrents::beyond_chance(double i_lsb) const {
  constexpr double kReach =
      0.57;  // steps squared, from noise of half a step; 1/6 is the converter's own
  const Eigen::Array3d powers = steps_.diagonal();
  const Eigen::Index sensors = third_ ? 3 : 2;
  if (variance_ <= 0 || i_lsb <= 0 || (powers.head(sensors) < kReach * i_lsb * i_lsb * rows_).any())
    return 0;
  for (const double change : changes_)
    if (change < kWhiteLeast * changes_[0] || change > kWhiteMost * changes_[0]) return 0;
  const double det = third_ ? steps_.determinant() : steps_.topLeftCorner<2, 2>().determinant(),
               det_R = det / powers.head(sensors).prod();
  const double alike = std::max(1 / std::sqrt(std::max(1e-6, det_R)),
                                all_over_one_ / std::max(1.0, by_chance_over_one_));
  const double more = all_ - by_chance_ * alike;
  return more > kSure * std::sqrt(variance_ * (1 + alike * alike)) ? more / others_ : 0;
}

double HeldCurrents::behind_beyond_chance() const {
  const double n = together_.rows;
  double more = together_.sum, variance = together_.squares;
  for (const Behind& alone : {x_alone_, y_alone_}) {
    if (alone.rows == 0) continue;
    more -= n / alone.rows * alone.sum;
    variance += std::pow(n / alone.rows, 2) * alone.squares;
  }
  const bool one_way = std::abs(x_alone_.sum + y_alone_.sum) >
                       kOneWay * std::sqrt(x_alone_.squares + y_alone_.squares);
  return !one_way && more > kSureOfSide * std::sqrt(variance) && squares_ > 0 ? more / squares_ : 0;
}

double HeldCurrents::share(double i_lsb) const {
  const double behind = behind_beyond_chance();
  return behind > 0 ? behind : beyond_chance(i_lsb);
}

}  // namespace twinrate
