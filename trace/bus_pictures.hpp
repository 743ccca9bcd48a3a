// Pictures of what alternates in the bus voltage, before and after it was found.
#pragma once
#include <vector>

#include "trace/bus_lines.hpp"
#include "trace/result.hpp"

namespace twinrate {

// Means over a period of `f`, cut into parts: of `rest` with the line and without it, in the rows
// of `shown`.
TracePicture picture_of_period(double f, const std::vector<double>& t,
                               const std::vector<char>& held_out,
                               const std::vector<BusPiece>& shown, const std::vector<double>& line,
                               const std::vector<double>& rest);
TracePicture picture_of_spectra(double highest_Hz, const BusSpectrum& before,
                                const BusSpectrum& after);

}  // namespace twinrate
