// Whether the coefficients of anything that could be missing change at a moment of the record: where
// a change of the drive is looked for (trace/change_points.hpp). It proves nothing. Nothing is asked
// where no block of the residual is louder than the median one by more than its scatter.
#pragma once
#include <optional>

#include "trace/change_points.hpp"

namespace twinrate {

// The row of `record` from which on coefficients are others; none where nothing is suspicious.
// `found`: effects that the model has beside those known. `seams`: rows at which files begin.
std::optional<std::size_t> suspicious_row(const Record& record, const DriveConfig& drive,
                                          const Effects& found,
                                          const std::vector<std::size_t>& seams);

}  // namespace twinrate
