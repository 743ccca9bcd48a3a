#include "trace/speed_law.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "model/effects/catalogue.hpp"
#include "model/effects/tracing.hpp"
#include "trace/keys.hpp"
#include "trace/scores.hpp"

namespace twinrate {
namespace {

constexpr double kLeastExponent = 0.25, kMostExponent = 5, kFirstStep = 0.25, kLastStep = 1e-2;
constexpr double kRidge = 1e-12;  // of a column's energy: two equal columns

bool is_by_speed(const Effect& effect) {
  const bool constant = is_of(effect, Traits::Family::kLoad) &&
                        effect.tracing().traits().place == Traits::Place::kLinear;
  return is_of(effect, Traits::Family::kFriction) || constant;
}

// Least squares of a target by columns, noise included.
class Squares {
 public:
  Squares(const Rows& rows, Sampled target) : rows_(rows), target_(std::move(target)) {
    all_ = product(target_, target_);
  }
  void add(const Sampled& column) { columns_.push_back(&column); }
  void pop() { columns_.pop_back(); }
  double left() const {
    const auto n = static_cast<Eigen::Index>(columns_.size());
    Eigen::MatrixXd A(n, n);
    Eigen::VectorXd b(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      b[i] = product(column(i), target_);
      for (Eigen::Index j = 0; j <= i; ++j) A(i, j) = A(j, i) = product(column(i), column(j));
    }
    A.diagonal() *= 1 + kRidge;
    return all_ - b.dot(A.ldlt().solve(b));
  }

 private:
  const Sampled& column(Eigen::Index i) const { return *columns_[static_cast<std::size_t>(i)]; }
  double product(const Sampled& a, const Sampled& b) const {
    const EquationEnergy e = rows_.energy(a, b);
    return e.electrical + e.torque;
  }
  const Rows& rows_;
  Sampled target_;
  std::vector<const Sampled*> columns_;
  double all_ = 0;
};

// The whitened torque |omega_m|^p sgn(omega_m).
class Powers {
 public:
  explicit Powers(const Chain& chain, const Sampled& like) : chain_(chain), like_(like) {
    for (const OperatingPoint& point : chain.equations().points()) {
      speed_.push_back(point.omega_m);
      fastest_ = std::max(fastest_, std::abs(point.omega_m));
    }
  }
  const Sampled& operator()(double p) {
    auto [there, is_new] = known_.try_emplace(p);
    if (is_new) there->second = made(p);
    return there->second;
  }

