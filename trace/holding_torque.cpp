#include "trace/holding_torque.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "model/frames.hpp"
#include "trace/holding_fit.hpp"

namespace twinrate {
namespace {

using Eigen::Index;

constexpr double kStandsOut = 4;  // times the noise of the orders around it

double cost_with_lag(std::vector<Prepared>& logs, Terms terms, std::size_t offsets, double lag,
                     const TraceHooks& hooks) {
  terms.lag = lag;
  return solve(logs, terms, offsets, hooks).cost;
}

double amplitude(const Solution& s, std::size_t i) {
  return std::hypot(s.x[static_cast<Index>(2 * i)], s.x[static_cast<Index>(2 * i + 1)]);
}

// Noise of an amplitude, from the orders around it: at least half of them hold noise alone.
std::vector<double> floors(const Solution& s, std::size_t count) {
  std::vector<double> floor(count);
  for (std::size_t i = 0; i < count; ++i) {
    std::vector<double> around;
    const std::size_t a = i >= 20 ? i - 20 : 0, b = std::min(count, i + 21);
    for (std::size_t j = a; j < b; ++j) around.push_back(amplitude(s, j));
    std::nth_element(around.begin(),
                     around.begin() + static_cast<std::ptrdiff_t>(around.size() / 2), around.end());
    floor[i] = around[around.size() / 2] / 1.177;  // median of a Rayleigh amplitude
  }
  return floor;
}

struct Standing {
  std::vector<int> orders;
  std::vector<double> over_floor;
};

Standing orders_that_stand_out(const Solution& s, const std::vector<int>& orders) {
  Standing standing;
  const std::vector<double> floor = floors(s, orders.size());
  for (std::size_t i = 0; i < orders.size(); ++i) {
    const double over = amplitude(s, i) / std::max(floor[i], 1e-12);
    const double sigma = std::max(s.sigma[static_cast<Index>(2 * i)], 1e-15);
    if (over < kStandsOut || amplitude(s, i) < 3 * sigma) continue;
    standing.orders.push_back(orders[i]);
    standing.over_floor.push_back(over);
  }
  return standing;
}

Harmonic harmonic(const Solution& s, std::size_t i, int order, double over, double K_t) {
  const double a = s.x[static_cast<Index>(2 * i)], b = s.x[static_cast<Index>(2 * i + 1)];
  const double sigma =
      K_t * 0.5 * (s.sigma[static_cast<Index>(2 * i)] + s.sigma[static_cast<Index>(2 * i + 1)]);
  const double size = K_t * std::hypot(a, b);
  return {.order = order,
          .amplitude = size,
          .phase = std::atan2(b, a),
          .sigma_amplitude = sigma,
          .sigma_phase = sigma / std::max(size, 1e-15),
          .over_floor = over};
}

// Only one in a hundred time steps is longer: no shorter lag is visible.
double widest_step(const PositionLog& log) {
  std::vector<double> steps;
  for (std::size_t k = 1; k < log.t.size(); ++k) steps.push_back(log.t[k] - log.t[k - 1]);
  const auto last = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() * 99 / 100);
  std::nth_element(steps.begin(), last, steps.end());
  return *last;
}

// Finds the lag, if the logs show one: it removes a tenth or more of the squared residual.
void find_lag(std::vector<Prepared>& logs, Terms& terms, std::size_t offsets,
              const TraceHooks& hooks, HoldingTorque& torque) {
  double shortest = 0, longest = 0;
  for (const Prepared& p : logs)
    if (p.log->has_time()) {
      shortest = std::max(shortest, widest_step(*p.log));
      longest = std::max(longest, 0.1 * (p.log->t.back() - p.log->t.front()));
    }
  if (longest <= 0 || terms.orders.empty()) return;
  for (Prepared& p : logs) p.noise = 1;
  solve(logs, terms, offsets, hooks);  // the noise of each log, without the lag
  std::vector<Prepared> fixed = logs;
  const auto cost = [&](double lag) {
    std::vector<Prepared> scratch = fixed;
    return cost_with_lag(scratch, terms, offsets, lag, hooks);
  };
  double best = 0, best_cost = cost(0);
  const double none = best_cost;
  for (double lag = shortest; lag < std::min(longest, 2.0); lag *= 1.6) {
    const double now = cost(lag);
    if (now < best_cost) best = lag, best_cost = now;
  }
  if (best == 0 || best_cost > 0.9 * none) return;
  double a = best / 1.6, b = best * 1.6;
  for (int i = 0; i < 14; ++i) {
    const double x1 = a + 0.382 * (b - a), x2 = a + 0.618 * (b - a);
    if (cost(x1) < cost(x2))
      b = x2;
    else
      a = x1;
  }
  terms.lag = torque.lag = 0.5 * (a + b);
  best_cost = cost(terms.lag);
  torque.lag_share = 1 - best_cost / none;
  // Curvature of the cost in units of its own noise.
  const double step = 0.05 * terms.lag;
  const double curvature =
      (cost(terms.lag + step) - 2 * best_cost + cost(terms.lag - step)) / (step * step);
  double rows = 0, spread = 1;
  for (const Prepared& p : fixed) {
    const auto blocks = p.log->size() / block_length(*p.log);
    rows += static_cast<double>(blocks);
    spread = std::max(spread, p.spread);
  }
  if (curvature > 0) torque.sigma_lag = std::sqrt(2 * best_cost * spread / (rows * curvature));
}

struct Ways {
  bool log_with_both = false, both = false;
};

Ways ways(const std::vector<Prepared>& logs) {
  Ways w;
  std::size_t up_all = 0, down_all = 0;
  for (const Prepared& p : logs) {
    const auto up = static_cast<std::size_t>(std::count(p.direction.begin(), p.direction.end(), 1));
    const std::size_t down = p.direction.size() - up;
    w.log_with_both = w.log_with_both || 10 * std::min(up, down) > up + down;
    up_all += up;
    down_all += down;
  }
  w.both = w.log_with_both || 20 * std::min(up_all, down_all) > up_all + down_all;
  return w;
}

// Finds orders among those of the cogging, and up to 2 n_p, whose part that changes sign with the
// direction is an eighth of the largest cogging or more.
void find_friction_ripple(std::vector<Prepared>& logs, Terms& terms, std::size_t offsets, int n_p,
                          const TraceHooks& hooks) {
  Terms wide = terms;
  for (int order = 1; order <= 2 * n_p; ++order) wide.ripple_orders.push_back(order);
  const Solution s = solve_weighed(logs, wide, offsets, hooks);
  double largest = 0;
  for (std::size_t i = 0; i < wide.orders.size(); ++i) largest = std::max(largest, amplitude(s, i));
  for (std::size_t j = 0; j < wide.ripple_orders.size(); ++j) {
    const std::size_t i = wide.orders.size() + j;
    const double size = amplitude(s, i);
    if (size > 0.125 * largest && size > 5 * s.sigma[static_cast<Index>(2 * i)])
      terms.ripple_orders.push_back(wide.ripple_orders[j]);
  }
}

// Drops orders that fail the criterion A^2/sigma^2 > 2 log(N). True if an order was dropped.
bool drop_small(Terms& terms, std::vector<double>& over_floor, const Solution& s) {
  const double needed = std::sqrt(2 * std::log(static_cast<double>(s.rows)));
  Terms kept = terms;
  std::vector<double> kept_over;
  kept.orders.clear();
  for (std::size_t i = 0; i < terms.orders.size(); ++i)
    if (amplitude(s, i) > needed * s.sigma[static_cast<Index>(2 * i)]) {
      kept.orders.push_back(terms.orders[i]);
      kept_over.push_back(over_floor[i]);
    }
  const bool dropped = kept.orders.size() < terms.orders.size();
  terms = std::move(kept);
  over_floor = std::move(kept_over);
  return dropped;
}

}  // namespace

