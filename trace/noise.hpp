// Size of a record's noise, and its model at the tracer's rate.
#pragma once
#include "trace/dictionary.hpp"
#include "trace/unexplained.hpp"

namespace twinrate {

// The record with noise of the size of its own added to currents and angle: rounding errors for an
// encoder's counts (trace/rounding.hpp), and white noise for the remainder. The fourth difference
// gives the size of the white noise. For the currents it is taken in rotor axes, in which a current
// at constant torque is constant.
struct NoisierRecords {
  Record answered;  // with the controller's response to it
  Record readings;  // with noise on the readings alone
};
NoisierRecords add_noise(const Record& record, const DriveFacts& facts,
                         const std::vector<char>& moving, double i_lsb);
// The record with the rounding errors of moved counts alone (trace/rounding.hpp).
Record with_moved_counts(const Record& record);
// The noise model, from the part of `y` (sampled, not whitened) that no candidate explains.
// Candidates whose columns hold the noise itself are left out.
class NoiseFit {
 public:
  NoiseModel operator()(const Chain& chain, const Sampled& y, const Dictionary& dictionary);

 private:
  Unexplained d_, q_, torque_;
};

}  // namespace twinrate
