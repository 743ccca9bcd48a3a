// The interface of every filter: a fast step at f_s and a background step at f_b, both pure.
//
//   fast step         x_hat(k), innov <- predict x_hat(k-1) under the voltage that was applied,
//                                        correct with a given K
//   background step   K, P            <- linearise at a snapshot of x_hat, propagate P once
//
// A filter holds constant parameters only. All state travels through the arguments, so that one
// process, five processes and a replay compute the same numbers. No allocation, no clock and no I/O
// on these paths.
#pragma once
#include <memory>
#include <optional>
#include <string_view>

#include "estimator/emf_angle.hpp"
#include "estimator/gain_slots.hpp"
#include "estimator/known_effects.hpp"
#include "model/math.hpp"
#include "model/rotor_axes.hpp"
#include "model/signals.hpp"

namespace twinrate {

// Of 24 starts within 75 deg none was lost below the filter's limit of n. From a larger angle the
// filter can settle on the mirrored state (docs/theory/start-up.md).
inline constexpr double kStartWithin = 75 * kPi / 180;

// The fast loop's memory of one filter.
struct FastState {
  Eigen::Matrix<double, kMaxStates, 1> x_hat = Eigen::Matrix<double, kMaxStates, 1>::Zero();
  bool reduced = false;           // ekf_disturbance: runs without voltages
  double theta_m_prev = 0;        // filters that use a position sensor: its last sample
  Vec2 i_dq_prev = Vec2::Zero();  // filters whose inputs are currents: their last sample
  EmfAngle emf_angle;             // filters of a back-EMF: angle and speed processing
  RotorAxes rotor_axes;           // ekf_sensorless: of its angle, from one tick to the next
};

// Result of a fast step besides the state.
struct Correction {
  Eigen::Matrix<double, kMaxOutputs, 1> innov = Eigen::Matrix<double, kMaxOutputs, 1>::Zero();
  int status = 0;  // kNotFinite: the correction was left out, the prediction kept
};

// Matrices of one background step: F = df/dx, H = dh/dx, process and measurement noise.
struct CovarianceModel {
  using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxStates, kMaxStates>;
  using Outputs = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxOutputs, kMaxStates>;
  using Vector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxStates, 1>;
  Matrix F;
  Outputs H;
  Vector Q_diag, R_diag;
};

class Filter {
 public:
  virtual ~Filter() = default;
  virtual std::string_view kind() const = 0;

  // State after the first sample of a session: the measured quantities, without a correction.
  virtual FastState start(const Measurement& first) const = 0;
  // Prediction from t_{k-1} to t_k with the inputs of `m`, then correction with the K of `gain`.
  virtual Correction fast_step(FastState& state, const Measurement& m, const Gain& gain) const = 0;
  // Handles a missing sample: only prediction, with the inputs of the last sample.
  virtual void predict_over_gap(FastState& state, const Measurement& last) const = 0;
  // Alignment: the rotor is held at this electrical angle. Filters with a position sensor ignore
  // it.
  virtual void align(FastState&, double /*theta_e*/) const {}
  // Output equation: n_x, n_y, the named quantities. `m`: the sample to which the state belongs.
  virtual Estimate output(const FastState& state, const Measurement& m) const = 0;
  // The same in place at every tick, except k, t_ns, gain_seq, x_hat and innov. An override saves
  // the copy of an Estimate, and can keep values for its next step.
  virtual void output_of_tick(FastState& state, const Measurement& m, Estimate& e) const {
    e = output(state, m);
  }
  // output() with the state itself.
  Estimate estimate_of(const FastState& state, const Measurement& m) const {
    Estimate e = output(state, m);
    e.x_hat = state.x_hat;
    return e;
  }

  // The sample for the equations of this filter: without the known effects that they do not
  // contain. `last` and `before`: estimate and measurement of the tick before.
  Measurement seen(const Measurement& m, const Estimate& last, const Measurement& before) const {
    return known_.none() ? m : known_.seen(m, last, before);
  }
  // True if seen() changes nothing.
  bool sees_all() const { return known_.none(); }
  void know(const KnownEffects& known) { known_ = known; }

  // True if T_load of the output is an estimate, not 0.
  virtual bool estimates_load() const { return false; }

  // Known limits of the filter, for a check before the run (loop/runnable.hpp).
  //
  // Largest electrical angle, rad, between the rotor and the start of the filter that a start from
  // standstill without alignment corrects; 0: none. docs/theory/two-rate-ekf.md has the measured
  // starts.
  virtual double direct_start_within() const { return kPi; }
  // Smallest electrical speed, rad/s, at which the filter observes the load if a part `u_unknown`,
  // V, of the voltage is unknown. Empty: the load is no state.
  virtual std::optional<double> load_speed_min(double /*u_unknown*/) const { return {}; }

  virtual Gain initial_gain() const = 0;  // K = 0, P = P_0
  // The same for the form without voltages (kNoVoltage), if the filter has one.
  virtual Gain initial_gain_without_voltage() const { return initial_gain(); }
  // One update of covariance and gain from the snapshot; `previous` holds P.
  virtual Gain background_step(const Gain& previous, const Estimate& snapshot) const = 0;
  // The same in place: a filter that overrides it saves two copies of a Gain, 6 kB each.
  virtual void update_gain(Gain& gain, const Estimate& snapshot) const {
    copy_gain(gain, background_step(gain, snapshot));
  }

  // Properties of the filter for the gain policies. The defaults are those of a filter in rotor
  // axes whose gain does not depend on the angle.
  //
  // Number of leading pairs of states (alpha, beta) that turn with the rotor in the filter's frame;
  // the first two outputs then turn, too. K at another angle: estimator/gain_frame.hpp.
  virtual int turning_pairs() const { return 0; }
  // Index in x_hat of u_dq of the last period, in the rotor axes of its middle; -1: it has none.
  virtual int voltage_state() const { return -1; }
  // The snapshot, predicted `ticks` ahead at constant speed.
  virtual Estimate ahead(const Estimate& snapshot, double /*ticks*/) const { return snapshot; }
  // Steady state without load at this speed, theta_e = 0: the operating point of a row of the table
  // of policy `scheduled`. Empty: no table for this filter.
  virtual std::optional<Estimate> steady_state(double /*omega_m*/) const { return {}; }
  // Matrices of background_step() at this snapshot, with which many steps at one operating point
  // need no loop (GainSchedule). Empty: the steps are computed one after the other.
  virtual std::optional<CovarianceModel> covariance_model(const Estimate& /*snapshot*/) const {
    return {};
  }
  // `ticks` background steps at this speed from the P of `gain`, one a tick, all in rotor axes
  // (theta_e = 0). Requires a steady state. This default runs one step after the other.
  virtual Gain background_steps(const Gain& gain, double omega_m, int ticks) const;

 protected:
  const KnownEffects& known() const { return known_; }

 private:
  KnownEffects known_;
};

}  // namespace twinrate
