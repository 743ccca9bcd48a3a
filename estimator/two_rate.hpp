// The two halves of a two-rate filter, as every process and the one-process simulation run them.
//
//   FastLoop        MEASUREMENT(k), gains so far -> ESTIMATE(k)      at f_s
//   BackgroundLoop  ESTIMATE(s), s = 0, n, 2n .. -> GAIN(s)          at f_b = f_s/n
#pragma once
#include <memory>

#include "core/rates.hpp"
#include "estimator/filter.hpp"
#include "estimator/gain_slots.hpp"

namespace twinrate {

class FastLoop {
 public:
  FastLoop(std::shared_ptr<const Filter> filter, GainPolicy policy, int n);

  // Forgets everything: the next sample starts a session.
  void reset();
  void take_gain(const Gain& gain) { gains_.push(gain); }
  // True when the gain that tick k plans to use is here (or none is planned yet).
  bool gain_ready(std::int64_t k) const;
  // The tick. Samples missing since the last one are predicted over (at most kMaxGap, else the
  // filter starts again from this sample). A gain that is late is replaced by the newest older one,
  // and said in status.
  Estimate tick(const Measurement& m);

  std::int64_t last_k() const { return last_.k; }
  static constexpr std::int64_t kMaxGap = 50;

 private:
  std::shared_ptr<const Filter> filter_;
  GainPolicy policy_;
  int n_;
  FastState state_;
  GainSlots gains_;
  Measurement last_;
  std::int64_t k0_ = 0;  // first sample of the session: snapshots count from here
};

class BackgroundLoop {
 public:
  BackgroundLoop(std::shared_ptr<const Filter> filter, GainPolicy policy, int n);

  void reset();
  // Computes K from the snapshot and propagates P with it.
  const Gain& step(const Estimate& snapshot);
  const Gain& last() const { return gain_; }

 private:
  std::shared_ptr<const Filter> filter_;
  GainPolicy policy_;
  int n_;
  Gain gain_;
};

}  // namespace twinrate
