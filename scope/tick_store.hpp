// The history of a drive: one column a signal over the tick k, with minima and maxima beside it.
//
// The ticks are divided into chunks of kChunkTicks; if there are more chunks than allowed, the
// oldest one is dropped. A column is dense (a value nearly every tick) or sparse. A dense column
// stores the smallest, the largest, the sum and the sum of squares of each block of kBlockTicks, so
// that a minute of a fast drive is reduced to the pixels of a plot without reading every tick.
// Chunks are shared: a capture copies the table of chunks, and keeps chunks that the ring drops.
// Memory: 8.6 bytes a tick and dense column.
//
// Not thread-safe; scope::Recording locks.
#pragma once
#include <array>
#include <cstdint>
#include <limits>
#include <map>
#include <memory>
#include <vector>

namespace twinrate::scope {

inline constexpr std::int64_t kChunkTicks = 4096, kBlockTicks = 64;
inline constexpr double kNoValue = std::numeric_limits<double>::quiet_NaN();

// Statistics of one column over a range of ticks.
struct Extent {
  double min = std::numeric_limits<double>::infinity();
  double max = -std::numeric_limits<double>::infinity();
  double sum = 0, sum_of_squares = 0;
  std::int64_t count = 0;

  void add(double value);
  void add(const Extent& other);
  bool empty() const { return count == 0; }
};

class TickStore {
 public:
  explicit TickStore(std::size_t max_chunks) : max_chunks_(max_chunks) {}

  // A value that is not finite counts as missing. Ticks older than the history are ignored.
  void set(int column, bool dense, std::int64_t k, double value);
  double at(int column, std::int64_t k) const;                          // kNoValue if there is none
  Extent extent(int column, std::int64_t from, std::int64_t to) const;  // of the ticks [from, to)

  bool empty() const { return chunks_.empty(); }
  std::int64_t first_k() const { return first_k_; }
  std::int64_t last_k() const { return last_k_; }  // -1: none
  std::int64_t dropped_ticks() const { return dropped_chunks_ * kChunkTicks; }
  // The chunks that contain the ticks [from, to), shared with this store.
  TickStore part(std::int64_t from, std::int64_t to) const;

 private:
  struct Column {
    std::vector<double> values;        // dense: kChunkTicks of them
    std::vector<Extent> blocks;        // dense
    std::vector<std::uint16_t> ticks;  // sparse: ticks of the values, ascending
  };
  struct Chunk {
    std::vector<std::unique_ptr<Column>> columns;
  };

  const Column* find(int column, std::int64_t chunk) const;
  Column& make(int column, bool dense, std::int64_t chunk);
  static void set_dense(Column& column, std::size_t tick, double value);
  static void set_sparse(Column& column, std::uint16_t tick, double value);
  static void add_dense(Extent& extent, const Column& column, std::int64_t from, std::int64_t to);
  void drop_oldest();

  std::size_t max_chunks_;
  std::map<std::int64_t, std::shared_ptr<Chunk>> chunks_;  // by k / kChunkTicks
  std::int64_t written_ = -1;                              // chunk of the last write, cached
  std::shared_ptr<Chunk> writing_;
  std::int64_t first_k_ = -1, last_k_ = -1, dropped_chunks_ = 0;
};

}  // namespace twinrate::scope
