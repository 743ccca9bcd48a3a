#include "trace/holding_gate.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "model/effects/catalogue.hpp"
#include "trace/holding_fit.hpp"
#include "trace/point_gate.hpp"
#include "trace/position_effects.hpp"
#include "trace/statistics.hpp"

namespace twinrate {
namespace {

using Eigen::Index;

constexpr std::size_t kPieces = 24;  // of the judging means of a sweep
constexpr std::size_t kBlocks = 12;  // of a sweep: odd and even ones should agree

struct Mean {
  Index row = 0;  // of the sweep's sums
  double at = 0;  // middle row in the log
  bool judges = false;
};

// The means of one sweep, in the order of its rows.
struct Sweep {
  const PositionLog* log = nullptr;
  std::vector<int> direction;
  std::size_t length = 1;
  Eigen::MatrixXd X;
  Eigen::VectorXd y;
  std::vector<Mean> means;
  bool seen = false;  // by the fit
  double noise = 1;   // A, rms of the residual with the fitted sizes; its inverse is the weight

  bool both_ways() const {
    const auto up = std::count(direction.begin(), direction.end(), 1);
    const auto all = static_cast<std::ptrdiff_t>(direction.size());
    return 10 * std::min(up, all - up) > all;
  }
};

// Coefficients of the fitted sizes and phases, A.
Eigen::VectorXd found_sizes(const HoldingTorque& holding, double K_t) {
  std::vector<double> x;
  for (const std::vector<Harmonic>* list : {&holding.cogging, &holding.friction_ripple})
    for (const Harmonic& h : *list) {
      x.push_back(h.amplitude * std::cos(h.phase) / K_t);
      x.push_back(h.amplitude * std::sin(h.phase) / K_t);
    }
  if (holding.T_C != 0) x.push_back(holding.T_C / K_t);
  return Eigen::Map<Eigen::VectorXd>(x.data(), static_cast<Index>(x.size()));
}

Sweep sweep_of(const PositionLog& log, const Terms& terms, const Eigen::VectorXd& sizes) {
  Sweep s{.log = &log,
          .direction = directions(log),
          .length = judged_length(log),
          .X = Eigen::MatrixXd(0, terms.columns()),
          .y = {},
          .means = {}};
  for (const bool judges : {false, true}) {
    const Prepared part{
        .log = &log, .direction = s.direction, .ok = holding_rows(log, 5 * terms.lag, judges)};
    if (std::find(part.ok.begin(), part.ok.end(), 1) == part.ok.end()) continue;
    const Blocks b = blocks_of(part, terms, s.length);
    const Index first = s.y.size();
    s.X.conservativeResize(first + b.y.size(), Eigen::NoChange);
    s.y.conservativeResize(first + b.y.size());
    s.X.bottomRows(b.y.size()) = b.X;
    s.y.tail(b.y.size()) = b.y;
    for (Index k = 0; k < b.y.size(); ++k) s.means.push_back({first + k, b.row[k], judges});
    s.seen = s.seen || (!judges && b.y.size() > 0);
  }
  std::sort(s.means.begin(), s.means.end(), [](auto& a, auto& b) { return a.at < b.at; });
  if (s.y.size() == 0) return s;
  if (!s.seen) {  // it has an offset of its own
    s.X.rowwise() -= s.X.colwise().mean().eval();
    s.y.array() -= s.y.mean();
  }
  const Eigen::VectorXd rest = s.y - s.X * sizes;
  s.noise = std::max(std::sqrt((rest.array() - rest.mean()).square().mean()), 1e-9);
  s.X /= s.noise;
  s.y /= s.noise;
  return s;
}

Terms terms_of(const HoldingTorque& holding) {
  Terms terms{.friction = holding.T_C != 0, .lag = holding.lag};
  for (const Harmonic& h : holding.cogging) terms.orders.push_back(h.order);
  for (const Harmonic& h : holding.friction_ripple) terms.ripple_orders.push_back(h.order);
  return terms;
}

void add_sweep(const Sweep& s, int file, Index offset, PointRows& rows) {
  const auto first = static_cast<Index>(rows.size());
  const double size = static_cast<double>(s.log->size());
  const auto judging = static_cast<std::size_t>(
      std::count_if(s.means.begin(), s.means.end(), [](auto& m) { return m.judges; }));
  std::size_t judged = 0;
  const bool both_ways = s.both_ways();
  for (std::size_t k = 0; k < s.means.size(); ++k) {
    const Mean& mean = s.means[k];
    const auto row = first + static_cast<Index>(k);
    rows.y[row] = s.y[mean.row];
    rows.x.row(row).head(s.X.cols()) = s.X.row(mean.row);
    if (s.seen) rows.x(row, offset) = 1 / s.noise;
    rows.judges.push_back(mean.judges);
    rows.file.push_back(file);
    rows.channel.push_back(0);
    rows.piece.push_back(mean.judges ? judged++ * std::min(kPieces, judging) / judging : 0);
    const bool beside =
        k + 1 < s.means.size() && s.means[k + 1].at - mean.at < 1.5 * static_cast<double>(s.length);
    rows.next.push_back(beside ? row + 1 : -1);
    const auto block = static_cast<std::size_t>(static_cast<double>(kBlocks) * mean.at / size);
    rows.parts[0].part.push_back(s.seen ? 2 * mean.at > size : -1);
    rows.parts[1].part.push_back(s.seen ? block % 2 == 1 : -1);
    rows.parts[2].part.push_back(
        s.seen && both_ways ? s.direction[static_cast<std::size_t>(mean.at)] > 0 : -1);
  }
}

PointRows rows_of(const Logs& logs, const Terms& terms, const Eigen::VectorXd& sizes) {
  std::vector<Sweep> sweeps;
  for (const PositionLog* log : logs) sweeps.push_back(sweep_of(*log, terms, sizes));
  Index count = 0;
  for (const Sweep& s : sweeps) count += s.y.size();
  const bool own_offsets =
      !terms.friction ||
      std::any_of(sweeps.begin(), sweeps.end(), [](auto& s) { return s.seen && s.both_ways(); });
  const auto offsets = own_offsets ? static_cast<Index>(sweeps.size()) : 1;
  PointRows rows{.y = Eigen::VectorXd::Zero(count),
                 .x = Eigen::MatrixXd::Zero(count, terms.columns() + offsets),
                 .judges = {},
                 .file = {},
                 .channel = {},
                 .piece = {},
                 .next = {},
                 .parts = {{"the two halves of the sweep", {}},
                           {"odd and even pieces", {}},
                           {"the two directions", {}}},
                 .files = {},
                 .channels = {"i_q"}};
  for (std::size_t f = 0; f < sweeps.size(); ++f) {
    const Index offset = terms.columns() + (own_offsets ? static_cast<Index>(f) : 0);
    rows.files.push_back(sweeps[f].log->path);
    add_sweep(sweeps[f], static_cast<int>(f), offset, rows);
  }
  return rows;
}

std::vector<PointClaim> claims_of(const Terms& terms) {
  std::vector<PointClaim> claims;
  Index column = 0;
  const auto add = [&](const char* kind, Index columns) {
    PointClaim claim{.kind = kind, .columns = {}, .size = 1};
    for (Index c = 0; c < columns; ++c) claim.columns.push_back(column++);
    claims.push_back(std::move(claim));
  };
  for (std::size_t k = 0; k < terms.orders.size(); ++k) add(kOrderOfTorque, 2);
  for (std::size_t k = 0; k < terms.ripple_orders.size(); ++k) add(kOrderOfFriction, 2);
  if (terms.friction) add(kMeanFriction, 1);
  return claims;
}

// Removes claim `m`; returns its order, or 0 for a claim without one.
int drop(HoldingTorque& holding, std::size_t m) {
  for (std::vector<Harmonic>* list : {&holding.cogging, &holding.friction_ripple}) {
    if (m < list->size()) {
      const int order = (*list)[m].order;
      list->erase(list->begin() + static_cast<std::ptrdiff_t>(m));
      return order;
    }
    m -= list->size();
  }
  holding.T_C = 0;
  return 0;
}

void refuse(Found& found, std::size_t m, Refused why, TraceResult& r) {
  if (const int order = drop(found.holding, m); order > 0)
    why.text = fmt::format("order {}: {}", order, why.text);
  r.refused.push_back(std::move(why));
}

// Sizes and phases of the remaining claims, fitted without the refused ones.
void take_sizes(const PointAnswer& answer, double K_t, HoldingTorque& holding) {
  Index column = 0;
  for (std::vector<Harmonic>* list : {&holding.cogging, &holding.friction_ripple})
    for (Harmonic& h : *list) {
      const double a = answer.beta[column], b = answer.beta[column + 1];
      h.amplitude = K_t * std::hypot(a, b);
      h.phase = std::atan2(b, a);
      column += 2;
    }
  if (holding.T_C != 0) holding.T_C = K_t * answer.beta[column];
}

}  // namespace

namespace {

// Refuses claim by claim, until all remaining ones pass.
void refuse_sines(const Logs& logs, const TraceHooks& hooks, Found& found, TraceResult& r) {
  bool dropped = false;
  while (true) {
    const Terms terms = terms_of(found.holding);
    const std::vector<PointClaim> claims = claims_of(terms);
    if (claims.empty() || hooks.stopped()) return;
    const double K_t = found.machine.torque_constant();
    const PointAnswer answer = ask(rows_of(logs, terms, found_sizes(found.holding, K_t)), claims);
    if (!answer.refused) {
      if (dropped) take_sizes(answer, K_t, found.holding);
      return;
    }
    dropped = true;
    if (answer.refused->rule != "whole") {
      refuse(found, answer.weakest, *answer.refused, r);
      continue;
    }
    for (std::size_t m = claims.size(); m-- > 0;) {
      Refused why = *answer.refused;
      why.kind = claims[m].kind;
      refuse(found, m, why, r);
    }
  }
}

// True if the filter of the current lowers the error of the judging rows beyond chance.
bool keeps_lag(const Found& found, const Judge& judge) {
  const Criterion criterion;
  if (found.holding.cogging.empty() && found.holding.friction_ripple.empty()) return false;
  HoldingTorque without = found.holding;
  without.lag = 0;
  MotionModel less = found.model();
  less.holding = &without;
  const std::vector<double> votes = judge.votes(found, found.model(), less, criterion.silent);
  return signed_rank_tail(votes) < criterion.chance;
}

// The speed around the row of each mean, in the order of the means; empty for a map.
std::vector<double> speeds(const Sweep& s) {
  const PositionLog& log = *s.log;
  std::vector<double> speeds;
  if (!log.has_time()) return speeds;
  for (const Mean& mean : s.means) {
    const auto at = static_cast<std::size_t>(mean.at);
    const std::size_t first = at - std::min(at, s.length),
                      last = std::min(at + s.length, log.size() - 1);
    const double over_s = log.t[last] - log.t[first];  // 0: stamps of one time
    speeds.push_back(over_s > 0 ? std::abs(log.theta_m[last] - log.theta_m[first]) / over_s : 0);
  }
  return speeds;
}

// Fits a torque in proportion to the speed beside the friction, to the moving rows that do not
// judge: at standstill the current may have any value within the friction.
FrictionSlope friction_slope(const Logs& logs, const Terms& terms, const Eigen::VectorXd& sizes) {
  constexpr double kStill = 0.1;  // of the fastest row
  const PointRows rows = rows_of(logs, terms, sizes);
  std::vector<double> speed;
  for (const PositionLog* log : logs) {
    const std::vector<double> own = speeds(sweep_of(*log, terms, sizes));
    if (own.empty()) return {};
    speed.insert(speed.end(), own.begin(), own.end());
  }
  double fastest = 0;
  for (std::size_t k = 0; k < rows.size(); ++k)
    if (!rows.judges[k]) fastest = std::max(fastest, speed[k]);
  const auto is_used = [&](std::size_t k) {
    return !rows.judges[k] && speed[k] > kStill * fastest;
  };
  const Index n = rows.x.cols(), friction = terms.columns() - 1;
  Eigen::MatrixXd x(rows.x.rows(), n + 1);
  x << rows.x, Eigen::VectorXd::Zero(rows.x.rows());
  for (std::size_t k = 0; k < rows.size(); ++k) {
    const auto row = static_cast<Index>(k);
    x(row, n) = speed[k] * x(row, friction);
    if (!is_used(k)) x.row(row).setZero();
  }
  Eigen::MatrixXd normal = x.transpose() * x;
  normal.diagonal() *= 1 + 1e-9;
  const Eigen::LDLT<Eigen::MatrixXd> factor(normal);
  const Eigen::VectorXd beta = factor.solve(x.transpose() * rows.y),
                        inverse = factor.solve(Eigen::VectorXd::Unit(n + 1, n)),
                        rest = rows.y - x * beta;
  double squares = 0, beside = 0, count = 0;
  for (std::size_t k = 0; k < rows.size(); ++k) {
    if (!is_used(k)) continue;
    const double r = rest[static_cast<Index>(k)];
    squares += r * r;
    count += 1;
    if (const Index next = rows.next[k]; next >= 0 && is_used(static_cast<std::size_t>(next)))
      beside += r * rest[next];
  }
  const double r = std::clamp(beside / squares, 0.0, 0.98);
  const double over = fastest / std::abs(beta[friction]);
  return {.change = std::copysign(over, beta[friction]) * beta[n],
          .sigma = over * std::sqrt(squares / count * inverse[n] * (1 + r) / (1 - r))};
}

void measure_friction_slope(const Logs& logs, Found& found) {
  found.friction_slope = {};
  if (found.holding.T_C == 0) return;
  found.friction_slope = friction_slope(
      logs, terms_of(found.holding), found_sizes(found.holding, found.machine.torque_constant()));
}

bool tells_friction(const Found& found) {
  const std::vector<PositionClaim>& claims = position_claims();
  const auto own =
      std::find_if(claims.begin(), claims.end(), [](auto& c) { return c.kind == kMeanFriction; });
  return own != claims.end() && own->told(found);
}

}  // namespace

void refuse_orders(Found& found, const Judge& judge, const TraceHooks& hooks, TraceResult& r) {
  if (judge.by_speed() || !judge.unseen()) return;
  Logs logs = found.at_rest;
  for (const PositionLog* log : judge.logs())
    if (log->held_out) logs.push_back(log);
  if (!tells_friction(found)) found.holding.T_C = 0;
  refuse_sines(logs, hooks, found, r);
  measure_friction_slope(logs, found);
  if (found.holding.lag <= 0 || hooks.stopped() || keeps_lag(found, judge)) return;
  r.refused.push_back({.kind = std::string(make_of(Traits::Family::kLag)->kind()),
                       .rule = "transfer",
                       .number = found.holding.lag,
                       .text = "a filter of the current: the held-out rows do not show it"});
  found.holding.lag = found.holding.sigma_lag = found.holding.lag_share = 0;
  found.lag_is_of_current = false;
  refuse_sines(logs, hooks, found, r);
  measure_friction_slope(logs, found);
}

}  // namespace twinrate
