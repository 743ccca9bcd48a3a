// The rule of transfer of the gate (trace/gate.hpp), for any problem: a claim lowers the raw error
// of rows that judge by more than chance.
//
// Rows that judge are cut into pieces. Piece b says r_b = 1/2 ln(E_b without / E_b with); a piece
// whose energy changes by less than a silent share does not vote.
#pragma once
#include <limits>
#include <map>
#include <utility>
#include <vector>

#include "trace/gate.hpp"

namespace twinrate {

// The energy in each piece, by file and piece of the file.
using Pieces = std::map<std::pair<int, std::size_t>, double>;

struct Votes {
  Judgement judgement;
  double mean = 0;              // of r_b, over all pieces that vote
  double quieter = 0;           // of each r_b, for sensor noise that the claim makes smaller
  double of_angle = 0;          // pooled fall that a noise of the angle alone would make
  double beyond_angle = 1;      // ln of the further fall, mean over frequencies
  double over_noise = 1;        // energy without the claim, over that of the sensors' noise
  double least_over_noise = 1;  // that the claim needs
  // The residual without the claim along what the claim changes, in deviations of the sensors' noise
  // along it; 0: noise in the claim itself could make that up.
  double along_change = 0;
  // Energy of what it changes of the voltages, over that of what it changes of the noise in them and
  // of the controller's answer to it.
  double change_over_noise = std::numeric_limits<double>::infinity();
  // As along_change, of a claim that holds noise: less what that has in common with the residual's.
  double along_beside_noise = 0;
  std::map<int, double> worse;    // by file: chance of pieces so much worse
  std::map<int, double> of_file;  // mean of r_b
};
// `quieter` is taken off each r_b, and the fall of all together must exceed it; what a file says of
// itself keeps it.
Votes votes_of(const Pieces& without, const Pieces& with, double silent, double quieter = 0);

// One a claim, none where it transfers (rule empty): by too few votes, a file that is worse, no
// gain in all, or by chance, after Holm over the claims. The name of the claim is left open.
std::vector<Refused> refused_by_transfer(const std::vector<Votes>& claims,
                                         const std::vector<std::string>& files,
                                         const Criterion& criterion);

}  // namespace twinrate
