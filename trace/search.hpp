// The search for missing effects: rounds of a noise model and a selection of one effect each. Then
// each effect is compared with the kinds that could replace it (trace/selection.hpp).
#pragma once
#include <string>
#include <vector>

#include "trace/hooks.hpp"
#include "trace/problem.hpp"
#include "trace/selection.hpp"

namespace twinrate {

struct Health;

// Least score gain of a new effect (Fitter::set_margin): higher if the converter is coarse or rows
// are lost.
double margin_of(const Record& record, const Health& health, const DriveFacts& facts);

class Search {
 public:
  // Searches on the rows of the problem that do not judge, and sets the noise model of those rows.
  Search(DriveProblem& problem, double margin, const Say& say);
  // Kinds that the search leaves out.
  void leave_out(std::vector<std::string> kinds) { left_out_ = std::move(kinds); }
  // Continues from `found`. Throws TraceStopped.
  Selection operator()(Fit found);
  // The selection after the last complete round of a stopped search, without the comparison; throws
  // TraceStopped before the first.
  Selection so_far();
  Fitter fitter() const;
  const Dictionary& dictionary() const { return dictionary_; }

 private:
  // Noise model from the residual of the effects found so far; computes the columns again if
  // needed.
  void renew_noise(bool first);
  // Takes a refused fit, and its noise, if its last member helps beside that noise.
  bool helps_under_its_noise(Fit refused);

  DriveProblem& problem_;
  double margin_;
  Say say_;
  Laps laps_;
  Dictionary dictionary_;
  Rows fitting_, choosing_;
  std::vector<std::string> left_out_;
  NoiseFit fit_noise_;
  Fit fit_;                  // after the last whole round
  NoiseModel noise_of_fit_;  // under which it was made
  int rounds_ = 0;
};

}  // namespace twinrate
