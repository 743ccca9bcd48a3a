#include "trace/blocks.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "model/frames.hpp"

namespace twinrate {
namespace {

constexpr int kCells = 9;  // of each axis of a map
constexpr std::size_t kMaps = 3;
constexpr double kGap = 1.5;  // of its rows' time: a block that takes longer has a gap
constexpr int kMostSweeps = 6;

using Cells = std::array<std::size_t, kMaps>;

// Cell of a value: the range of the log in kCells equal steps.
class Scale {
 public:
  template <class Value>
  Scale(const std::vector<Slot>& slots, Value&& value) {
    for (const Slot& s : slots) {
      lowest_ = std::min(lowest_, value(s));
      highest_ = std::max(highest_, value(s));
    }
  }
  std::size_t operator()(double x) const {
    const double share = (x - lowest_) / std::max(1e-300, highest_ - lowest_);
    return static_cast<std::size_t>(std::clamp(static_cast<int>(share * kCells), 0, kCells - 1));
  }

 private:
  double lowest_ = 1e300, highest_ = -1e300;
};

std::vector<Cells> cells_of(const std::vector<Slot>& slots) {
  const Scale omega_m(slots, [](const Slot&s) { return s.omega_m; }),
      rate(slots, [](const Slot&s) { return s.omega_rate; }),
      i_d(slots, [](const Slot&s) { return s.i_d; }),
      i_q(slots, [](const Slot&s) { return s.i_q; });
  std::vector<Cells> cells;
  cells.reserve(slots.size());
  for (const Slot& s : slots)
    cells.push_back({kCells * omega_m(s.omega_m) + i_q(s.i_q),
                     kCells * omega_m(s.omega_m) + rate(s.omega_rate),
                     kCells * i_d(s.i_d) + i_q(s.i_q)});
  return cells;
}

// Number of slots in each cell from the blocks taken so far.
class Coverage {
 public:
  explicit Coverage(const std::vector<Cells>& cells) : cells_(cells) {}
  // Increase of the worth with the block, beside the blocks taken so far.
  double gain(const Block& block) {
    const double before = worth_;
    add(block, 1);
    const double with = worth_;
    add(block, -1);
    worth_ = before;
    return with - before;
  }
  void add(const Block& block, int sign) {
    for (std::size_t slot = block.first; slot < block.end; ++slot)
      for (std::size_t map = 0; map < kMaps; ++map) {
        int& count = count_[map][cells_[slot][map]];
        worth_ -= std::sqrt(count);
        worth_ += std::sqrt(count += sign);
      }
  }

 private:
  const std::vector<Cells>& cells_;
  std::array<std::array<int, kCells * kCells>, kMaps> count_{};
  double worth_ = 0;
};

bool has_gap(const std::vector<Slot>& slots, const Block& block, double T_s) {
  std::size_t rows = 0;
  for (std::size_t slot = block.first; slot < block.end; ++slot) rows += slots[slot].rows;
  return slots[block.end - 1].t_end - slots[block.first].t_begin >
         kGap * T_s * static_cast<double>(rows);
}

double turned(double from, double to) {
  return std::abs(to - from) < kPi ? to - from : wrap_pi(to - from);
}

}  // namespace

Slot slot_of(const RawLog& piece, int n_p) {
  const std::size_t n = piece.size();
  Slot s{.t_begin = piece.t.front(), .t_end = piece.t.back(), .rows = n};
  for (std::size_t k = 1; k < n; ++k) s.omega_m += turned(piece.theta_m[k - 1], piece.theta_m[k]);
  s.omega_m /= std::max(1e-12, s.t_end - s.t_begin);
  Vec2 sum = Vec2::Zero();
  for (std::size_t k = 0; k < n; ++k) {
    const double theta_e = n_p * piece.theta_m[k];
    if (!piece.i_a.empty() && !piece.i_b.empty())
      sum += park(clarke({piece.i_a[k], piece.i_b[k], -piece.i_a[k] - piece.i_b[k]}), theta_e);
    else if (!piece.i_alpha.empty() && !piece.i_beta.empty())
      sum += park({piece.i_alpha[k], piece.i_beta[k]}, theta_e);
    else
      sum += Vec2(piece.i_d.empty() ? 0 : piece.i_d[k], piece.i_q.empty() ? 0 : piece.i_q[k]);
  }
  s.i_d = sum[0] / static_cast<double>(n);
  s.i_q = sum[1] / static_cast<double>(n);
  return s;
}

std::vector<Block> choose_blocks(std::vector<Slot> slots, std::size_t blocks, std::size_t length,
                                 double T_s) {
  const std::size_t n = slots.size();
  for (std::size_t k = 1; k + 1 < n; ++k)
    slots[k].omega_rate = (slots[k + 1].omega_m - slots[k - 1].omega_m) /
                          std::max(1e-12, slots[k + 1].t_begin - slots[k - 1].t_begin);
  const std::vector<Cells> cells = cells_of(slots);
  std::vector<std::vector<Block>> choices(blocks);  // of each part of the log
  const std::size_t step = std::max<std::size_t>(1, length / 12);
  for (std::size_t part = 0; part < blocks; ++part) {
    const std::size_t end = n * (part + 1) / blocks;
    for (std::size_t first = n * part / blocks; first + length <= end; first += step)
      if (const Block block{first, first + length}; !has_gap(slots, block, T_s))
        choices[part].push_back(block);
  }
  Coverage coverage(cells);
  const auto best_of = [&](const std::vector<Block>& some, double& most) {
    std::optional<Block> best;
    most = -1;
    for (const Block& block : some)
      if (const double gain = coverage.gain(block); gain > most) most = gain, best = block;
    return best;
  };
  std::vector<std::optional<Block>> taken(blocks);
  for (std::size_t round = 0; round < blocks; ++round) {
    std::size_t part_of_best = 0;
    std::optional<Block> best;
    double most = -1, gain = 0;
    for (std::size_t part = 0; part < blocks; ++part) {
      if (taken[part]) continue;
      const std::optional<Block> block = best_of(choices[part], gain);
      if (block && gain > most) most = gain, best = block, part_of_best = part;
    }
    if (!best) break;
    taken[part_of_best] = best;
    coverage.add(*best, 1);
  }
  bool changed = true;
  for (int sweep = 0; changed && sweep < kMostSweeps; ++sweep) {
    changed = false;
    for (std::size_t part = 0; part < blocks; ++part) {
      if (!taken[part]) continue;
      coverage.add(*taken[part], -1);
      double gain = 0;
      const Block best = *best_of(choices[part], gain);
      changed = changed || best.first != taken[part]->first;
      taken[part] = best;
      coverage.add(best, 1);
    }
  }
  std::vector<Block> list;
  for (const std::optional<Block>& block : taken)
    if (block) list.push_back(*block);
  return list;
}

}  // namespace twinrate
