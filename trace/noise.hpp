// How large the noise of a record is, and what it looks like at the tracer's rate.
#pragma once
#include "trace/dictionary.hpp"
#include "trace/unexplained.hpp"

namespace twinrate {

// The record with as much noise again on currents and angle as its samples have: the rounding of an
// encoder's counts as rounding (trace/rounding.hpp), the rest white, of the size that the fourth
// difference shows: of the currents in rotor axes, where one at constant torque does not turn.
struct NoisierRecords {
  Record answered;  // with what the controller makes of it
  Record readings;  // the readings alone
};
NoisierRecords add_noise(const Record& record, const DriveFacts& facts,
                         const std::vector<char>& moving, double i_lsb);
// The record with the rounding of its encoder's counts alone, the counts moved (trace/rounding.hpp).
Record with_moved_counts(const Record& record);
// The noise model, from what no candidate can explain of `y` (sampled, not whitened). Candidates
// whose columns hold the noise itself are left out.
class NoiseFit {
 public:
  NoiseModel operator()(const Chain& chain, const Sampled& y, const Dictionary& dictionary);

 private:
  Unexplained d_, q_, torque_;
};

}  // namespace twinrate
