// A set of effects fitted to a record: Gauss-Newton on all their parameters at once, against the
// whitened residual of every channel.
#pragma once
#include <algorithm>
#include <cmath>

#include "trace/dictionary.hpp"

namespace twinrate {

// How well the size of the noise is known: a change of the model that only makes the residual's own
// noise larger or smaller has to bring more than this share of it.
inline double noise_doubt(const EquationEnergy& change) {
  constexpr double kKnownTo = 0.1;
  return kKnownTo * (std::abs(change.electrical) + std::abs(change.torque));
}

// What is left where `explained` has gone: noise may take off too much, for its size is not quite
// known; but what explains more than noise is not passed over for that.
inline double left_of(double rss, double explained, double rows) {
  constexpr double kLeast = 0.3;
  return explained > rows ? std::max(rss, kLeast * rows) : rss;
}

// One free number: a coefficient of the regressors, or a non-linear key.
struct FreeParameter {
  std::size_t member = 0;
  int coefficient = -1;  // -1: a key
  std::string key;
};

using Members = std::vector<std::shared_ptr<Effect>>;

// Copies of all but member `left_out` (kNobody: of all), and of the newcomer where there is one.
inline constexpr std::size_t kNobody = static_cast<std::size_t>(-1);
Members with(const Members& members, const std::shared_ptr<Effect>& newcomer,
             std::size_t left_out = kNobody);

// True where one of them is a second mass behind a shaft, with a gap or without.
bool has_shaft(const Members& members);

// Whether a column of that energy tells the coefficient: one standard deviation is within ten times
// the smallest size worth reporting.
bool tells(const Effect& effect, std::size_t coefficient, double energy, const DriveFacts& facts);

struct Fit {
  Members members;
  std::vector<FreeParameter> free;
  Sampled y;                   // whitened residual with the members in the model
  std::vector<Sampled> J;      // d(explained)/d(free), whitened, where last linearised
  Eigen::MatrixXd covariance;  // of `free`, unit noise
  double rss = 0, rss_held_out = 0;
  double raw_held_out = 0;  // nothing taken off for noise
  double doubt = 0;  // of rss_held_out: noise that the members bring, taken off and not quite known
  bool valid = true;  // parameters stand inside their ranges

  Effects effects() const { return {members.begin(), members.end()}; }
};

// By how much rss would rise, at least, without member m: the largest of its coefficients squared
// over their variances in `covariance`, of fit.free. 0 for a shaft, whose size is in no one key.
double largest_wald(const Fit& fit, const Eigen::MatrixXd& covariance, std::size_t m);

// The same of all its coefficients together, less what as many make by chance: what two of them share
// may be unknown (the common mode of three offsets) and the rest of them far from zero. Its other keys are
// given: where only a dead time over its zone of currents is known, that is not zero.
double joint_wald(const Fit& fit, const Eigen::MatrixXd& covariance, std::size_t m);

class Fitter {
 public:
  // All three must outlive it. The declared model's residual is whitened here, by the noise that the chain has now.
  Fitter(const Chain& chain, const Rows& training, const Rows& held_out);

  Fit start(Members members) const;
  // The same with its columns and their covariance.
  Fit linearised(Members members) const;
  // Gauss-Newton: a few rounds, enough to compare sets, or until it has arrived.
  enum class Until { kComparable, kArrived };
  Fit refine(Members members, Until until = Until::kComparable) const;
  // What an effect must bring beyond its parameters' price; kMargin where the noise is as assumed.
  static constexpr double kMargin = 40;
  double margin() const { return margin_; }
  void set_margin(double margin) { margin_ = margin; }
  // Kinds that the gate refused: no candidate of them is scored.
  void leave_out(std::vector<std::string> kinds) { left_out_ = std::move(kinds); }
  bool leaves_out(const Effect& effect) const {
    return std::find(left_out_.begin(), left_out_.end(), effect.kind()) != left_out_.end();
  }
  double raw_held_out() const { return raw_held_out_; }  // of the declared model
  // Covariance of fit.free that holds where the rest is neither white nor equally large everywhere:
  // from how much pieces of the record disagree (the sandwich of A^-1 with the scores' scatter).
  Eigen::MatrixXd robust_covariance(const Fit& fit) const;
  const Rows& training() const { return training_; }
  const Rows& held_out() const { return held_out_; }
  const Chain& chain() const { return chain_; }

 private:
  EquationEnergy noise_in(const Rows& rows, const Sampled& y) const;
  void evaluate(Fit& fit) const;
  void linearise(Fit& fit) const;
  // Gauss-Newton's step, and by how much it should lower rss.
  Eigen::VectorXd step(Fit& fit, double& promised) const;

  const Chain& chain_;
  const Rows& training_;
  const Rows& held_out_;
  double margin_ = kMargin;
  std::vector<std::string> left_out_;
  Sampled declared_;                       // residual of the declared model
  EquationEnergy noise_, noise_held_out_;  // in it
  double raw_ = 0, raw_held_out_ = 0;      // with it
};

// Whether `other` explains nearly what `one` does beside `both`, on the rows that the fitter trains on: of
// what is left, and of that less the noise which they bring.
bool explains_as_much(const Fitter& fitter, const Members& both, const Members& one,
                      const Members& other);

}  // namespace twinrate
