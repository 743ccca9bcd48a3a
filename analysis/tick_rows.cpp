#include "analysis/tick_rows.hpp"

#include <algorithm>
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
  const Item* take(std::int64_t k) {
    const Item* found = nullptr;
    for (; at < items.size() && items[at].k == k; ++at)
      if (!found) found = &items[at];
    return found;
  }
};

template <class Item>
void take_time(TickRow& row, const Item* item) {
  if (item) row.t_s = static_cast<double>(item->t_ns) * 1e-9;
}

const GainRecord* gain_of(const std::vector<GainRecord>& gains, std::int64_t snapshot) {
  const auto found = std::lower_bound(gains.begin(), gains.end(), snapshot,
                                      [](const GainRecord& g, std::int64_t k) { return g.k < k; });
  return found != gains.end() && found->k == snapshot ? &*found : nullptr;
}

}  // namespace

std::vector<TickRow> tick_rows(const RunLog& log) {
  Cursor<Measurement> measurement{log.measurement};
  Cursor<Truth> truth{log.truth};
  Cursor<Estimate> estimate{log.estimate};
  Cursor<Command> command{log.command};
  std::vector<TickRow> rows;
  rows.reserve(std::max(
      {log.measurement.size(), log.truth.size(), log.estimate.size(), log.command.size()}));
  while (true) {
    TickRow row;
    row.k = std::min({measurement.next_k(), truth.next_k(), estimate.next_k(), command.next_k()});
    if (row.k == kNoTick) return rows;
    row.measurement = measurement.take(row.k);
    row.truth = truth.take(row.k);
    row.estimate = estimate.take(row.k);
    row.command = command.take(row.k);
    take_time(row, row.command);
    take_time(row, row.estimate);
    take_time(row, row.truth);
    take_time(row, row.measurement);
    if (row.estimate && row.estimate->gain_seq >= 0) {
      const bool same =
          !rows.empty() && rows.back().gain && rows.back().gain->k == row.estimate->gain_seq;
      row.gain = same ? rows.back().gain : gain_of(log.gain, row.estimate->gain_seq);
    }
    rows.push_back(row);
  }
}

}  // namespace twinrate
