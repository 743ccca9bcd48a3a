// The gate's rule of transfer (trace/gate.hpp) for any problem: a claim lowers the raw error on the
// judging rows beyond chance.
//
// The judging rows are cut into pieces. The vote of piece b is r_b = 1/2 ln(E_b without / E_b
// with). A piece whose energy changes by less than a silent share does not vote.
#pragma once
#include <limits>
#include <map>
#include <utility>
#include <vector>

#include "trace/gate.hpp"

namespace twinrate {

// The energy in each piece, by file and piece of the file.
using Pieces = std::map<std::pair<int, std::size_t>, double>;

// An equation whose error on the judging rows rises by a claim.
struct Raised {
  const char* equation = "";
  double gain = 0;    // of all its rows, negative
  double chance = 1;  // that the pieces of a file are so much worse
};

struct Votes {
  Judgement judgement;
  double mean = 0;              // of r_b, over all pieces that vote
  double quieter = 0;           // part of each r_b from sensor noise that the claim reduces
  double of_angle = 0;          // pooled fall that noise of the angle alone would make
  double beyond_angle = 1;      // ln of the further fall, mean over frequencies
  double over_noise = 1;        // energy without the claim, over that of the sensors' noise
  double left_over_noise = 1;   // energy with the claim, over the same
  double least_over_noise = 1;  // that the claim needs
  const char* least_because = "";
  // Projection of the residual without the claim on the change by the claim, over the standard
  // deviation of the same projection of the sensors' noise; 0: not used, because noise in the claim
  // itself could make it.
  double along_change = 0;
  // Energy of the change of the voltages, over that of the change of their noise and of the
  // controller's response to it.
  double change_over_noise = std::numeric_limits<double>::infinity();
  // As along_change, for a claim that holds noise: less the part in common with the residual's
  // noise.
  double along_beside_noise = 0;
  bool answer_unknown = false;    // no response of the controller to the noise could be found
  Raised raised;                  // of a claim on both equations
  std::map<int, double> worse;    // by file: chance of pieces so much worse
  std::map<int, double> of_file;  // mean of r_b
};
// `quieter` is subtracted from each r_b, and the fall of all pieces together must exceed it. The
// values of a single file include it.
Votes votes_of(const Pieces& without, const Pieces& with, double silent, double quieter = 0);

// One for each claim; its rule is empty if the claim transfers. Refusals: too few votes, a file
// that becomes worse, no gain of all rows, or chance, after Holm over the claims. The caller sets
// the kind.
std::vector<Refused> refused_by_transfer(const std::vector<Votes>& claims,
                                         const std::vector<std::string>& files,
                                         const Criterion& criterion);

}  // namespace twinrate
