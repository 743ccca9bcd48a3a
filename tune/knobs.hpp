// The noise weights of a filter as parameters of a search.
//
//   Q     variance of the process noise of a state
//   R     variance of an output
//   P0    variance of a state at the start: scaled with Q and R, because it is not identifiable from a log
//   L     gain of the integral of the tracking error (ekf_disturbance, ekf_harmonic)
//
// Weights of one key that are equal in the drive file stay equal (alpha and beta, d and q): they
// are one knob. A weight of zero has no knob: there the model is exact.
#pragma once
#include <string>
#include <vector>

#include "core/config.hpp"

namespace twinrate::tune {

struct Knob {
  std::string key;         // "estimator.ekf_sensorless.Q_diag"
  std::vector<int> index;  // elements of the list that move together; empty: the key is one number
  double value = 0;        // variance in the key's unit; L with its sign
  bool is_weight = true;   // not L: a common factor of all weights leaves the gain unchanged
};

struct Knobs {
  std::vector<Knob> list;
  std::vector<std::pair<std::string, std::vector<double>>> keys;  // each key with its values

  // Sets the knob's value in `keys`.
  void set(std::size_t knob, double value);
  // Multiplies all Q, R and P0 by one factor.
  void scale_weights(double factor);
  // "key=value" for load_drive().
  std::vector<std::string> overrides() const;
  // The table [estimator.KIND] as text.
  std::string table() const;
};

// The knobs of the filter that the drive file chooses.
Knobs knobs_of(Config& config);

}  // namespace twinrate::tune
