// Selection of the stretches of a long log that are traced.
//
// The log is cut into slots of equal row count, of which only means are stored. Each of `blocks`
// equal parts of the log gives one block of neighbouring slots, so that drifts and steps in time
// stay visible. The block chosen in a part is the one that adds most to
//
//   sum over cells of sqrt(slots in the cell)
//
// The cells are those of three maps, (omega_m, i_q), (omega_m, omega_m') and (i_d, i_q), each over
// the range of the whole log. A further slot in a cell adds less, the more slots the cell holds.
// The blocks are chosen one after another, the largest gain first. Then each block is chosen again
// beside all others until no block changes.
#pragma once
#include <cstddef>
#include <vector>

#include "trace/health.hpp"

namespace twinrate {

// Means over the rows of a slot.
struct Slot {
  double t_begin = 0, t_end = 0;  // of the first and the last row
  std::size_t rows = 0;
  double omega_m = 0, omega_rate = 0;  // rad/s, rad/s^2; omega_rate by choose_blocks
  double i_d = 0, i_q = 0;             // A
};

// `piece` has an angle and a current. The angle may be wrapped or not.
Slot slot_of(const RawLog& piece, int n_p);

// Slots [first, end).
struct Block {
  std::size_t first = 0, end = 0;
};

// `length`: slots of a block, at least 1. The blocks are in order of time. A part of the log
// without a stretch of that length free of gaps gives no block.
std::vector<Block> choose_blocks(std::vector<Slot> slots, std::size_t blocks, std::size_t length,
                                 double T_s);

}  // namespace twinrate
