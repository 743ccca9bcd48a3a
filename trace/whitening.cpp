#include "trace/whitening.hpp"

#include <algorithm>
#include <cmath>

#include "model/frames.hpp"
#include "trace/fir.hpp"

namespace twinrate {
namespace {

// Calls f(first, end) for each run.
template <class F>
void for_each_run(const Runs& runs, F&& f) {
  for (std::size_t r = 0; r < runs.start.size(); ++r)
    f(static_cast<Eigen::Index>(runs.start[r]),
      static_cast<Eigen::Index>(r + 1 < runs.start.size() ? runs.start[r + 1] : runs.row.size()));
}

constexpr double kSlowest_Hz = 3;  // limit of the share of angle noise: the drive is not quieter
constexpr double kHalfSteps = 2;   // steps a decade of the shares that are tried

}  // namespace

AngleNoise::AngleNoise(double w_over_s) : w_over_s_(w_over_s) {
  constexpr std::size_t kLongest = 4096;
  constexpr double kSettled = 1e-10;
  const double c[] = {6 + w_over_s, -4, 1};  // autocovariance
  double before = c[0], last = c[0];         // powers of the last two innovations
  Step step;
  std::vector<double> power = {c[0]};
  after_.push_back(step);
  while (after_.size() < kLongest) {
    const std::size_t n = after_.size();
    step.two = n < 2 ? 0 : c[2] / before;
    step.one = (c[1] - (n < 2 ? 0 : after_.back().one * step.two * before)) / last;
    const double now =
        c[0] - step.one * step.one * last - (n < 2 ? 0 : step.two * step.two * before);
    before = last;
    last = now;
    after_.push_back(step);
    power.push_back(now);
    if (std::abs(last - before) < kSettled * last) break;
  }
  for (std::size_t n = 0; n < after_.size(); ++n) after_[n].size = std::sqrt(power[n] / last);
}

AngleNoise AngleNoise::of(const Eigen::VectorXd& noise, const Runs& runs, double T_s) {
  AngleNoise best;
  if (!(noise.squaredNorm() > 0)) return best;
  const double n = static_cast<double>(noise.size());
  // Twice the negative logarithm of the likelihood, without the terms common to all.
  const auto unlikely = [&](const AngleNoise& angle) {
    const Whitener left(angle(noise, runs), runs, angle, 0);
    return 2 * (n * std::log(left.sigma()) + angle.log_deviations(runs));
  };
  double least = unlikely(best) - std::log(n);
  const double slowest = std::pow(kTwoPi * kSlowest_Hz * T_s, 4);
  for (double share = 1; share > slowest; share /= std::pow(10, 1 / kHalfSteps)) {
    const AngleNoise angle(share);
    if (const double now = unlikely(angle); now < least) least = now, best = angle;
  }
  return best;
}

double AngleNoise::log_deviations(const Runs& runs) const {
  double sum = 0;
  for_each_run(runs, [&](Eigen::Index first, Eigen::Index end) {
    const auto settling = std::min(static_cast<std::size_t>(end - first), after_.size());
    for (std::size_t n = 0; n < settling; ++n) sum += std::log(after_[n].size);
  });
  return sum;
}

Eigen::VectorXd AngleNoise::operator()(const Eigen::VectorXd& y, const Runs& runs) const {
  if (none()) return y;
  Eigen::VectorXd e(y.size());
  for_each_run(runs, [&](Eigen::Index first, Eigen::Index end) {
    double before = 0, last = 0;  // innovations
    for (Eigen::Index n = first; n < end; ++n) {
      const Step& step = after_[std::min(static_cast<std::size_t>(n - first), after_.size() - 1)];
      const double now = y[n] - step.one * last - step.two * before;
      before = last;
      last = now;
      e[n] = now / step.size;
    }
  });
  return e;
}

Whitener::Whitener(const Eigen::VectorXd& innovations, const Runs& runs, AngleNoise angle,
                   double rms)
    : Whitener(innovations, runs) {
  angle_ = std::move(angle);
  rms_ = rms;
}

Whitener::Whitener(const Eigen::VectorXd& noise, const Runs& runs, int most) {
  Eigen::VectorXd c = Eigen::VectorXd::Zero(most + 1);
  for_each_run(runs, [&](Eigen::Index first, Eigen::Index end) {
    for (Eigen::Index lag = 0; lag <= most && lag < end - first; ++lag)
      c[lag] += noise.segment(first + lag, end - first - lag)
                    .dot(noise.segment(first, end - first - lag));
  });
  c /= std::max<double>(1, static_cast<double>(noise.size()));
  const double floor = 1e-9 * c[0] + 1e-300;
  c[0] += floor;
  Eigen::VectorXd a = Eigen::VectorXd::Zero(0);
  double power = c[0];
  const auto keep = [&] {
    sigma_.push_back(std::sqrt(std::max(power, floor)));
    taps_.emplace_back(a.size() + 1);
    taps_.back() << -a.reverse(), 1;
    taps_.back() /= sigma_.back();
  };
  keep();
  rms_ = sigma_.front();
  for (int order = 1; order <= most; ++order) {
    double reflection = c[order];
    for (int j = 0; j < order - 1; ++j) reflection -= a[j] * c[order - 1 - j];
    reflection /= power;
    Eigen::VectorXd next(order);
    for (int j = 0; j < order - 1; ++j) next[j] = a[j] - reflection * a[order - 2 - j];
    next[order - 1] = reflection;
    a = next;
    power *= 1 - reflection * reflection;
    keep();
  }
}

Eigen::VectorXd Whitener::operator()(const Eigen::VectorXd& x, const Runs& runs) const {
  const Eigen::VectorXd y = angle_(x, runs);
  Eigen::VectorXd e(y.size());
  const auto p = static_cast<Eigen::Index>(taps_.size()) - 1;
  for_each_run(runs, [&](Eigen::Index first, Eigen::Index end) {
    const Eigen::Index steady = std::min<Eigen::Index>(first + p, end);
    for (Eigen::Index n = first; n < steady; ++n) {
      const Eigen::Index known = n - first + 1;
      e[n] = taps_[static_cast<std::size_t>(known) - 1].dot(y.segment(first, known));
    }
    if (end > steady)
      filter_along({taps_.back().data(), taps_.size()}, y.data() + steady - p,
                   static_cast<std::size_t>(end - steady), e.data() + steady);
  });
  return e;
}

}  // namespace twinrate
