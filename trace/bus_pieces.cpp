#include "trace/bus_pieces.hpp"

#include <cmath>

namespace twinrate {
namespace {

constexpr std::size_t kGapRows = 10;

}  // namespace

std::vector<BusPiece> bus_pieces(const Record& record) {
  std::vector<BusPiece> pieces;
  std::size_t bad = 0;
  bool open = false;
  for (std::size_t k = 0; k < record.size(); ++k) {
    bad = record.electrical_ok[k] ? 0 : bad + 1;
    const bool jump =
        k > 0 && std::abs(record.t[k] - record.t[k - 1] - record.T_s) > 0.5 * record.T_s;
    if (bad >= kGapRows) {
      if (open) pieces.back().last = k + 1 - bad;
      open = false;
      continue;
    }
    if (open && !jump) {
      pieces.back().last = k + 1;
    } else {
      if (!record.electrical_ok[k]) continue;
      pieces.push_back({k, k + 1});
      open = true;
    }
  }
  return pieces;
}

std::vector<BusPiece> runs_of(const std::vector<BusPiece>& pieces,
                              const std::vector<char>& held_out, bool held) {
  std::vector<BusPiece> runs;
  for (const BusPiece& piece : pieces)
    for (std::size_t k = piece.first; k < piece.last; ++k) {
      if ((held_out[k] != 0) != held) continue;
      if (runs.empty() || runs.back().last != k || runs.back().first < piece.first)
        runs.push_back({k, k});
      runs.back().last = k + 1;
    }
  return runs;
}

std::size_t rows_in(const std::vector<BusPiece>& runs) {
  std::size_t rows = 0;
  for (const BusPiece& run : runs) rows += run.last - run.first;
  return rows;
}

std::vector<double> without_slow_part(const std::vector<double>& x, std::size_t window,
                                      std::vector<BusPiece>& pieces) {
  const std::size_t half = window / 2;
  std::erase_if(pieces, [&](const BusPiece& p) { return p.last - p.first <= 2 * window; });
  std::vector<double> quick(x.size(), 0.0);
  for (BusPiece& p : pieces) {
    double sum = 0;
    for (std::size_t k = p.first; k < p.first + window; ++k) sum += x[k] - x[p.first];
    for (std::size_t k = p.first + half; k + half < p.last; ++k) {
      quick[k] = x[k] - x[p.first] - sum / static_cast<double>(window);
      if (k + half + 1 < p.last) sum += x[k + half + 1] - x[k - half];
    }
    p = {p.first + half, p.last - half};
  }
  return quick;
}

}  // namespace twinrate
