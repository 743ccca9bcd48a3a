// The points of a static set that fit, choose and judge, their order along the set's coordinates,
// and their neighbours.
//
// A grid is split like a chess board: fields of one colour fit. Of the other colour, fields in even
// rows judge and those in odd rows choose. Points that form no grid are split in the order of the
// first coordinate: of four the first and third fit, the second judges, the fourth chooses.
#pragma once
#include "trace/static_fit.hpp"

namespace twinrate {

struct StaticSet;

// Fills role, file, files, order, ends_line and coordinate of `problem`. `held_out`: judging
// points; empty: by the rule above. `second` may be empty. Returns the rule in words.
std::string split_points(const StaticSet& set, const std::vector<double>& first,
                         const std::vector<double>& second, const std::vector<char>& held_out,
                         const char* rule, StaticProblem& problem);

}  // namespace twinrate
