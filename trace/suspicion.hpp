// Finds a moment of the record at which the coefficients of a candidate change. There the change of
// the drive is tested (trace/change_points.hpp); the suspicion alone proves nothing. There is no
// suspicion if no block of the residual exceeds the median block by more than its scatter.
#pragma once
#include <optional>

#include "trace/change_points.hpp"

namespace twinrate {

// The first row of `record` with other coefficients; none if nothing is suspicious. `found`:
// effects of the model beside the known ones. `seams`: first rows of files.
std::optional<std::size_t> suspicious_row(const Record& record, const DriveConfig& drive,
                                          const Effects& found,
                                          const std::vector<std::size_t>& seams);

}  // namespace twinrate
