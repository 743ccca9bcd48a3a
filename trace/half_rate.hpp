// The record at half the tracer's rate, and its chain: a claim must not depend on the rate.
#pragma once
#include "trace/chain.hpp"
#include "trace/noise.hpp"

namespace twinrate {

class HalfRate {
 public:
  // `rows`: rows of the log for one row here. `effects` are known. The residual that they leave at
  // this rate is taken as its noise.
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
