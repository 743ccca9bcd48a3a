#include "trace/fit.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "trace/keys.hpp"
#include "trace/parallel.hpp"
#include "trace/record_contributions.hpp"

namespace twinrate {
namespace {

constexpr const char* kZone = "linear_current_A";

std::vector<FreeParameter> free_parameters(const Members& members) {
  std::vector<FreeParameter> free;
  for (std::size_t m = 0; m < members.size(); ++m) {
    const Effect& effect = *members[m];
    for (int c = 0; c < effect.tracing().regressor_count(); ++c) free.push_back({m, c, ""});
    for (const TracedKey& key : effect.tracing().traced_keys())
      if (key.refine && (effect.tracing().regressor_count() == 0 || !key.linear))
        free.push_back({m, -1, key.key});
  }
  return free;
}

std::vector<double> coefficients_of(const Effect& effect) {
  std::vector<double> c(static_cast<std::size_t>(effect.tracing().regressor_count()));
  effect.tracing().coefficients(c);
  return c;
}

// Returns the change that was possible: a key stays inside its range.
double move(Effect& effect, const FreeParameter& p, double change) {
  if (p.coefficient >= 0) {
    std::vector<double> c = coefficients_of(effect);
    c[static_cast<std::size_t>(p.coefficient)] += change;
    effect.tracing().set_coefficients(c);
    return change;
  }
  const double before = get_key(effect, p.key);
  set_key(effect, p.key, before + change);
  return get_key(effect, p.key) - before;
}

void take_noise(Sampled& x, const Sampled& from) {
  x.noise_d = from.noise_d;
  x.noise_q = from.noise_q;
  x.noise_torque = from.noise_torque;
  x.answer_d = from.answer_d;
  x.answer_q = from.answer_q;
  x.answer_torque = from.answer_torque;
}

// Coefficient that alone makes the smallest size worth reporting.
double smallest_coefficient(const Effect& effect, int coefficient, const DriveFacts& facts) {
  constexpr double kProbe = 1e-3;
  const std::shared_ptr<Effect> one = effect.clone();
  std::vector<double> c(static_cast<std::size_t>(effect.tracing().regressor_count()), 0.0);
  c[static_cast<std::size_t>(coefficient)] = kProbe;
  one->tracing().set_coefficients(c);
  const double sizes = one->tracing().materiality(facts);
  return sizes > 0 && std::isfinite(sizes) ? kProbe / sizes : kProbe;
}

// Places in fit.free of the sizes of member m, and their values: its coefficients, or the keys of
// an effect without coefficients (a lag). Empty for a shaft, whose size is not that of one key.
std::pair<std::vector<Eigen::Index>, std::vector<double>> sizes_of(
    const Fit& fit, const Eigen::MatrixXd& covariance, std::size_t m) {
  std::pair<std::vector<Eigen::Index>, std::vector<double>> sizes;
  const Effect& effect = *fit.members[m];
  const std::vector<double> c = coefficients_of(effect);
  ShaftFacts shaft;
  if (effect.describe_shaft(shaft)) return sizes;
  for (Eigen::Index p = 0; p < covariance.rows(); ++p) {
    const FreeParameter& free = fit.free[static_cast<std::size_t>(p)];
    if (free.member != m || !(covariance(p, p) > 0) || (free.coefficient < 0 && !c.empty()))
      continue;
    sizes.first.push_back(p);
    sizes.second.push_back(c.empty() ? get_key(effect, free.key)
                                     : c[static_cast<std::size_t>(free.coefficient)]);
  }
  return sizes;
}

}  // namespace

Members with(const Members& members, const std::shared_ptr<Effect>& newcomer,
             std::size_t left_out) {
  Members all;
  for (std::size_t m = 0; m < members.size(); ++m)
    if (m != left_out) all.push_back(members[m]->clone());
  if (newcomer) all.push_back(newcomer->clone());
  return all;
}

bool has_shaft(const Members& members) {
  ShaftFacts shaft;
  return std::any_of(members.begin(), members.end(),
                     [&](const auto& m) { return m->describe_shaft(shaft); });
}

bool tells(const Effect& effect, std::size_t coefficient, double energy, const DriveFacts& facts) {
  constexpr double kMostSizes = 10;
  if (effect.tracing().regressor_count() == 0) return true;
  if (!(energy > 0)) return false;
  return 1 / std::sqrt(energy) <
         kMostSizes * smallest_coefficient(effect, static_cast<int>(coefficient), facts);
}

double largest_wald(const Fit& fit, const Eigen::MatrixXd& covariance, std::size_t m) {
  const auto [place, value] = sizes_of(fit, covariance, m);
  double largest = 0;
  for (std::size_t i = 0; i < place.size(); ++i)
    largest = std::max(largest, value[i] * value[i] / covariance(place[i], place[i]));
  return largest;
}

std::optional<double> joint_wald(const Fit& fit, const Eigen::MatrixXd& covariance, std::size_t m) {
  auto [place, value] = sizes_of(fit, covariance, m);
  const auto n = static_cast<Eigen::Index>(place.size());
  if (n == 0) return std::nullopt;
  for (Eigen::Index p = 0; p < covariance.rows(); ++p)  // after the sizes, its other keys
    if (fit.free[static_cast<std::size_t>(p)].member == m && covariance(p, p) > 0 &&
        std::find(place.begin(), place.end(), p) == place.end())
      place.push_back(p);
  const Eigen::MatrixXd own = covariance(place, place);
  const Eigen::VectorXd sigma = own.diagonal().cwiseSqrt();
  constexpr double kRounding = 1e-9;
  Eigen::MatrixXd R = sigma.cwiseInverse().asDiagonal() * own * sigma.cwiseInverse().asDiagonal();
  R.diagonal().array() += kRounding;
  const Eigen::Index keys = R.rows() - n;
  Eigen::MatrixXd sizes = R.topLeftCorner(n, n);
  if (keys > 0)
    sizes -= R.topRightCorner(n, keys) *
             R.bottomRightCorner(keys, keys).ldlt().solve(R.bottomLeftCorner(keys, n));
  const Eigen::VectorXd deviations =
      Eigen::Map<const Eigen::VectorXd>(value.data(), n).cwiseQuotient(sigma.head(n));
  const double wald = deviations.dot(sizes.ldlt().solve(deviations));
  return std::max(0.0, wald - static_cast<double>(n - 1));
}

Fitter::Fitter(const Chain& chain, const Rows& training, const Rows& held_out)
    : chain_(chain), training_(training), held_out_(held_out) {
  const Sampled y = chain.whitened(chain.residual({}));
  declared_ = y;
  noise_ = noise_in(training, y);
  noise_held_out_ = noise_in(held_out, y);
  raw_ = training.energy(y, y).sum();
  raw_held_out_ = held_out.energy(y, y).sum();
}

// Noise of the readings, and the product of the answer with the noise before and after the fit,
// half of each. The derivative of this sum is the share of noise that Rows::against subtracts.
EquationEnergy Fitter::noise_in(const Rows& rows, const Sampled& y) const {
  return rows.noise(y, y) + rows.answer(y, declared_);
}

void Fitter::evaluate(Fit& fit) const {
  fit.y = chain_.whitened(chain_.residual(fit.effects()));
  const auto rss = [&](const Rows& rows, const EquationEnergy& declared, double raw) {
    const double whole = rows.energy(fit.y, fit.y).sum();
    const EquationEnergy brought = noise_in(rows, fit.y) - declared;
    fit.doubt = noise_doubt(brought);
    return left_of(whole - brought.sum() + fit.doubt, raw - whole,
                   static_cast<double>(rows.count(fit.y)));
  };
  fit.rss = rss(training_, noise_, raw_);
  fit.rss_held_out = rss(held_out_, noise_held_out_, raw_held_out_);
  fit.raw_held_out = held_out_.energy(fit.y, fit.y).sum();
  fit.valid = fit.valid && fit.rss > 0 && (fit.rss_held_out > 0 || fit.raw_held_out == 0);
}

void Fitter::linearise(Fit& fit) const {
  // Every key shifts the impacts of a gap in time. So the step is wide enough to span several local
  // extrema of the error instead of the slope of one. Noise crosses the edges of a linear zone, so
  // the step is wide there, too.
  constexpr double kStep = 1e-3, kGapStep = 0.02, kZoneStep = 0.03;
  const DriveFacts& facts = chain_.equations().facts();
  const Effects here = fit.effects();
  const bool senses = !acting_on(here, kOnCurrents | kOnAngle).empty(),
             senses_angle = !acting_on(here, kOnAngle).empty(), commands = chain_.commands(here),
             loaded = chain_.loads_shaft(here);
  // True if the contribution depends on the other members: a sensor's error, an effect that depends
  // on the true current or angle beside it, an effect on the command beside others, a shaft or a
  // load behind it.
  const auto is_bent = [&](const Effect& effect) {
    return effect.acts_on() & (kOnCurrents | kOnAngle) ||
           (senses && effect.acts_on() & (kOnVoltage | kOnFlux)) ||
           (senses_angle && (turns_with_angle(effect) || is_shaft(effect))) ||
           (commands && acts_on_command(effect)) || (loaded && is_of_shaft(effect));
  };
  Sampled residual_here;
  if (std::any_of(fit.free.begin(), fit.free.end(), [&](const FreeParameter& p) {
        return is_bent(*fit.members[p.member]) && !has_gap(*fit.members[p.member]);
      }))
    residual_here = chain_.residual(here);
  const auto columns = [&](const FreeParameter& p) {
    const Effect& effect = *fit.members[p.member];
    const bool bent = is_bent(effect);
    std::vector<Sampled> some;
    if (p.coefficient >= 0 && !bent) {
      if (p.coefficient == 0)
        for (const Sampled& x : *chain_.remembered_columns(effect))
          some.push_back(chain_.regressor(x));
      return some;
    }
    const bool zone = p.key == kZone;
    const double share = has_gap(effect) ? kGapStep : zone ? kZoneStep : kStep;
    const double h = p.coefficient >= 0 ? 0.05 * smallest_coefficient(effect, p.coefficient, facts)
                                        : share * std::max(std::abs(get_key(effect, p.key)), 1e-9);
    const auto up = effect.clone(), down = effect.clone();
    const double step_up = move(*up, p, h);
    up->prepare(facts);
    const auto both_ways = [&] {
      Sampled x;
      const double span = step_up - move(*down, p, -h);
      down->prepare(facts);
      add(x, chain_.contribution_to_fit(*up), 1 / span);
      add(x, chain_.contribution_to_fit(*down), -1 / span);
      return x;
    };
    Sampled x;
    if (bent) {
      // The noise of a coefficient's column, or of a shaft, hardly depends on the other members.
      const bool of_shaft = is_of_shaft(effect), noise_known = p.coefficient >= 0 || of_shaft;
      const auto residual = [&](const std::shared_ptr<Effect>& moved) {
        Effects there = here;
        there[p.member] = moved;
        return noise_known ? chain_.noiseless(there) : chain_.residual(there);
      };
      double span = step_up;
      if (has_gap(effect)) {
        span -= move(*down, p, -h);
        down->prepare(facts);
        add(x, residual(down), 1 / span);
      } else {
        add(x, residual_here, 1 / span);
      }
      add(x, residual(up), -1 / span);
      if (p.coefficient >= 0) {
        const auto c = static_cast<std::size_t>(p.coefficient);
        take_noise(x, (*chain_.remembered_columns(effect))[c]);
      } else if (of_shaft) {
        take_noise(x, has_gap(effect) ? Sampled{} : both_ways());
      }
    } else {
      x = both_ways();
    }
    // The column of a zone as narrow as the noise is mostly noise, and regressor() would make it
    // zero. Its share of noise is subtracted later.
    some.push_back(zone ? chain_.whitened(x) : chain_.regressor(x));
    return some;
  };
  std::vector<std::vector<Sampled>> of_each(fit.free.size());
  for_each_index(of_each.size(), [&](std::size_t p) { of_each[p] = columns(fit.free[p]); });
  fit.J.clear();
  for (std::vector<Sampled>& some : of_each)
    std::move(some.begin(), some.end(), std::back_inserter(fit.J));
}

Eigen::VectorXd Fitter::step(Fit& fit, double& promised) const {
  const auto P = static_cast<Eigen::Index>(fit.J.size());
  NormalEquations normal{Eigen::MatrixXd(P, P), Eigen::VectorXd(P), Eigen::VectorXd(P)};
  for (Eigen::Index a = 0; a < P; ++a) {
    const Sampled& column = fit.J[static_cast<std::size_t>(a)];
    for (Eigen::Index c = 0; c <= a; ++c)
      normal.A(a, c) = normal.A(c, a) = training_.dot(column, fit.J[static_cast<std::size_t>(c)]);
    normal.b[a] = training_.against(column, fit.y);
    normal.noise[a] = training_.noise(column, column).sum();
  }
  std::vector<char> use = normal.usable(static_cast<double>(training_.count(fit.y)));
  for (Eigen::Index a = 0; a < P; ++a) {
    const FreeParameter& p = fit.free[static_cast<std::size_t>(a)];
    if (p.coefficient >= 0 &&
        !tells(*fit.members[p.member], static_cast<std::size_t>(p.coefficient), normal.A(a, a),
               chain_.equations().facts()))
      use[static_cast<std::size_t>(a)] = 0;
  }
  const Eigen::Index spurious = normal.spurious(use);
  if (spurious >= 0 && fit.free[static_cast<std::size_t>(spurious)].coefficient >= 0)
    use[static_cast<std::size_t>(spurious)] = 0;  // keeps its value
  // A moment, or the edge of a zone, keeps its value if the held-out blocks determine it better: it
  // was placed by all blocks.
  std::vector<std::pair<Eigen::Index, double>> placed;
  for (Eigen::Index a = 0; a < P; ++a) {
    const Sampled& x = fit.J[static_cast<std::size_t>(a)];
    const std::string& key = fit.free[static_cast<std::size_t>(a)].key;
    if (key != "time_s" && key != kZone) continue;
    const double kept_back = held_out_.dot(x, x);
    if (kept_back <= normal.A(a, a)) continue;
    placed.emplace_back(a, kept_back + normal.A(a, a));
    use[static_cast<std::size_t>(a)] = 0;
  }
  fit.covariance = normal.inverse(use);
  for (const auto& [a, energy] : placed) fit.covariance(a, a) = 1 / energy;
  const Eigen::VectorXd change = normal.solve(use);
  const Eigen::VectorXd zero = Eigen::VectorXd::Zero(P);
  promised =
      change.dot((change.array() != 0).select(normal.b, zero));  // of a kept value: not finite
  return change;
}

Eigen::MatrixXd Fitter::robust_covariance(const Fit& fit) const {
  constexpr std::size_t kPieces = 48;
  const auto P = static_cast<Eigen::Index>(fit.J.size());
  Eigen::MatrixXd scores = Eigen::MatrixXd::Zero(kPieces, P);
  const std::size_t rows = chain_.equations().record().size();
  const auto gather = [&](const Runs& runs, Eigen::Index p, const Eigen::VectorXd& x,
                          const Eigen::VectorXd& y, double sign) {
    if (!x.size() || !y.size()) return;
    const bool of_torque = &runs == &chain_.sampler().torque();
    for (const auto& [first, count] :
         of_torque ? training_.torque_pieces() : training_.electrical_pieces())
      for (Eigen::Index at = first; at < first + count; ++at) {
        const std::size_t row = runs.row[static_cast<std::size_t>(at)];
        scores(static_cast<Eigen::Index>(kPieces * row / rows), p) += sign * x[at] * y[at];
      }
  };
  const Runs &electrical = chain_.sampler().electrical(), &torque = chain_.sampler().torque();
  for (Eigen::Index p = 0; p < P; ++p) {
    const Sampled& x = fit.J[static_cast<std::size_t>(p)];
    gather(electrical, p, x.d, fit.y.d, 1);
    gather(electrical, p, x.q, fit.y.q, 1);
    gather(torque, p, x.torque, fit.y.torque, 1);
    gather(electrical, p, x.noise_d, fit.y.noise_d, -1);
    gather(electrical, p, x.noise_q, fit.y.noise_q, -1);
    gather(torque, p, x.noise_torque, fit.y.noise_torque, -1);
    gather(electrical, p, x.answer_d, fit.y.noise_d, -1);
    gather(electrical, p, x.answer_q, fit.y.noise_q, -1);
    gather(torque, p, x.answer_torque, fit.y.noise_torque, -1);
  }
  scores.rowwise() -= scores.colwise().mean().eval();
  return fit.covariance * (scores.transpose() * scores) * fit.covariance;
}

Fit Fitter::start(Members members) const {
  Fit fit{.members = std::move(members)};
  fit.free = free_parameters(fit.members);
  evaluate(fit);
  return fit;
}

Fit Fitter::linearised(Members members) const {
  Fit fit = start(std::move(members));
  linearise(fit);
  double promised = 0;
  step(fit, promised);
  return fit;
}

Fit Fitter::refine(Members members, Until until) const {
  const bool all_the_way = until == Until::kArrived;
  const int rounds = all_the_way ? 12 : 3;
  const double least = all_the_way ? 1e-6 : 3e-5;  // share of rss
  constexpr double kFar = 2e-3;                    // after a smaller fall the columns are kept
  Fit fit = start(std::move(members));
  double fall = 1;
  for (int round = 0; round < rounds; ++round) {
    if (fall > kFar) linearise(fit);
    double promised = 0;
    const Eigen::VectorXd change = step(fit, promised);
    if (promised < least * fit.rss) break;
    bool better = false;
    for (double share = 1; share > 0.1; share /= 2) {
      Fit next{.members = with(fit.members, nullptr),
               .free = fit.free,
               .J = fit.J,
               .covariance = fit.covariance};
      for (std::size_t p = 0; p < fit.free.size(); ++p)
        move(*next.members[fit.free[p].member], fit.free[p],
             share * change[static_cast<Eigen::Index>(p)]);
      for (auto& m : next.members)
        if (!m->prepare(chain_.equations().facts()).empty()) next.valid = false;
      if (!next.valid) continue;
      evaluate(next);
      if (next.valid && next.rss < fit.rss) {
        fall = 1 - next.rss / fit.rss;
        better = fall > least;
        fit = std::move(next);
        break;
      }
    }
    if (!better) break;
  }
  for (const auto& m : fit.members) fit.valid = fit.valid && chain_.equations().possible(*m);
  return fit;
}

bool explains_as_much(const Fitter& fitter, const Members& both, const Members& one,
                      const Members& other) {
  constexpr double kNearly = 0.8;
  const Fit neither = fitter.refine(both, Fitter::Until::kArrived),
            first = fitter.refine(one, Fitter::Until::kArrived),
            second = fitter.refine(other, Fitter::Until::kArrived);
  const auto raw = [&](const Fit& fit) { return fitter.training().energy(fit.y, fit.y).sum(); };
  return raw(neither) - raw(second) > kNearly * (raw(neither) - raw(first)) &&
         neither.rss - second.rss > kNearly * (neither.rss - first.rss);
}

}  // namespace twinrate
