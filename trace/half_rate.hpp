// The same record with twice as many rows as one, and its chain: what a claim says must not depend
// on the rate at which it was looked at.
#pragma once
#include "trace/chain.hpp"
#include "trace/noise.hpp"

namespace twinrate {

class HalfRate {
 public:
  // `rows`: of the log that are one here. `effects` are known; what they leave at this rate is taken
  // for its noise.
  HalfRate(const Record& whole, const NoisierRecords& noisier, std::size_t rows,
           const DriveFacts& facts, const Effects& known, const Effects& effects,
           const NoiseModel& scales);
  const Chain& chain() const { return chain_; }

 private:
  Record record_, answered_record_, readings_record_;
  Equations equations_, answered_, readings_;
  Sampler sampler_;
  Chain chain_;
};

}  // namespace twinrate
