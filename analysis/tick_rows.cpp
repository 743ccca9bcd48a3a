#include "analysis/tick_rows.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace twinrate {
namespace {

constexpr std::int64_t kNoTick = std::numeric_limits<std::int64_t>::max();

// Iterates over one channel in tick order.
template <class Item>
struct Cursor {
  const std::vector<Item>& items;
  std::size_t at = 0;

  std::int64_t next_k() const { return at < items.size() ? items[at].k : kNoTick; }
  void give(TickRow& row) {
    for (; next_k() == row.k; ++at) row.take(items[at]);
  }
};

double seconds(std::int64_t t_ns) {
  return static_cast<double>(t_ns) * 1e-9;
}

// The square overflows first: a diverged state is detected before its numbers are infinite.
bool finite(double value) {
  return std::isfinite(value * value);
}
bool finite(const Estimate& e) {
  return finite(e.theta_e) && finite(e.omega_m) && finite(e.T_load) && finite(e.x_hat.norm());
}
bool finite(const Truth& t) {
  return finite(t.i_dq.norm()) && finite(t.omega_m) && finite(t.theta_m);
}

std::optional<TickRow::OfGain> gain_of(const std::vector<GainRecord>& gains,
                                       std::int64_t snapshot) {
  const auto found = std::lower_bound(gains.begin(), gains.end(), snapshot,
                                      [](const GainRecord& g, std::int64_t k) { return g.k < k; });
  if (found == gains.end() || found->k != snapshot) return {};
  return *found;
}

}  // namespace

TickRow::OfGain::OfGain(const Gain& g)
    : k(g.k),
      K41(g.n_x > 3 && g.n_y > 0 ? g.K(3, 0) : 0),
      K42(g.n_x > 3 && g.n_y > 1 ? g.K(3, 1) : 0),
      P44(g.n_x > 3 ? g.P(3, 3) : 0) {}

void TickRow::take(const Measurement& m) {
  if (measurement) return;
  measurement = {m.signals, m.mode, m.i_abc, m.theta_m, m.omega_m};
  t_s = seconds(m.t_ns);
}

void TickRow::take(const Truth& t) {
  if (truth) return;
  truth = {finite(t), t.omega_m, t.theta_m, t.T_em, t.T_load, t.i_dq};
  if (!measurement) t_s = seconds(t.t_ns);
}

void TickRow::take(const Estimate& e) {
  if (estimate) return;
  estimate = {e.gain_seq, e.status, finite(e), e.theta_e, e.omega_m, e.T_load, e.i_dq};
  if (!measurement && !truth) t_s = seconds(e.t_ns);
}

void TickRow::take(const Command& c) {
  if (command) return;
  command = {c.omega_m_ref, c.i_dq_ref};
  if (!measurement && !truth && !estimate) t_s = seconds(c.t_ns);
}

std::vector<TickRow> tick_rows(const RunLog& log) {
  Cursor<Measurement> measurement{log.measurement};
  Cursor<Truth> truth{log.truth};
  Cursor<Estimate> estimate{log.estimate};
  Cursor<Command> command{log.command};
  std::vector<TickRow> rows;
  rows.reserve(std::max(
      {log.measurement.size(), log.truth.size(), log.estimate.size(), log.command.size()}));
  while (true) {
    const std::int64_t k =
        std::min({measurement.next_k(), truth.next_k(), estimate.next_k(), command.next_k()});
    if (k == kNoTick) return rows;
    TickRow& row = rows.emplace_back();
    row.k = k;
    measurement.give(row);
    truth.give(row);
    estimate.give(row);
    command.give(row);
    if (!row.estimate || row.estimate->gain_seq < 0) continue;
    const TickRow* before = rows.size() > 1 ? &row - 1 : nullptr;
    const bool same = before && before->gain && before->gain->k == row.estimate->gain_seq;
    row.gain = same ? before->gain : gain_of(log.gain, row.estimate->gain_seq);
  }
}

}  // namespace twinrate
