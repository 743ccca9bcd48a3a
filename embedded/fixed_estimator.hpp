// The firmware's filter on this machine: MEASUREMENT(k) -> ESTIMATE(k), with the background right
// after the fast step. The templates are those of the Cortex-M3, so the numbers are equal bit for
// bit, as long as the background there ends within its period.
#pragma once
#include <cmath>

#include "embedded/fixed_settings.hpp"
#include "firmware/cortex_m3/checked.hpp"

namespace twinrate {

// The answer of the firmware as raw numbers.
struct FixedEstimate {
  std::int32_t i_alpha = 0, i_beta = 0, omega = 0;
  std::uint32_t theta = 0;
  std::int32_t gain_snapshot = -1;
  bool operator==(const FixedEstimate&) const = default;
};
Estimate estimate_of(const FixedEstimate& raw, const Measurement& m, int n_p);

// N: Plain32, Checked32, Plain16 or Checked16.
template <class N, class Q>
class FixedEstimator {
 public:
  explicit FixedEstimator(Config& config)
      : n_p_(config.drive().machine.n_p), settings_(fixed_settings(config)) {
    filter_.start(settings_);
  }
  FixedEstimator(const FixedEstimator&) = delete;
  FixedEstimator& operator=(const FixedEstimator&) = delete;

  const Estimate& tick(const Measurement& m) {
    filter_.fast(static_cast<std::int32_t>(m.k), m3::reading<typename N::Long>(sample_of(m)));
    raw_ = {N::Long::raw(filter_.state().i_alpha), N::Long::raw(filter_.state().i_beta),
            N::Long::raw(filter_.state().omega), filter_.state().theta, filter_.gain_snapshot()};
    estimate_ = estimate_of(raw_, m, n_p_);
    if (filter_.background_due()) filter_.background();
    return estimate_;
  }
  const FixedEstimate& raw() const { return raw_; }
  const m3::TwoRate<N, Q>& filter() const { return filter_; }

 private:
  int n_p_;
  m3::Settings settings_;
  m3::TwoRate<N, Q> filter_;
  FixedEstimate raw_;
  Estimate estimate_;
};

using Fixed32 = FixedEstimator<m3::Plain32, m3::Format32>;
using FixedChecked32 = FixedEstimator<m3::Checked32, m3::Format32>;
using Fixed16 = FixedEstimator<m3::Plain16, m3::Format16>;
using FixedChecked16 = FixedEstimator<m3::Checked16, m3::Format16>;

}  // namespace twinrate
