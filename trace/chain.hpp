// The chain of one record from effects to the signals of the least squares: equations, low-pass,
// whitening.
#pragma once
#include <Eigen/Core>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>

#include "trace/equations.hpp"
#include "trace/hooks.hpp"
#include "trace/sampler.hpp"
#include "trace/whitening.hpp"

namespace twinrate {

// One regressor, or a residual, at the tracer's rate. A channel that it does not act on is empty.
// `noise` is the change that added noise of the record's own size makes. `answer` is the further
// change if the drive responds to that noise (see Chain).
struct Sampled {
  Eigen::VectorXd d, q, torque;
  Eigen::VectorXd noise_d, noise_q, noise_torque;
  Eigen::VectorXd answer_d, answer_q, answer_torque;
};

// Noise of the three channels.
struct NoiseModel {
  Whitener d, q, torque;
  // Whitens what the sensors' noise is in the torque, whatever else the residual holds.
  AngleNoise sensors;
  // Factor by which the added noise is smaller than the record's own (1: equal).
  double scale_d = 1, scale_q = 1, scale_torque = 1;
  // Share of the drawn noise that the record holds: less than 1 if its residual with all columns
  // fitted is smaller.
  double share_d = 1, share_q = 1, share_torque = 1;
};

void add(Sampled& a, const Sampled& b, double factor);  // a += factor b; an empty channel is zero

// A shaft with a gap. With added noise its impacts come at other moments, so the difference of the
// two computations does not measure the noise.
bool has_gap(const Effect& effect);
bool is_shaft(const Effect& effect);
// A shaft whose resonance is below that of most shafts.
bool is_slow_shaft(const Effect& effect);
// A kind that changes the inertia at the motor.
bool changes_inertia(const Effect& effect);
// A shaft, or a load that acts behind the shaft of a drive with one.
bool is_of_shaft(const Effect& effect);

// Residual and regressors come from the same noisy samples. L di/dt holds the noise of the residual
// itself, so plain least squares would shrink L (or J, or every parameter) towards zero. So every
// column is computed again from the record with noise of the same size added. The difference is the
// noise of the column, and its share is subtracted from inner products.
//
// The controller responds to noise, and the currents that it drives are in the columns. They are no
// error there: the measured current that the drive causes obeys the equations, so it is not in the
// residual of a correct model. But they correlate with the noise. With a, b columns and y the
// residual
//   <a, b> = a'b - noise_a' noise_b - (answer_a' noise_b + noise_a' answer_b) / 2
//   <a, y> = a'y - (noise_a + answer_a)' noise_y
// The answer is left out in two cases. A dead time has a slope of some 30 Ohm around zero current,
// and the answer was computed without it. A shaft in a fit would make a product of chance alone.
class Chain {
 public:
  // Equations of the record with added noise of its own size: `answered` with the response of the
  // drive, `readings` with noise on the readings alone.
  Chain(const Equations& equations, const Equations& answered, const Equations& readings,
        const Sampler& sampler)
      : equations_(equations), answered_(answered), readings_(readings), sampler_(sampler) {}

  // `stop` is called before every slow step, by one thread at a time; if it returns true, the step
  // throws TraceStopped.
  void stop_when(std::function<bool()> stop) { stop_ = std::move(stop); }
  void checkpoint() const {
    const std::lock_guard lock(stop_mutex_);
    if (stop_ && stop_()) throw TraceStopped{};
  }
  // If an encoder rounds: makes the record with moved counts (with_moved_counts).
  void set_moved_counts(std::function<Record()> make) { moved_counts_ = std::move(make); }
  // The residual's noise from the rounding under `effects`; empty if no encoder rounds.
  Sampled rounding(const Effects& effects) const;
  // Change of the residual torque by noise of the readings under `effects` with a gap, which the
  // residual's own noise leaves out; empty without a gap.
  Eigen::VectorXd impacts_noise(const Effects& effects) const;
  void set_noise(NoiseModel noise) { noise_ = std::move(noise); }
  const NoiseModel& noise() const { return noise_; }
  // True if several effects, with the known ones, act on the command (equations.hpp). Their
  // contributions do not add up.
  bool commands(const Effects& effects) const;
  // True if there are a shaft and a load behind it, with the known effects: they act through each
  // other.
  bool loads_shaft(const Effects& effects) const;
  Sampled residual(const Effects& effects) const;
  Sampled noiseless(const Effects& effects) const;           // without noise and answer
  std::vector<Sampled> columns(const Effect& effect) const;  // one for each regressor
  // The same with other equations of this record, without noise and answer.
  std::vector<Sampled> columns_of(const Equations& equations, const Effect& effect) const;
  Sampled contribution(const Effect& effect) const;
  // The same for a fit: a shaft's contribution has no answer.
  Sampled contribution_to_fit(const Effect& effect) const;
  // columns() from a cache. This and the residuals can be called by several threads.
  using Columns = std::shared_ptr<const std::vector<Sampled>>;
  Columns remembered_columns(const Effect& effect) const;
  Sampled whitened(const Sampled& s) const;
  // The same, but the torque after the filter that whitens its noise from the sensors, scaled to
  // that noise, whatever else the residual holds. Equals whitened() if they have no noise.
  Sampled in_sensors(const Sampled& s) const;
  // A whitened column. A channel in which most of the energy is noise becomes zero, because nothing
  // useful remains after its share is subtracted.
  Sampled regressor(const Sampled& column) const;
  const Equations& equations() const { return equations_; }
  const Equations& readings() const { return readings_; }  // with noise on the readings
  const Equations& answered() const { return answered_; }  // with noise and the drive's response
  const Sampler& sampler() const { return sampler_; }

 private:
  struct Remembered {
    std::string what;
    std::vector<double> keys;  // of its effects
    Columns columns;
  };
  // An effect apart from coefficients that only multiply.
  Remembered shape_of(const char* what, const Effect& effect) const;
  Columns recall(Remembered wanted, const std::function<std::vector<Sampled>()>& make) const;
  Sampled sampled(const Channels& clean) const;
  Sampled sampled(const Channels& clean, const Channels& read, const Channels& answered) const;
  Sampled whole_residual(const Effects& effects) const;
  // False if its coefficients do more than multiply (saturation), or if it has none.
  bool is_linear(const Effect& effect) const;

  const Equations& equations_;
  const Equations& answered_;
  const Equations& readings_;
  const Sampler& sampler_;
  NoiseModel noise_;
  std::function<bool()> stop_;
  mutable std::mutex stop_mutex_;
  std::function<Record()> moved_counts_;
  mutable std::deque<Remembered> memory_;  // the latest last
  mutable std::mutex memory_mutex_;
};

// True if the effect's columns are periodic in the angle and it adds to no sensor.
bool turns_with_angle(const Effect& effect);
// True if the effect's columns depend on the moment at which a current crosses zero. The slope
// there is some 30 Ohm: the drive responds far less through it than through the winding alone.
bool turns_at_zero(const Effect& effect);
// True if the effect's columns hold the noise of the residual itself.
bool holds_noise(const Effect& effect);

}  // namespace twinrate
