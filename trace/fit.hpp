// A set of effects fitted to a record: Gauss-Newton on all their parameters at once, against the
// whitened residual of every channel.
#pragma once
#include <algorithm>
#include <cmath>
#include <optional>

#include "trace/dictionary.hpp"

namespace twinrate {

// Uncertainty of the noise that a change of the model adds or removes, whose size is known to a
// tenth. A change that only alters the residual's own noise must lower the error by more than this.
inline double noise_doubt(const EquationEnergy& change) {
  constexpr double kKnownTo = 0.1;
  return kKnownTo * (std::abs(change.electrical) + std::abs(change.torque));
}

// `rss` after the subtraction of noise. The subtraction may be too large, because the size of the
// noise is not exactly known. A model that explains more than noise (`explained` > `rows`) is not
// refused for that: at least a share of `rows` remains.
inline double left_of(double rss, double explained, double rows) {
  constexpr double kLeast = 0.3;
  return explained > rows ? std::max(rss, kLeast * rows) : rss;
}

// One free parameter: a coefficient of the regressors, or a non-linear key.
struct FreeParameter {
  std::size_t member = 0;
  int coefficient = -1;  // -1: a key
  std::string key;
};

using Members = std::vector<std::shared_ptr<Effect>>;

// Copies of all members but `left_out` (kNobody: of all), and of the newcomer if there is one.
inline constexpr std::size_t kNobody = static_cast<std::size_t>(-1);
Members with(const Members& members, const std::shared_ptr<Effect>& newcomer,
             std::size_t left_out = kNobody);

// True if one of them is a second mass behind a shaft, with a gap or without.
bool has_shaft(const Members& members);

// True if a column of that energy determines the coefficient: one standard deviation is less than
// ten times the smallest size worth reporting.
bool tells(const Effect& effect, std::size_t coefficient, double energy, const DriveFacts& facts);

struct Fit {
  Members members;
  std::vector<FreeParameter> free;
  Sampled y;                   // whitened residual with the members in the model
  std::vector<Sampled> J;      // d(explained)/d(free), whitened, at the last linearisation
  Eigen::MatrixXd covariance;  // of `free`, unit noise
  double rss = 0, rss_held_out = 0;
  double raw_held_out = 0;  // no noise subtracted
  double doubt = 0;   // of rss_held_out: uncertainty of the subtracted noise that the members bring
  bool valid = true;  // parameters are inside their ranges, rss > 0

  Effects effects() const { return {members.begin(), members.end()}; }
};

// Least rise of rss without member m: the largest ratio of a squared coefficient to its variance in
// `covariance`, of fit.free. For an effect without coefficients, of a squared key. 0 for a shaft,
// whose size is not that of one key.
double largest_wald(const Fit& fit, const Eigen::MatrixXd& covariance, std::size_t m);

// The same of all its n coefficients together, less n - 1, the mean of n - 1 by chance; at least 0. None if
// `covariance` has none of its sizes: they are given, or the effect is a shaft. A common
// part of them may be undetermined (the common mode of three offsets) and the remainder far from
// zero. Its other keys are given: if the record determines only the ratio of a dead time to its
// zone of currents, that ratio is far from zero.
std::optional<double> joint_wald(const Fit& fit, const Eigen::MatrixXd& covariance, std::size_t m);

class Fitter {
 public:
  // All three must outlive it. The residual of the declared model is whitened here, by the chain's
  // present noise model.
  Fitter(const Chain& chain, const Rows& training, const Rows& held_out);

  Fit start(Members members) const;
  // The same, with the columns and their covariance.
  Fit linearised(Members members) const;
  // Gauss-Newton: a few rounds, which are enough to compare sets, or until it has converged.
  enum class Until { kComparable, kArrived };
  Fit refine(Members members, Until until = Until::kComparable) const;
  // Gain in score that an effect needs beyond the price of its parameters; kMargin if the noise is
  // as assumed.
  static constexpr double kMargin = 40;
  double margin() const { return margin_; }
  void set_margin(double margin) { margin_ = margin; }
  // Kinds that the gate refused: no candidate of them is scored.
  void leave_out(std::vector<std::string> kinds) { left_out_ = std::move(kinds); }
  bool leaves_out(const Effect& effect) const {
    return std::find(left_out_.begin(), left_out_.end(), effect.kind()) != left_out_.end();
  }
  double raw_held_out() const { return raw_held_out_; }  // of the declared model
  // Covariance of fit.free for a residual that is neither white nor of constant size, from the
  // disagreement of pieces of the record (sandwich of A^-1 with the scatter of the scores).
  Eigen::MatrixXd robust_covariance(const Fit& fit) const;
  const Rows& training() const { return training_; }
  const Rows& held_out() const { return held_out_; }
  const Chain& chain() const { return chain_; }

 private:
  EquationEnergy noise_in(const Rows& rows, const Sampled& y) const;
  void evaluate(Fit& fit) const;
  void linearise(Fit& fit) const;
  // Gauss-Newton's step; `promised`: the fall of rss that it predicts.
  Eigen::VectorXd step(Fit& fit, double& promised) const;

  const Chain& chain_;
  const Rows& training_;
  const Rows& held_out_;
  double margin_ = kMargin;
  std::vector<std::string> left_out_;
  Sampled declared_;                       // residual of the declared model
  EquationEnergy noise_, noise_held_out_;  // noise in it
  double raw_ = 0, raw_held_out_ = 0;      // its energy, noise included
};

// True if `other` explains nearly as much as `one` on the training rows, each relative to the set
// `both`. Must hold for the raw error, and for the error less the noise that the members bring.
bool explains_as_much(const Fitter& fitter, const Members& both, const Members& one,
                      const Members& other);

}  // namespace twinrate
