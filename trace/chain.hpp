// The chain of one record, from effects to what least squares sees: equations, low-pass, whitening.
#pragma once
#include <Eigen/Core>
#include <deque>
#include <functional>
#include <memory>

#include "trace/equations.hpp"
#include "trace/hooks.hpp"
#include "trace/sampler.hpp"
#include "trace/whitening.hpp"

namespace twinrate {

// One regressor, or a residual, at the tracer's rate; channels it does not touch are empty. `noise`
// is what noise of the record's own size makes of it in the readings, `answer` what the drive does
// about that (see Chain).
struct Sampled {
  Eigen::VectorXd d, q, torque;
  Eigen::VectorXd noise_d, noise_q, noise_torque;
  Eigen::VectorXd answer_d, answer_q, answer_torque;
};

// Of the three channels.
struct NoiseModel {
  Whitener d, q, torque;
  // By which the added noise falls short of the record's own (1: as it should be).
  double scale_d = 1, scale_q = 1, scale_torque = 1;
  // The part of the drawn noise that the record holds: its residual beside all columns may be smaller.
  double share_d = 1, share_q = 1, share_torque = 1;
};

void add(Sampled& a, const Sampled& b, double factor);  // a += factor b; an empty channel is zero

// Impacts come at other moments where there is more noise: the difference is no noise.
bool has_gap(const Effect& effect);
bool is_shaft(const Effect& effect);
// A shaft, or what is a load behind it where there is one.
bool is_of_shaft(const Effect& effect);

// Residual and regressors are made of the same noisy samples: L di/dt holds the noise of the
// residual itself, and plain least squares would shrink L (or J, or everything) until it vanishes.
// So every column is computed again from the record with as much noise again: the difference shows
// what noise does to it, and inner products are taken less its share.
//
// The controller answers noise, and the currents that it drives are in the columns. They are no
// error there, and they are not in the residual of a model that is right: whatever the drive
// answers obeys the equations. But they come of the noise that is. With a, b columns and y the
// residual
//   <a, b> = a'b - noise_a' noise_b - (answer_a' noise_b + noise_a' answer_b) / 2
//   <a, y> = a'y - (noise_a + answer_a)' noise_y
// No answer is counted through a dead time, some 30 Ohm around a current of zero that the answer
// was computed without, nor of a shaft in a fit, where the product would be chance alone.
class Chain {
 public:
  // Equations of the record with as much noise added as it has: `answered` by the drive, and to the
  // readings alone.
  Chain(const Equations& equations, const Equations& answered, const Equations& readings,
        const Sampler& sampler)
      : equations_(equations), answered_(answered), readings_(readings), sampler_(sampler) {}

  // Asked before every slow step, which throws TraceStopped where the answer is true.
  void stop_when(std::function<bool()> stop) { stop_ = std::move(stop); }
  void checkpoint() const {
    if (stop_ && stop_()) throw TraceStopped{};
  }
  // Where an encoder rounds: makes the record with its counts moved (with_moved_counts).
  void set_moved_counts(std::function<Record()> make) { moved_counts_ = std::move(make); }
  // What these make of a residual, as noise; empty where no encoder rounds.
  Sampled rounding(const Effects& effects) const;
  void set_noise(NoiseModel noise) { noise_ = std::move(noise); }
  const NoiseModel& noise() const { return noise_; }
  // Several act on the command (equations.hpp), with those known: not one by one.
  bool commands(const Effects& effects) const;
  // There are a shaft and a load behind it, with those known: what one does goes through the other.
  bool loads_shaft(const Effects& effects) const;
  Sampled residual(const Effects& effects) const;
  Sampled noiseless(const Effects& effects) const;           // the same of the record alone
  std::vector<Sampled> columns(const Effect& effect) const;  // one for each regressor
  // The same of other equations of this record, without what noise makes of them.
  std::vector<Sampled> columns_of(const Equations& equations, const Effect& effect) const;
  Sampled contribution(const Effect& effect) const;
  // The same in a fit: a shaft's without its answer.
  Sampled contribution_to_fit(const Effect& effect) const;
  // columns(), kept for the next time; valid until the next call.
  const std::vector<Sampled>& remembered_columns(const Effect& effect) const;
  Sampled whitened(const Sampled& s) const;
  // A column, whitened, without the channels of which most is noise: what is left after its share
  // is taken off would be worth nothing there.
  Sampled regressor(const Sampled& column) const;
  const Equations& equations() const { return equations_; }
  const Equations& readings() const { return readings_; }  // of the record with noise on them
  const Equations& answered() const { return answered_; }  // and what the drive makes of it
  const Sampler& sampler() const { return sampler_; }

 private:
  struct Remembered {
    std::string what;
    std::vector<double> keys;  // of its effects
    std::vector<Sampled> columns;
  };
  // An effect but for coefficients that only multiply.
  Remembered shape_of(const char* what, const Effect& effect) const;
  const std::vector<Sampled>& recall(Remembered wanted,
                                     const std::function<std::vector<Sampled>()>& make) const;
  Sampled sampled(const Channels& clean) const;
  Sampled sampled(const Channels& clean, const Channels& read, const Channels& answered) const;
  Sampled whole_residual(const Effects& effects) const;
  // False where its coefficients do more than multiply (saturation), or it has none.
  bool is_linear(const Effect& effect) const;

  const Equations& equations_;
  const Equations& answered_;
  const Equations& readings_;
  const Sampler& sampler_;
  NoiseModel noise_;
  std::function<bool()> stop_;
  std::function<Record()> moved_counts_;
  mutable std::deque<Remembered> memory_;  // the latest last
};

// True where the effect's columns are periodic in the angle.
bool turns_with_angle(const Effect& effect);
// True where they are other ones where a current crosses zero at another moment. Its slope there is
// some 30 Ohm: the drive answers far less through it than through the winding alone.
bool turns_at_zero(const Effect& effect);
// True where the effect's columns hold the noise of the residual itself.
bool holds_noise(const Effect& effect);

}  // namespace twinrate
