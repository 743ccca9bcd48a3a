// Stretches of the bus voltage without a gap, and the fast part of the voltage in them.
#pragma once
#include <cstddef>
#include <vector>

#include "trace/bus_lines.hpp"
#include "trace/record.hpp"

namespace twinrate {

// A few bad rows do not separate two pieces; many bad rows or a step of time do.
std::vector<BusPiece> bus_pieces(const Record& record);
// Rows of the pieces that are held out (`held`), or that are not.
std::vector<BusPiece> runs_of(const std::vector<BusPiece>& pieces,
                              const std::vector<char>& held_out, bool held);
std::size_t rows_in(const std::vector<BusPiece>& runs);
// x less its moving mean over `window` rows. Each piece loses half a window at both ends.
std::vector<double> without_slow_part(const std::vector<double>& x, std::size_t window,
                                      std::vector<BusPiece>& pieces);

}  // namespace twinrate
