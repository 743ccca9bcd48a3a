// Value of pieces of a record to the tracer: its own equations, low-pass, candidates and whitening,
// as information matrices (trace/plan.hpp).
//
// The candidates are a thinned set, the same for every record of a drive: orders of a turn at a few
// values that kinds share, resistance without its drift. An effect without regressors has one
// column at each point of its grid, its contribution there. The moment of a load_step is unknown:
// it is present in every row with probability 1/2. This halves its products with the other columns
// and with itself (beside constant_load half of it is left: 45 degrees).
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
// ripple of the bus (it is in v_dc, in no equation).
const std::vector<std::string>& kinds_outside_the_design();
// All kinds that a plan can cover.
std::vector<std::string> plannable_kinds();
// `kinds`: of plannable_kinds(); empty: all. `spans`: ascending. Only their rows count, and no
// filter reaches from one span into the next. Noise is the part that no candidate explains
// (trace/noise.hpp).
PlanInformation plan_information(const Record& record, const Health& health,
                                 const DriveConfig& drive, const std::set<std::string>& kinds,
                                 const std::vector<RowSpan>& spans);
// Of a longer record, pieces of two seconds from all over it in sequence; `part`: their share of
// the record. The information of the whole is that of the excerpt over `part`.
Record excerpt(const Record& record, double longest_s, double& part);
// The rows of a record on which the tracer would train.
std::vector<RowSpan> training_spans(const Record& record, double holdout, int n_p);

}  // namespace twinrate
