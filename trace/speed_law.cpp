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

bool is_by_speed(const Effect& effect) {
  const bool constant = is_of(effect, Traits::Family::kLoad) &&
                        effect.tracing().traits().place == Traits::Place::kLinear;
  return is_of(effect, Traits::Family::kFriction) || constant;
}

// Least squares of a target by fixed columns and one that is tried, noise included.
class Squares {
 public:
  Squares(const Rows& rows, Sampled target, std::vector<Sampled> columns)
      : rows_(rows), target_(std::move(target)), columns_(std::move(columns)) {
    const auto n = static_cast<Eigen::Index>(columns_.size());
    normal_ = {Eigen::MatrixXd(n + 1, n + 1), Eigen::VectorXd(n + 1), Eigen::VectorXd::Zero(n + 1)};
    all_ = product(target_, target_);
    for (Eigen::Index i = 0; i < n; ++i) place(i, columns_[static_cast<std::size_t>(i)]);
  }
  // The energy that is left with the tried column.
  double left_with(const Sampled& tried) {
    place(normal_.b.size() - 1, tried);
    const auto& [A, b, noise] = normal_;
    const Eigen::VectorXd x = normal_.solve(normal_.usable(1));
    return all_ - 2 * b.dot(x) + x.dot(A * x);
  }

 private:
  void place(Eigen::Index i, const Sampled& column) {
    normal_.b[i] = product(column, target_);
    normal_.A(i, i) = product(column, column);
    for (Eigen::Index j = 0; j < i; ++j)
      normal_.A(i, j) = normal_.A(j, i) = product(column, columns_[static_cast<std::size_t>(j)]);
  }
  double product(const Sampled& a, const Sampled& b) const {
    const EquationEnergy e = rows_.energy(a, b);
    return e.electrical + e.torque;
  }
  const Rows& rows_;
  Sampled target_;
  std::vector<Sampled> columns_;
  NormalEquations normal_;
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
  const auto left_by = [&](double p) { return squares.left_with(powers(p)); };
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
  std::vector<Sampled> columns;
  for (std::size_t i = 0; i < fit.free.size(); ++i)
    if (!is_replaced(fit.free[i].member)) columns.push_back(fit.J[i]);
  return {{fitter.training(), std::move(target), std::move(columns)}, parameters};
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

}  // namespace twinrate
