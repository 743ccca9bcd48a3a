// What a set of effects costs, and what each candidate would bring to it.
//
//   score of a set = N log(RSS) + k log(N) + margin (number of effects),   lower is better
#pragma once
#include "trace/fit.hpp"

namespace twinrate {

struct Score {
  std::shared_ptr<Effect> effect;  // with the linear coefficients set; null: cannot be told
  double gain = 0;                 // fall of the score
  double sigma_in_sizes = 0;       // one sigma over the smallest size worth reporting
  bool valid = false;              // inside the ranges of its keys, and large enough
};

// What adding each candidate to `fit` would bring, by linear regression with the fit's own
// parameters free.
std::vector<Score> score_all(const Fitter& fitter, const Fit& fit,
                             const std::vector<Candidate>& candidates);
double score_of(const Fitter& fitter, const Fit& fit);
// Two of one kind nearer than the distance of its repeats are one: of a load step so close to
// another a shaft shows more than a step.
bool repeats_nearby(const Effect& member, const Effect& newcomer);
// Those that are fitted: coefficients, and keys that are searched.
std::size_t parameters_of(const Effect& effect);

}  // namespace twinrate
