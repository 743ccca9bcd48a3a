// Everything that could be missing, as groups of whitened columns.
//
// A candidate is one effect with its non-linear keys at one point of their grid; its columns are
// what one unit of each coefficient would explain in all channels.
#pragma once
#include <Eigen/Core>
#include <deque>
#include <functional>
#include <memory>

#include "trace/equations.hpp"
#include "trace/sampler.hpp"
#include "trace/whitening.hpp"

namespace twinrate {

// One regressor, or a residual, at the tracer's rate; channels it does not touch are empty. `noise`
// is what measurement noise of the record's own size makes of it (see Chain).
struct Sampled {
  Eigen::VectorXd d, q, torque;
  Eigen::VectorXd noise_d, noise_q, noise_torque;
};

// Of the three channels.
struct NoiseModel {
  Whitener d, q, torque;
  // By which the added noise falls short of the record's own (1: as it should be).
  double scale_d = 1, scale_q = 1, scale_torque = 1;
};

void add(Sampled& a, const Sampled& b, double factor);  // a += factor b; an empty channel is zero

struct Candidate {
  std::shared_ptr<Effect> effect;
  std::vector<Sampled> columns;
};

// Thrown out of a trace that is stopped.
struct TraceStopped {};

// The chain of one record: equations, low-pass, whitening.
//
// Residual and regressors are made of the same noisy samples: L di/dt holds the noise of the
// residual itself, and plain least squares would shrink L (or J, or everything) until it vanishes.
// So every column is computed twice, from the record and from the record with as much noise again;
// the difference shows what noise does to it, and inner products are taken less its share:
//   <a, b> = a'b - noise_a' noise_b
class Chain {
 public:
  // `noisier`: equations of the record with as much noise added as it has.
  Chain(const Equations& equations, const Equations& noisier, const Sampler& sampler)
      : equations_(equations), noisier_(noisier), sampler_(sampler) {}

  // Asked before every slow step, which throws TraceStopped where the answer is true.
  void stop_when(std::function<bool()> stop) { stop_ = std::move(stop); }
  void checkpoint() const {
    if (stop_ && stop_()) throw TraceStopped{};
  }
  void set_noise(NoiseModel noise) { noise_ = std::move(noise); }
  const NoiseModel& noise() const { return noise_; }
  Sampled residual(const Effects& effects) const;
  Sampled noiseless(const Effects& effects) const;           // the same of the record alone
  std::vector<Sampled> columns(const Effect& effect) const;  // one for each regressor
  Sampled contribution(const Effect& effect) const;
  // One of the two, kept for the next time; valid until the next call.
  enum class What { kColumns, kWhole };
  const std::vector<Sampled>& remembered(const Effect& effect, What what) const;
  Sampled whitened(const Sampled& s) const;
  // A column, whitened, without the channels of which most is noise: what is left after its share
  // is taken off would be worth nothing there.
  Sampled regressor(const Sampled& column) const;
  const Equations& equations() const { return equations_; }
  const Sampler& sampler() const { return sampler_; }

 private:
  struct Remembered {
    What what;
    std::string_view kind;
    std::vector<double> keys;  // where coefficients only multiply: the others
    std::vector<Sampled> columns;
  };
  Sampled sampled(const Channels& clean, const Channels* noisy) const;
  Sampled whole_residual(const Effects& effects) const;
  // False where its coefficients do more than multiply (saturation), or it has none.
  bool is_linear(const Effect& effect) const;

  const Equations& equations_;
  const Equations& noisier_;
  const Sampler& sampler_;
  NoiseModel noise_;
  std::function<bool()> stop_;
  mutable Sampled declared_;               // residual of the declared model
  mutable std::deque<Remembered> memory_;  // the latest last
};

// Impacts come at other moments where there is more noise: the difference is no noise.
bool has_gap(const Effect& effect);
// True where the effect's columns hold the noise of the residual itself.
bool holds_noise(const Effect& effect);

struct Dictionary {
  std::vector<Candidate> sampled, whitened;
  // Columns of what adds to a sensor anew, as they are beside effects in the model: what an error
  // of a current does to the voltage depends on the inductance there.
  void renew(const Chain& chain, const Effects& beside);
  void whiten(const Chain& chain);
};

// Candidates of every kind with traced_keys() that the record's signals allow; `duration`: of the
// record, where time is searched. Columns are sampled, not yet whitened.
std::vector<Candidate> make_candidates(const Chain& chain);

// What noise adds to an inner product.
struct NoiseEnergy {
  double electrical = 0, torque = 0;
  double sum() const { return electrical + torque; }
  NoiseEnergy operator-(const NoiseEnergy& b) const {
    return {electrical - b.electrical, torque - b.torque};
  }
};

// Inner products over the training or the held-out outputs.
class Rows {
 public:
  Rows(const Sampler& sampler, bool held_out);
  // Less the share of noise.
  double dot(const Sampled& a, const Sampled& b) const;
  double noise(const Sampled& a, const Sampled& b) const { return noise_energy(a, b).sum(); }
  NoiseEnergy noise_energy(const Sampled& a, const Sampled& b) const;
  std::size_t count(const Sampled& like) const;
  std::size_t electrical() const { return electrical_; }
  std::size_t torque() const { return torque_; }

 private:
  double dot(const Eigen::VectorXd& a, const Eigen::VectorXd& b,
             const std::vector<std::pair<Eigen::Index, Eigen::Index>>& pieces) const;
  std::vector<std::pair<Eigen::Index, Eigen::Index>> electrical_pieces_, torque_pieces_;
  std::size_t electrical_ = 0, torque_ = 0;
};

// Normal equations A x = b with columns left out (x = 0) that are not excited, or all noise.
struct NormalEquations {
  Eigen::MatrixXd A;
  Eigen::VectorXd b;
  Eigen::VectorXd noise;  // share of noise taken off the diagonal of A

  std::vector<char> usable(double rows) const;
  Eigen::VectorXd solve(const std::vector<char>& use) const;
  Eigen::MatrixXd inverse(const std::vector<char>& use) const;  // zero where left out
};

}  // namespace twinrate
