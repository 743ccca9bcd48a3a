#include "scope/tick_store.hpp"

#include <algorithm>
#include <cmath>

namespace twinrate::scope {

void Extent::add(double value) {
  min = std::min(min, value);
  max = std::max(max, value);
  sum += value;
  sum_of_squares += value * value;
  ++count;
}

void Extent::add(const Extent& other) {
  min = std::min(min, other.min);
  max = std::max(max, other.max);
  sum += other.sum;
  sum_of_squares += other.sum_of_squares;
  count += other.count;
}

const TickStore::Column* TickStore::find(int column, std::int64_t chunk) const {
  const auto found = chunks_.find(chunk);
  const auto place = static_cast<std::size_t>(column);
  if (found == chunks_.end() || place >= found->second->columns.size()) return nullptr;
  return found->second->columns[place].get();
}

TickStore::Column& TickStore::make(int column, bool dense, std::int64_t chunk) {
  if (chunk != written_) {
    writing_ = chunks_[chunk];
    if (!writing_) writing_ = chunks_[chunk] = std::make_shared<Chunk>();
    written_ = chunk;
  }
  Chunk* slot = writing_.get();
  const auto place = static_cast<std::size_t>(column);
  if (place >= slot->columns.size()) slot->columns.resize(place + 1);
  auto& made = slot->columns[place];
  if (!made) {
    made = std::make_unique<Column>();
    if (dense) {
      made->values.assign(kChunkTicks, kNoValue);
      made->blocks.resize(kChunkTicks / kBlockTicks);
    }
  }
  return *made;
}

void TickStore::drop_oldest() {
  chunks_.erase(chunks_.begin());
  ++dropped_chunks_;
  first_k_ = std::max(first_k_, chunks_.begin()->first * kChunkTicks);
}

void TickStore::set(int column, bool dense, std::int64_t k, double value) {
  if (k < 0 || !std::isfinite(value)) return;
  const std::int64_t chunk = k / kChunkTicks;
  if (!chunks_.empty() && chunks_.size() >= max_chunks_ && chunk < chunks_.begin()->first) return;
  Column& target = make(column, dense, chunk);
  const auto tick = static_cast<std::uint16_t>(k % kChunkTicks);
  if (!target.blocks.empty())
    set_dense(target, tick, value);
  else
    set_sparse(target, tick, value);
  if (first_k_ < 0 || k < first_k_) first_k_ = k;
  last_k_ = std::max(last_k_, k);
  if (chunks_.size() > max_chunks_) drop_oldest();
}

// A repeated message has the same value. Another value is rare; then the block is computed anew.
void TickStore::set_dense(Column& column, std::size_t tick, double value) {
  double& place = column.values[tick];
  if (place == value) return;
  const bool again = !std::isnan(place);
  place = value;
  Extent& block = column.blocks[tick / kBlockTicks];
  if (!again) {
    block.add(value);
    return;
  }
  block = Extent{};
  const std::size_t first = tick - tick % kBlockTicks;
  for (std::size_t i = first; i < first + kBlockTicks; ++i)
    if (!std::isnan(column.values[i])) block.add(column.values[i]);
}

void TickStore::set_sparse(Column& column, std::uint16_t tick, double value) {
  const auto at = std::lower_bound(column.ticks.begin(), column.ticks.end(), tick);
  const auto place = at - column.ticks.begin();
  if (at != column.ticks.end() && *at == tick) {
    column.values[static_cast<std::size_t>(place)] = value;
    return;
  }
  column.ticks.insert(at, tick);
  column.values.insert(column.values.begin() + place, value);
}

double TickStore::at(int column, std::int64_t k) const {
  const Column* found = k < first_k_ ? nullptr : find(column, k / kChunkTicks);
  if (!found) return kNoValue;
  const auto tick = static_cast<std::uint16_t>(k % kChunkTicks);
  if (!found->blocks.empty()) return found->values[tick];
  const auto at = std::lower_bound(found->ticks.begin(), found->ticks.end(), tick);
  if (at == found->ticks.end() || *at != tick) return kNoValue;
  return found->values[static_cast<std::size_t>(at - found->ticks.begin())];
}

// Adds the ticks [from, to) of one chunk: of whole blocks the stored extent, else value by value.
void TickStore::add_dense(Extent& extent, const Column& column, std::int64_t from,
                          std::int64_t to) {
  for (std::int64_t i = from; i < to;) {
    if (i % kBlockTicks == 0 && i + kBlockTicks <= to) {
      extent.add(column.blocks[static_cast<std::size_t>(i / kBlockTicks)]);
      i += kBlockTicks;
      continue;
    }
    const double value = column.values[static_cast<std::size_t>(i++)];
    if (!std::isnan(value)) extent.add(value);
  }
}

Extent TickStore::extent(int column, std::int64_t from, std::int64_t to) const {
  Extent extent;
  if (chunks_.empty()) return extent;
  from = std::max(from, first_k_);
  to = std::min(to, last_k_ + 1);
  while (from < to) {
    const std::int64_t chunk = from / kChunkTicks, base = chunk * kChunkTicks;
    const std::int64_t end = std::min(to, base + kChunkTicks);
    if (const Column* found = find(column, chunk)) {
      if (!found->blocks.empty()) {
        add_dense(extent, *found, from - base, end - base);
      } else {
        auto at = std::lower_bound(found->ticks.begin(), found->ticks.end(), from - base);
        for (; at != found->ticks.end() && *at < end - base; ++at)
          extent.add(found->values[static_cast<std::size_t>(at - found->ticks.begin())]);
      }
    }
    from = end;
  }
  return extent;
}

TickStore TickStore::part(std::int64_t from, std::int64_t to) const {
  TickStore copy(max_chunks_);
  if (chunks_.empty()) return copy;
  copy.first_k_ = std::max(from, first_k_);
  copy.last_k_ = std::min(to - 1, last_k_);
  for (const auto& [chunk, ticks] : chunks_)
    if (chunk >= copy.first_k_ / kChunkTicks && chunk <= copy.last_k_ / kChunkTicks)
      copy.chunks_[chunk] = ticks;
  return copy;
}

}  // namespace twinrate::scope