 private:
  Sampled made(double p) const {
    std::vector<double> torque;
    torque.reserve(speed_.size());
    for (double omega : speed_)
      torque.push_back(std::copysign(std::pow(std::abs(omega) / fastest_, p), omega));
    Sampled column;
    column.d.setZero(like_.d.size());
    column.q.setZero(like_.q.size());
    column.torque = chain_.sampler()(torque, chain_.sampler().torque());
    return chain_.regressor(column);
  }
  const Chain& chain_;
  const Sampled& like_;
  std::vector<double> speed_;
  double fastest_ = 1e-300;
  std::map<double, Sampled> known_;
};

// The exponent with the least error: on a grid, then ever closer round the best.
std::pair<double, double> best_exponent(Squares& squares, Powers& powers) {
  const auto left_by = [&](double p) {
    squares.add(powers(p));
    const double left = squares.left();
    squares.pop();
    return left;
  };
  double best = kLeastExponent, least = left_by(best);
  const auto ask = [&](double p) {
    if (p < kLeastExponent || p > kMostExponent) return;
    if (const double left = left_by(p); left < least) least = left, best = p;
  };
  for (double p = kLeastExponent + kFirstStep; p <= kMostExponent; p += kFirstStep) ask(p);
  for (double step = kFirstStep / 2; step > kLastStep; step /= 2)
    for (const double p : {best - step, best + step}) ask(p);
  return {best, least};
}

// True for an exponent of the catalogue to within the errors that a log may have. It refutes no
// single member.
bool of_catalogue(double exponent) {
  constexpr double kNear = 0.2;
  const double nearest = std::clamp(std::round(exponent), 0.0, 2.0);
  return std::abs(exponent - nearest) < kNear;
}
// The torque is then no power of the speed.
bool at_bound(double exponent) {
  return exponent < kLeastExponent + kFirstStep / 2 || exponent > kMostExponent - kFirstStep / 2;
}

// The error that is left without the replaced members, with a power of the speed instead.
struct Replaced {
  Squares squares;
  double parameters = 0;
};
Replaced without(const Fitter& fitter, const Fit& fit, const std::vector<std::size_t>& members) {
  const Chain& chain = fitter.chain();
  const auto is_replaced = [&](std::size_t m) {
    return std::find(members.begin(), members.end(), m) != members.end();
  };
  Effects others;
  double parameters = 0;
  for (std::size_t m = 0; m < fit.members.size(); ++m)
    if (is_replaced(m))
      parameters += static_cast<double>(parameters_of(*fit.members[m]));
    else
      others.push_back(fit.members[m]);
  Sampled target = fit.y;
  add(target, chain.whitened(chain.noiseless(others)), 1);
  add(target, chain.whitened(chain.noiseless(fit.effects())), -1);
  Replaced replaced{{fitter.training(), std::move(target)}, parameters};
  for (std::size_t i = 0; i < fit.free.size(); ++i)
    if (!is_replaced(fit.free[i].member)) replaced.squares.add(fit.J[i]);
  return replaced;
}

}  // namespace

std::optional<SpeedLaw> speed_law(const Fitter& fitter, const Fit& fit) {
  std::vector<std::size_t> by_speed;
  for (std::size_t m = 0; m < fit.members.size(); ++m)
    if (is_by_speed(*fit.members[m])) by_speed.push_back(m);
  if (by_speed.empty() || fit.J.size() != fit.free.size() || fit.y.torque.size() == 0) return {};
  const EquationEnergy now = fitter.training().energy(fit.y, fit.y);
  const double N = static_cast<double>(fitter.training().count(fit.y));
  Powers powers(fitter.chain(), fit.y);
  std::optional<SpeedLaw> best;
  for (unsigned chosen = 1; chosen < 1u << by_speed.size(); ++chosen) {
    fitter.chain().checkpoint();
    SpeedLaw law;
    for (std::size_t i = 0; i < by_speed.size(); ++i)
      if (chosen >> i & 1u) law.members.push_back(by_speed[i]);
    Replaced replaced = without(fitter, fit, law.members);
    const auto [exponent, left] = best_exponent(replaced.squares, powers);
    if (at_bound(exponent) || (law.members.size() == 1 && of_catalogue(exponent))) continue;
    law.exponent = exponent;
    law.gain = N * std::log((now.electrical + now.torque) / left) +
               (replaced.parameters - 2) * std::log(N);
    if (law.gain > fitter.margin() && (!best || law.gain > best->gain)) best = std::move(law);
  }
  return best;
}

std::vector<std::size_t> steps_at_reversals(const Record& record, const Members& members) {
  constexpr double kWindow_s = 0.02, kNear_s = 0.06;
  constexpr double kStill = 0.02;  // of the largest speed
  const auto window = static_cast<std::size_t>(std::max(1.0, std::round(kWindow_s / record.T_s)));
  const auto speed = [&](std::size_t k) { return record.theta_m[k + window] - record.theta_m[k]; };
  double fastest = 0;
  const auto is_known = [&](std::size_t k) {
    return record.motion_ok[k] && record.motion_ok[k + window];
  };
  for (std::size_t k = 0; k + window < record.size(); ++k)
    if (is_known(k)) fastest = std::max(fastest, std::abs(speed(k)));
  struct Reversal {
    double from, to, direction;
  };
  std::vector<Reversal> reversals;
  double before = 0, since = 0;
  for (std::size_t k = 0; k + window < record.size(); ++k) {
    const double now = speed(k);
    if (!is_known(k) || std::abs(now) <= kStill * fastest) continue;
    if (before * now < 0)
      reversals.push_back({since - kNear_s, record.t[k] + kWindow_s + kNear_s, now});
    before = now;
    since = record.t[k];
  }
  std::vector<std::size_t> steps;
  for (std::size_t m = 0; m < members.size(); ++m) {
    if (!is_placed(*members[m], Traits::Place::kMoment)) continue;
    const double t = get_key(*members[m], "time_s"), torque = get_key(*members[m], "torque_Nm");
    if (std::any_of(reversals.begin(), reversals.end(), [&](const Reversal& r) {
          return t >= r.from && t <= r.to && torque * r.direction > 0;
        }))
      steps.push_back(m);
  }
  // A friction steps at every reversal: where there are many, two steps are there by chance.
  if (steps.size() < 2 || 2 * steps.size() < reversals.size()) steps.clear();
  return steps;
}

}  // namespace twinrate