int largest_order(const MachineParameters& machine, std::size_t rows) {
  const int native =
      machine.n_slots > 0 ? std::lcm(machine.n_slots, 2 * machine.n_p) : 8 * machine.n_p;
  return std::clamp(3 * native, 6, std::max(6, std::min(400, static_cast<int>(rows / 6))));
}

HoldingTorque trace_holding_torque(std::span<const PositionLog* const> given,
                                   const MachineParameters& machine, const TraceHooks& hooks) {
  HoldingTorque torque;
  std::vector<Prepared> logs;
  std::size_t rows = 0;
  for (const PositionLog* log : given) {
    logs.push_back(
        {.log = log, .direction = directions(*log), .ok = holding_rows(*log, 0, log->held_out)});
    rows += std::min(log->size(), kMostBlocks);
  }
  if (logs.empty()) return torque;
  const Ways w = ways(logs);
  torque.both_directions = w.both;
  const bool one_offset = w.both && !w.log_with_both;
  const std::size_t offsets = one_offset ? 1 : logs.size();
  for (std::size_t i = 0; i < logs.size(); ++i) logs[i].offset = one_offset ? 0 : i;

  Terms all{.friction = w.both};
  for (int order = 1; order <= largest_order(machine, rows); ++order) all.orders.push_back(order);
  Terms terms{.friction = w.both};
  terms.orders = orders_that_stand_out(solve_weighed(logs, all, offsets, hooks), all.orders).orders;
  find_lag(logs, terms, offsets, hooks, torque);
  if (torque.lag > 0)  // rows within the after-effect of a jump do not count
    for (Prepared& p : logs) p.ok = holding_rows(*p.log, 5 * torque.lag, p.log->held_out);
  all.lag = torque.lag;
  Standing standing = orders_that_stand_out(solve_weighed(logs, all, offsets, hooks), all.orders);
  terms.orders = standing.orders;
  if (w.both) find_friction_ripple(logs, terms, offsets, machine.n_p, hooks);
  Solution s = solve_weighed(logs, terms, offsets, hooks);
  if (drop_small(terms, standing.over_floor, s)) s = solve_weighed(logs, terms, offsets, hooks);

  const double K_t = machine.torque_constant();
  for (std::size_t i = 0; i < terms.orders.size(); ++i)
    torque.cogging.push_back(harmonic(s, i, terms.orders[i], standing.over_floor[i], K_t));
  for (std::size_t i = 0; i < terms.ripple_orders.size(); ++i)
    torque.friction_ripple.push_back(
        harmonic(s, terms.orders.size() + i, terms.ripple_orders[i], 0, K_t));
  const auto larger = [](const Harmonic& a, const Harmonic& b) {
    return a.amplitude > b.amplitude;
  };
  std::sort(torque.cogging.begin(), torque.cogging.end(), larger);
  std::sort(torque.friction_ripple.begin(), torque.friction_ripple.end(), larger);
  if (w.both) {
    torque.T_C = K_t * s.x[terms.columns() - 1];
    torque.sigma_T_C = K_t * s.sigma[terms.columns() - 1];
  }
  torque.rest = s.rest;
  torque.variation = s.variation;
  torque.rows = s.rows;
  return torque;
}

std::vector<double> holding_current(const PositionLog& log, const HoldingTorque& torque,
                                    const MachineParameters& machine) {
  const std::vector<int> direction = directions(log);
  std::vector<double> i_q(log.size(), 0);
  const double K_t = machine.torque_constant();
  for (std::size_t k = 0; k < log.size(); ++k) {
    double T = torque.T_C * direction[k];
    for (const Harmonic& h : torque.cogging)
      T += h.amplitude * std::sin(h.order * log.theta_m[k] + h.phase);
    for (const Harmonic& h : torque.friction_ripple)
      T += direction[k] * h.amplitude * std::sin(h.order * log.theta_m[k] + h.phase);
    i_q[k] = T / K_t;
  }
  return log.has_time() ? low_pass(log.t, i_q, torque.lag) : i_q;
}

}  // namespace twinrate
