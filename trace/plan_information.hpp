// What pieces of a record are worth to the tracer: its own equations, low-pass, candidates and
// whitening, as information matrices (trace/plan.hpp).
//
// The candidates are a thinned set, the same for every record of a drive: orders of a turn at a few
// places that kinds share, resistance without its drift. An effect without regressors stands at
// each point of its grid, its contribution there for a column. Of a load_step the moment is not
// known: it is there in every row with probability 1/2, which halves its products with the other
// columns and with itself (beside constant_load half of it is left: 45 degrees).
#pragma once
#include <set>

#include "core/drive_config.hpp"
#include "trace/health.hpp"
#include "trace/plan.hpp"

namespace twinrate {

// Rows [first, last) of a record.
struct RowSpan {
  std::size_t first = 0, last = 0;
};

struct PlanInformation {
  PlanCandidates candidates;
  std::vector<Information> pieces;  // of each span
};

// Kinds that no information matrix judges: a gap (its impacts move in time with every key) and a
// ripple of the bus (stands in v_dc, in no equation).
const std::vector<std::string>& kinds_outside_the_design();
// Kinds that a plan may be asked for, these aside.
std::vector<std::string> plannable_kinds();
// `kinds`: of plannable_kinds(); empty: all. `spans`: ascending; only their rows count, and no
// filter reaches from one into the next. Noise is what no candidate explains (trace/noise.hpp).
PlanInformation plan_information(const Record& record, const Health& health,
                                 const DriveConfig& drive, const std::set<std::string>& kinds,
                                 const std::vector<RowSpan>& spans);
// Of a record longer than that, pieces of two seconds from all over it, one behind the other;
// `part`: how much of the record that is. What the whole is worth is what the excerpt is worth,
// over `part`.
Record excerpt(const Record& record, double longest_s, double& part);
// The rows of a record that the tracer would train on.
std::vector<RowSpan> training_spans(const Record& record, double holdout, int n_p);

}  // namespace twinrate
