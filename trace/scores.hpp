// The score of a set of effects, and the gain of each candidate beside it.
//
//   score of a set = N log(RSS) + k log(N) + margin (number of effects),   lower is better
#pragma once
#include "trace/fit.hpp"

namespace twinrate {

struct Score {
  std::shared_ptr<Effect> effect;  // with the linear coefficients set; null: undetermined
  double gain = 0;                 // fall of the score
  double sigma_in_sizes = 0;       // one sigma over the smallest size worth reporting
  bool valid = false;              // inside the ranges of its keys, and large enough
};

// Gain of each candidate if it is added to `fit`, by linear regression with the fit's own
// parameters free.
std::vector<Score> score_all(const Fitter& fitter, const Fit& fit,
                             const std::vector<Candidate>& candidates);
double score_of(const Fitter& fitter, const Fit& fit);
// True if two effects of one kind are closer than the least distance of its repeats. They then
// count as one: a shaft shows more than a step of two load steps so close together.
bool repeats_nearby(const Effect& member, const Effect& newcomer);
// Number of fitted parameters: coefficients, and keys that are searched.
std::size_t parameters_of(const Effect& effect);

}  // namespace twinrate
