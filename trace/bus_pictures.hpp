// Pictures of the alternating part of the bus voltage, before and after the fit of its lines.
#pragma once
#include <vector>

#include "trace/bus_lines.hpp"
#include "trace/result.hpp"

namespace twinrate {

// Means over a period of `f`, cut into parts, over the rows of `shown`: of `rest` plus the line,
// and of `rest` alone.
TracePicture picture_of_period(double f, const std::vector<double>& t,
                               const std::vector<char>& held_out,
                               const std::vector<BusPiece>& shown, const std::vector<double>& line,
                               const std::vector<double>& rest);
TracePicture picture_of_spectra(double highest_Hz, const BusSpectrum& before,
                                const BusSpectrum& after);

}  // namespace twinrate
