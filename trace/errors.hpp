// The errors of the equations before and after, on training and held-out rows, and the residuals
// themselves for pictures.
#pragma once
#include "trace/chain.hpp"
#include "trace/result.hpp"
#include "trace/split.hpp"

namespace twinrate {

// Fills the errors of `r`: electrical, mechanical, their series and the main one of the two.
void compare_errors(const Chain& chain, const Effects& found, TraceResult& r);

// Fills `r.files`, one line a file: the error of the main equation over its judging rows, or over
// all its rows if none judges.
void compare_files(const Chain& chain, const Effects& found, const JudgedFiles& files,
                   TraceResult& r);

}  // namespace twinrate
