// What a claim must pass before anybody is told of it.
//
// A claim is a member of the fit. It passes where
//   sensors    it is larger than what the sensors, and what the log leaves open of the voltage's frame,
//              can make (set_resolution)
//   transfer   it lowers the error on rows that judge (trace/split.hpp): per piece b of them,
//              r_b = 1/2 ln(E_b without / E_b with), E the whitened energy of the channels that it
//              moves, nothing taken off for noise. As many pieces as eight a block, each with as
//              much of the time and of what the claim changes, half and half: one that acts at a
//              few moments speaks there. Less what falls because the claim makes the sensors' noise
//              smaller: of less inertia at the motor an angle's counts make less torque, and the
//              likelihood is one of readings, not of residuals. All pieces together must fall by
//              more than that noise does, and without the claim they must have more energy than the
//              sensors' noise, three times as much for a lag, which the loop's late answer to that
//              noise resembles. A claim that holds no noise and cannot choose its frequency may
//              stand 12 deviations out of that noise instead, along what it changes. A shaft without
//              a gap, or less inertia, must take more than it would off an error of the angle, and
//              at most frequencies (trace/angle_error.hpp); what a claim changes of the voltages
//              must be more than what it changes of the noise in them and of the controller's answer
//              to it. Both sides are fitted to all rows that do not judge.
//              Signed-rank test over the pieces that move, by Holm over the claims; no file may be
//              worse by the same test
//   agreement  its size from one part of the data keeps half the gain of another part's own: halves
//              in time, odd and even blocks, the record's rate and half of it
//   alone      its contribution to the residual stays the same, to a fifth, without the refused claims. One that
//              takes on their part has no known size
//   size       it is worth reporting, and twice its deviation, that between the rates included
//   physical   the machine that it leaves is this machine, within the bounds by which log and drive
//              file belong together (trace/scale_bounds.hpp), and it is as large as its kind can be;
//              a shaft has a resonance.
//              A claim beyond that is refused and no more is said
//   sign       of a torque: the log shows the sign of the motor's own (trace/consistency.hpp)
//   slip       no slip of the user explains its equation as well (trace/slips.hpp)
//   whole      all accepted together lower the error in each file and equation that they act on
// That they also predict better than "nothing changes" is no rule but is told: at constant speed
// and current nothing does change from row to row, and the best model predicts no better.
// One that fails is dropped, the weakest first, and the others are fitted and asked again.
#pragma once
#include <functional>

#include "trace/half_rate.hpp"
#include "trace/result.hpp"
#include "trace/selection.hpp"
#include "trace/split.hpp"

namespace twinrate {

// Thresholds of the gate, chosen by design. None is ablated yet, and none was set by a log.
struct Criterion {
  double chance = 1e-3;     // of a false claim in a log, by the signed-rank test
  int votes = 8;            // pieces that must move; it takes 10 that all fall to meet `chance`
  double silent = 1e-3;     // share of a piece's energy: one that changes by less does not vote
  double kept = 0.5;        // of a part's own gain, that another part's answer must keep
  double moved = 0.2;       // of a claim's contribution, without the refused ones
  double sigmas = 4;        // deviations from which a part is moved by a claim
  double size_sigmas = 2;   // deviations, in all, that a claim must be large
  double times_left = 4;    // power that claims on points take, over what none explains
  double least_left = 0.1;  // share of J, psi_f, R_s, L_d or L_q, beside kThisMachine's bounds
};

// What the rows that judge say of one member.
struct Judgement {
  double held_out_gain = 0;  // share of the error without it, raw
  double fitted_gain = 0;    // the same on rows that do not judge; of points alone
  double p_value = 1;        // of the signed-rank test
  int votes = 0;
  double kept = 1;  // least share of a part's own gain
};

// The least that an effect leaves of a parameter of the machine, as a share, and of which; 1, "":
// it changes none.
std::pair<double, const char*> least_left(const Effect& effect, const MachineParameters& machine);

struct Passed {
  Fit fit;                        // of the members that passed, on all rows that do not judge
  std::vector<std::size_t> kept;  // their places among the members asked
  std::vector<Judgement> judgements;
  std::vector<Refused> refused;
};

class Gate {
 public:
  // `seen`: fits rows that do not judge. `whole`: the chain of all rows, under the same noise.
  Gate(const Fitter& seen, const Chain& whole, JudgedFiles files, const Criterion& criterion = {})
      : seen_(seen), whole_(whole), files_(std::move(files)), criterion_(criterion) {}
  // Made when a claim first needs it.
  void set_half_rate(std::function<const HalfRate&()> make) { half_rate_ = std::move(make); }
  // Smallest claim beyond what the sensors make of nothing, in sizes worth reporting.
  void set_resolution(std::function<double(const Effect&)> resolution) {
    resolution_ = std::move(resolution);
  }
  // A doubt of the drive file or of the log's signals, asked for once a claim has passed all else.
  struct Doubt {
    const char* rule;
    std::string text;
    bool of_voltage, of_torque;  // equations whose claims it is against
    bool of_frame;               // also against what turns in rotor axes
  };
  void set_doubts(std::function<std::vector<Doubt>()> doubts) { doubts_ = std::move(doubts); }
  Passed operator()(const Members& members) const;

 private:
  struct Asked;  // the members together, and each left out
  Asked ask(const Fit& fit) const;
  std::vector<Refused> refusals(const Asked& asked) const;
  std::optional<Refused> whole_refusal(const Asked& asked, std::size_t& weakest) const;
  std::optional<Refused> moved_refusal(const Members& all, const Passed& passed,
                                       std::size_t& most) const;

  const Fitter& seen_;
  const Chain& whole_;
  JudgedFiles files_;
  Criterion criterion_;
  std::function<const HalfRate&()> half_rate_;
  std::function<double(const Effect&)> resolution_;
  std::function<std::vector<Doubt>()> doubts_;
};

}  // namespace twinrate
