// The search for what is missing: rounds of a noise model and a selection, an effect each, then a comparison of
// what was found with what could stand in its place (trace/selection.hpp).
#pragma once
#include <string>
#include <vector>

#include "trace/hooks.hpp"
#include "trace/problem.hpp"
#include "trace/selection.hpp"

namespace twinrate {

struct Health;

// Score that a new effect must bring (Fitter::set_margin): more where the converter is coarse or rows are lost.
double margin_of(const Record& record, const Health& health, const DriveFacts& facts);

class Search {
 public:
  // The problem is searched on its rows that do not judge, and gets their noise model.
  Search(DriveProblem& problem, double margin, const Say& say);
  // Kinds that are not looked for.
  void leave_out(std::vector<std::string> kinds) { left_out_ = std::move(kinds); }
  // Goes on from `found`. Throws TraceStopped.
  Selection operator()(Fit found);
  // After the last whole round, not compared, where a search was stopped; throws TraceStopped before the first.
  Selection so_far();
  Fitter fitter() const;
  const Dictionary& dictionary() const { return dictionary_; }

 private:
  // Of what the model with what has been found leaves; the columns anew where it is another.
  void renew_noise(bool first);

  DriveProblem& problem_;
  double margin_;
  Say say_;
  Laps laps_;
  Dictionary dictionary_;
  Rows fitting_, choosing_;
  std::vector<std::string> left_out_;
  NoiseFit fit_noise_;
  Fit fit_;                  // after the last whole round
  NoiseModel noise_of_fit_;  // that it was made under
  int rounds_ = 0;
};

}  // namespace twinrate
