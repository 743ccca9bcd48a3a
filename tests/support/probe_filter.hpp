// A filter that only records its calls.
#pragma once
#include <vector>

#include "estimator/filter.hpp"

namespace twinrate::test {

class ProbeFilter : public Filter {
 public:
  std::string_view kind() const override { return "probe"; }
  FastState start(const Measurement&) const override {
    ++starts;
    return {};
  }
  Correction fast_step(FastState&, const Measurement& m, const Gain& gain) const override {
    used.push_back({m.k, gain.k});
    return {};
  }
  void predict_over_gap(FastState&, const Measurement& last) const override {
    bridged_from.push_back(last.k);
  }
  void align(FastState& state, double theta_e) const override { state.x_hat[3] = theta_e; }
  Estimate output(const FastState& state, const Measurement&) const override {
    Estimate e;
    e.theta_e = state.x_hat[3];
    return e;
  }
  Gain initial_gain() const override { return {}; }
  Gain background_step(const Gain& previous, const Estimate& snapshot) const override {
    Gain gain = previous;
    gain.k = snapshot.k;
    gain.P(0, 0) = previous.P(0, 0) + 1;  // counts the steps since P_0
    return gain;
  }

  struct Use {
    std::int64_t tick, snapshot;
  };
  mutable std::vector<Use> used;
  mutable std::vector<std::int64_t> bridged_from;
  mutable int starts = 0;
};

}  // namespace twinrate::test
