// Stretches of the bus voltage without a gap, and what changes quickly in them.
#pragma once
#include <cstddef>
#include <vector>

#include "trace/bus_lines.hpp"
#include "trace/record.hpp"

namespace twinrate {

// A few bad rows do not part them; many, or a step of time, do.
std::vector<BusPiece> bus_pieces(const Record& record);
// Rows of the pieces that are held out, or that are not.
std::vector<BusPiece> runs_of(const std::vector<BusPiece>& pieces,
                              const std::vector<char>& held_out, bool held);
std::size_t rows_in(const std::vector<BusPiece>& runs);
// x less its mean over `window` rows around each; the pieces lose half a window at both ends.
std::vector<double> without_slow_part(const std::vector<double>& x, std::size_t window,
                                      std::vector<BusPiece>& pieces);

}  // namespace twinrate
