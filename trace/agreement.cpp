#include "trace/agreement.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>

#include "model/effects/tracing.hpp"
#include "trace/keys.hpp"
#include "trace/split.hpp"

namespace twinrate {
namespace {

std::vector<double> sizes_of(const Effect& effect) {
  std::vector<double> c(static_cast<std::size_t>(effect.tracing().regressor_count()));
  effect.tracing().coefficients(c);
  return c;
}

// d(explained)/d(coefficient) at the fit, beside all other effects.
std::vector<Sampled> columns_beside(const Chain& chain, const Members& members, std::size_t m,
                                    const Sampled& residual) {
  const Effect& effect = *members[m];
  const bool senses = !acting_on({members.begin(), members.end()}, kOnCurrents | kOnAngle).empty();
  if (!(effect.acts_on() & (kOnCurrents | kOnAngle)) && !senses) return chain.columns(effect);
  constexpr double kStep = 0.05;  // of a coefficient, or of the largest where it is 0
  const std::vector<double> c = sizes_of(effect);
  double largest = 0;
  for (double value : c) largest = std::max(largest, std::abs(value));
  std::vector<Sampled> own = chain.columns(effect);
  for (std::size_t r = 0; r < c.size(); ++r) {
    const double h = kStep * std::max(largest, 1e-9);
    std::vector<double> there = c;
    there[r] -= h;
    Effects moved{members.begin(), members.end()};
    moved[m] = effect.clone();
    std::const_pointer_cast<Effect>(moved[m])->tracing().set_coefficients(there);
    const Sampled changed = chain.noiseless(moved);
    own[r].d = own[r].q = own[r].torque = {};
    if (changed.d.size()) {
      own[r].d = (changed.d - residual.d) / h;
      own[r].q = (changed.q - residual.q) / h;
    }
    if (changed.torque.size()) own[r].torque = (changed.torque - residual.torque) / h;
  }
  return own;
}

// Periods a mechanical turn of the fastest line, 0 if there is none. Above half the rate of a record
// its rows do not hold the line.
double highest_order(const Members& members) {
  double highest = 0;
  for (const auto& member : members) {
    const Traits::Period period = member->tracing().traits().period;
    const bool by_key = period.order_key[0] != 0;
    highest = std::max(highest, by_key ? get_key(*member, period.order_key) : period.order);
  }
  return highest;
}

}  // namespace

PartAnswer best_answer(const PartSums& part, const std::vector<char>& held,
                       const Eigen::VectorXd& given) {
  const Eigen::Index P = part.b.size();
  std::vector<Eigen::Index> free;
  Eigen::VectorXd beta = Eigen::VectorXd::Zero(P);
  for (Eigen::Index p = 0; p < P; ++p)
    if (held[static_cast<std::size_t>(p)])
      beta[p] = given[p];
    else
      free.push_back(p);
  const auto n = static_cast<Eigen::Index>(free.size());
  const Eigen::VectorXd left = part.b - part.A * beta;
  NormalEquations normal{Eigen::MatrixXd(n, n), Eigen::VectorXd(n), Eigen::VectorXd::Zero(n)};
  for (Eigen::Index a = 0; a < n; ++a) {
    for (Eigen::Index b = 0; b < n; ++b) normal.A(a, b) = part.A(free[a], free[b]);
    normal.b[a] = left[free[a]];
  }
  if (n > 0) {
    const Eigen::VectorXd x = normal.solve(normal.usable(part.count));
    for (Eigen::Index a = 0; a < n; ++a) beta[free[a]] = x[a];
  }
  return {beta, part.energy - 2 * beta.dot(part.b) + beta.dot(part.A * beta)};
}

namespace {

bool mostly_noise(const PartSums& part, const std::vector<char>& own) {
  double noise = 0, all = 0;
  for (std::size_t p = 0; p < own.size(); ++p) {
    const auto column = static_cast<Eigen::Index>(p);
    if (own[p]) noise += part.noise[column], all += part.A(column, column);
  }
  return 2 * noise > all;
}

// Information of a part about the claim's coefficients, beside all others (Schur's complement).
Eigen::MatrixXd information(const PartSums& part, const std::vector<char>& own) {
  std::vector<Eigen::Index> mine, others;
  for (std::size_t p = 0; p < own.size(); ++p)
    (own[p] ? mine : others).push_back(static_cast<Eigen::Index>(p));
  const Eigen::MatrixXd across = part.A(others, mine);
  const Eigen::MatrixXd all = part.A(mine, mine);
  if (others.empty()) return all;
  return all - across.transpose() *
                   part.A(others, others).completeOrthogonalDecomposition().solve(across);
}

// Coefficients of `from` in the directions that it knows, and of `on` in the others; none if it knows
// no direction. A direction in which `from` has less than a hundredth of the information of `on` has
// ten times its standard deviation there, and is biased by many of these (seen: the inductance of
// an axis without current, 7 of them).
std::optional<Eigen::VectorXd> known_from(const PartSums& from, const PartSums& on,
                                          const std::vector<char>& own,
                                          const Eigen::VectorXd& there,
                                          const Eigen::VectorXd& here) {
  constexpr double kKnown = 0.01;
  const Eigen::MatrixXd at = information(from, own), of_on = information(on, own);
  const double floor = 1e-12 * of_on.trace();
  if (!(floor > 0)) return std::nullopt;
  const Eigen::GeneralizedSelfAdjointEigenSolver<Eigen::MatrixXd> directions(
      at, of_on + floor * Eigen::MatrixXd::Identity(of_on.rows(), of_on.cols()));
  std::vector<Eigen::Index> index;
  for (std::size_t p = 0; p < own.size(); ++p)
    if (own[p]) index.push_back(static_cast<Eigen::Index>(p));
  const auto n = static_cast<Eigen::Index>(index.size());
  Eigen::VectorXd moved(n);
  for (Eigen::Index a = 0; a < n; ++a) moved[a] = there[index[a]] - here[index[a]];
  Eigen::VectorXd kept = Eigen::VectorXd::Zero(n);
  bool any = false;
  for (Eigen::Index d = 0; d < n; ++d) {
    if (directions.eigenvalues()[d] < kKnown) continue;
    const Eigen::VectorXd v = directions.eigenvectors().col(d);
    kept += v * v.dot(of_on * moved);
    any = true;
  }
  if (!any) return std::nullopt;
  Eigen::VectorXd beta = here;
  for (Eigen::Index a = 0; a < n; ++a) beta[index[a]] += kept[a];
  return beta;
}

}  // namespace

void compare_parts(const PartSums& from, const PartSums& on, const std::vector<char>& own,
                   double least, const char* between, Agreement& out) {
  if (mostly_noise(from, own) || mostly_noise(on, own)) return;
  const std::vector<char> none(own.size(), 0);
  const Eigen::VectorXd zero = Eigen::VectorXd::Zero(on.b.size());
  const PartAnswer there = best_answer(from, none, zero), here = best_answer(on, none, zero),
                   without = best_answer(on, own, zero);
  const std::optional<Eigen::VectorXd> known = known_from(from, on, own, there.beta, here.beta);
  if (!known) return;
  const PartAnswer foreign = best_answer(on, own, *known);
  const PartAnswer from_without = best_answer(from, own, zero);
  const double unit = here.energy / std::max(1.0, on.count),
               unit_from = there.energy / std::max(1.0, from.count);
  const bool moved_from = from_without.energy - there.energy > least * unit_from;
  if (!moved_from) return;
  const double own_gain = without.energy - here.energy,
               foreign_gain = without.energy - foreign.energy;
  // Leaves out a part that the claim does not move, unless the foreign coefficients make it worse.
  if (own_gain <= least * unit && foreign_gain > -least * unit) return;
  ++out.compared;
  const double kept = foreign_gain / std::max(own_gain, least * unit);
  if (kept < out.kept) out.kept = kept, out.between = between;
}

double predicted_ratio(const Eigen::MatrixXd& A, const Eigen::VectorXd& one,
                       const Eigen::VectorXd& other) {
  const Eigen::VectorXd predicts = A * one;
  const double square = predicts.dot(one);
  return square > 0 ? predicts.dot(other) / square : 1;
}

MemberColumns member_columns(const Chain& chain, const Members& members, bool in_sensors) {
  MemberColumns out;
  const Effects all{members.begin(), members.end()};
  const Sampled residual = chain.residual(all);
  const auto whitened = [&](const Sampled& x) {
    return in_sensors ? chain.in_sensors(x) : chain.whitened(x);
  };
  out.declared = whitened(residual);
  std::vector<double> values;
  for (std::size_t m = 0; m < members.size(); ++m) {
    const Effect& effect = *members[m];
    const std::vector<double> c = sizes_of(effect);
    const auto take = [&](const Sampled& column, double value) {
      out.x.push_back(whitened(column));
      out.member.push_back(m);
      values.push_back(value);
      add(out.declared, out.x.back(), value);
    };
    if (c.empty()) {
      Effects others = all;
      others.erase(others.begin() + static_cast<std::ptrdiff_t>(m));
      Sampled change = chain.residual(others);
      add(change, residual, -1);
      take(change, 1);
      continue;
    }
    const std::vector<Sampled> columns = columns_beside(chain, members, m, residual);
    for (std::size_t r = 0; r < c.size(); ++r) take(columns[r], c[r]);
  }
  out.value = Eigen::Map<Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
  return out;
}

PartSums::PartSums(const MemberColumns& columns, const Rows& rows) {
  const auto P = static_cast<Eigen::Index>(columns.x.size());
  A.resize(P, P);
  b.resize(P);
  noise.resize(P);
  for (Eigen::Index a = 0; a < P; ++a) {
    const Sampled& x = columns.x[static_cast<std::size_t>(a)];
    for (Eigen::Index c = 0; c <= a; ++c)
      A(a, c) = A(c, a) = rows.energy(x, columns.x[static_cast<std::size_t>(c)]).sum();
    b[a] = rows.energy(x, columns.declared).sum();
    noise[a] = rows.noise(x, x).sum();
  }
  energy = rows.energy(columns.declared, columns.declared).sum();
  count = static_cast<double>(rows.count(columns.declared));
}

PartSums::PartSums(const Eigen::MatrixXd& x, const Eigen::VectorXd& y)
    : A(x.transpose() * x),
      b(x.transpose() * y),
      noise(Eigen::VectorXd::Zero(x.cols())),
      energy(y.squaredNorm()),
      count(static_cast<double>(y.size())) {}

PartSums PartSums::operator+(const PartSums& other) const {
  PartSums sum = *this;
  sum.A += other.A;
  sum.b += other.b;
  sum.noise += other.noise;
  sum.energy += other.energy;
  sum.count += other.count;
  return sum;
}

Parts::Parts(const Chain& whole, const Members& members, const Chain* half_rate)
    : columns_(member_columns(whole, members, has_shaft(members))) {
  const std::size_t n = whole.equations().record().size();
  const auto part = [&](auto&& in) { return PartSums(columns_, Rows::where(whole.sampler(), in)); };
  for (std::size_t half : {0, 1})
    halves_.push_back(part([=](std::size_t row) { return 2 * row / n == half; }));
  const std::vector<std::size_t> block =
      blocks_of_rows(whole.equations().record(), whole.equations().facts().machine.n_p);
  for (std::size_t odd : {0, 1})
    turns_.push_back(part([&](std::size_t row) { return block[row] % 2 == odd; }));
  if (!half_rate) return;
  // A shaft is simulated from fewer rows there, which the sensors' filter would not forgive.
  const auto whole_sums = [&](const Chain& chain) {
    const double order = highest_order(members);
    const std::vector<OperatingPoint>& points = chain.equations().points();
    const double T_s = chain.equations().record().T_s;
    return PartSums(member_columns(chain, members, false),
                    Rows::where(chain.sampler(), [&](std::size_t row) {
                      return order * std::abs(points[row].omega_m) * T_s < kPi;
                    }));
  };
  rates_ = {has_shaft(members) ? whole_sums(whole) : halves_[0] + halves_[1],
            whole_sums(*half_rate)};
}

Agreement Parts::of(std::size_t member, double sigmas) const {
  std::vector<char> own;
  for (std::size_t m : columns_.member) own.push_back(m == member);
  const double least =
      sigmas * sigmas + static_cast<double>(std::count(own.begin(), own.end(), char{1}));
  Agreement out;
  const auto both_ways = [&](const std::vector<PartSums>& pair, const char* between) {
    compare_parts(pair[0], pair[1], own, least, between, out);
    compare_parts(pair[1], pair[0], own, least, between, out);
  };
  both_ways(halves_, "the two halves");
  both_ways(turns_, "odd and even blocks");
  if (rates_.empty()) return out;
  both_ways(rates_, "the record's rate and half of it");
  const std::vector<char> none(own.size(), 0);
  const Eigen::VectorXd zero = Eigen::VectorXd::Zero(columns_.value.size());
  Eigen::VectorXd at_rate = best_answer(rates_[0], none, zero).beta,
                  at_half = best_answer(rates_[1], none, zero).beta;
  for (Eigen::Index p = 0; p < at_rate.size(); ++p)
    if (!own[static_cast<std::size_t>(p)]) at_rate[p] = at_half[p] = 0;
  out.size_ratio = predicted_ratio(rates_[0].A, at_rate, at_half);
  return out;
}

}  // namespace twinrate
