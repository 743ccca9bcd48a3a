// The scaffolding of an extended Kalman filter with NX states and NY outputs. A new filter is its
// equations: prior(), innovation(), describe() and the Jacobians of background_step().
//
// Fast step, every T_s, with a given K:
//
//   x^-   = prior(x, m)                                prediction under the voltage of m
//   innov = innovation(x^-, m)                         y - h(x^-)
//   x     = wrapped(x^- + K innov)
//
// A sample is missing: x = wrapped(prior(x, last)).
// Background step: covariance_step() of estimator/covariance.hpp with F, H and the tuning below.
//
// A correction that is not finite is left out: the state keeps the prediction, status kNotFinite. A
// prediction that is not finite is left out, too. No allocation on these paths.
#pragma once
#include "estimator/covariance.hpp"
#include "estimator/filter.hpp"

namespace twinrate {

// Takes `x` over into the state; if it is not finite, `x_prior`, if that is finite.
template <class State, class Prior, class Output>
Correction take_over(FastState& state, const State& x, const Prior& x_prior, const Output& innov) {
  Correction correction;
  if (x.allFinite()) {
    state.x_hat.head(x.size()) = x;
    correction.innov.head(innov.size()) = innov;
    return correction;
  }
  if (x_prior.allFinite()) state.x_hat.head(x_prior.size()) = x_prior;
  correction.status = kNotFinite;
  return correction;
}

// `snapshot` after the rotor has turned by `angle`: theta_e and the leading (alpha, beta) pairs.
inline Estimate turned(const Estimate& snapshot, int pairs, double angle) {
  Estimate e = snapshot;
  for (int i = 0; i < 2 * pairs; i += 2)
    e.x_hat.segment<2>(i) = rotate(Vec2(snapshot.x_hat.segment<2>(i)), angle);
  e.theta_e = snapshot.theta_e + angle;
  return e;
}

// N_EXTRA: 0, or 2 numbers after the state in x_hat: u_dq of the last period, which the background
// needs.
template <int NX, int NY, int N_EXTRA = 0>
class Ekf : public Filter {
 public:
  using State = Eigen::Matrix<double, NX, 1>;
  using Output = Eigen::Matrix<double, NY, 1>;
  using Covariance = Eigen::Matrix<double, NX, NX>;
  using GainMatrix = Eigen::Matrix<double, NX, NY>;
  using OutputMatrix = Eigen::Matrix<double, NY, NX>;  // H = dh/dx

  explicit Ekf(const EkfTuning<NX, NY>& tuning) : tuning_(tuning) {}

  Correction fast_step(FastState& state, const Measurement& m, const Gain& gain) const override {
    return fast_step_of(*this, state, m, gain);
  }

  void predict_over_gap(FastState& state, const Measurement& last) const final {
    const State x_prior = prior(state, last);
    const State x = wrapped(x_prior);
    if (x.allFinite()) state.x_hat.template head<NX>() = x;
    remember(state, x_prior, last, false);
  }

  Estimate output(const FastState& state, const Measurement& m) const final {
    Estimate e;
    e.n_x = NX + N_EXTRA;
    e.n_y = NY;
    describe(state, m, e);
    return e;
  }

  int voltage_state() const final { return N_EXTRA > 0 ? NX : -1; }
  Gain initial_gain() const final { return first_gain(tuning_.P0_diag, NY); }

 protected:
  // fast_step() with the equations of `f`. A filter that is final and passes itself needs no virtual
  // call in it.
  template <class Equations>
  static Correction fast_step_of(const Equations& f, FastState& state, const Measurement& m,
                                 const Gain& gain) {
    const State x_prior = f.prior(state, m);
    const Output innov = f.innovation(x_prior, m);
    const State x = f.wrapped(x_prior + gain.K.template topLeftCorner<NX, NY>() * innov);
    Correction correction;
    if (x.allFinite()) {
      state.x_hat.template head<NX>() = x;
      correction.innov.template head<NY>() = innov;
    } else {
      correction = take_over(state, x, f.wrapped(x_prior), innov);
    }
    f.remember(state, x_prior, m, correction.status == 0);
    return correction;
  }

  // x^- at t_k from the state at t_{k-1}.
  virtual State prior(const FastState& state, const Measurement& m) const = 0;
  virtual Output innovation(const State& x_prior, const Measurement& m) const = 0;
  // theta_e, omega_m, i_dq of the state.
  virtual void describe(const FastState& state, const Measurement& m, Estimate& e) const = 0;
  // Angles of the state in [0, 2 pi).
  virtual State wrapped(const State& x) const { return x; }
  // Further memory of the filter, after each step; `corrected`: x was corrected.
  virtual void remember(FastState&, const State& /*x_prior*/, const Measurement&,
                        bool /*corrected*/) const {}

  const EkfTuning<NX, NY>& tuning() const { return tuning_; }

 private:
  EkfTuning<NX, NY> tuning_;
};

}  // namespace twinrate
