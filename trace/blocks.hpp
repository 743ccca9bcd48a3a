// Which stretches of a long log are traced.
//
// The log is cut into slots of equal row count, of which only means are kept. One block of
// neighbouring slots is taken from each of `blocks` equal parts of the log, so that what drifts or
// steps in time stays visible; among the slots of its part it is the block that adds most to
//
//   sum over cells of sqrt(slots in the cell)
//
// where the cells are those of three maps, (omega_m, i_q), (omega_m, omega_m') and (i_d, i_q), each
// over the range of the whole log: the next slot of a kind is worth less the more of it are there.
// The blocks are chosen one after another, the most valuable first, and then each once more beside
// all the others until none changes.
#pragma once
#include <cstddef>
#include <vector>

#include "trace/health.hpp"

namespace twinrate {

// Means over some rows.
struct Slot {
  double t_begin = 0, t_end = 0;  // of the first and the last row
  std::size_t rows = 0;
  double omega_m = 0, omega_rate = 0;  // rad/s, rad/s^2; omega_rate by choose_blocks
  double i_d = 0, i_q = 0;             // A
};

// `piece` has an angle and a current; angles wrapped or not.
Slot slot_of(const RawLog& piece, int n_p);

// Slots [first, end).
struct Block {
  std::size_t first = 0, end = 0;
};

// `length`: slots of a block, 1 and more. In order of time; fewer than `blocks` where parts of the
// log have no stretch of that length without a gap.
std::vector<Block> choose_blocks(std::vector<Slot> slots, std::size_t blocks, std::size_t length,
                                 double T_s);

}  // namespace twinrate
