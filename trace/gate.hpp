// The conditions that a claim must meet to be reported.
//
// A claim is a member of the fit. It passes if
//   sensors    it is larger than an error of the sensors, or the uncertainty of the voltage's frame
//              in the log, can make (set_resolution)
//   transfer   it lowers the error on the judging rows (trace/split.hpp). The vote of piece b is
//              r_b = 1/2 ln(E_b without / E_b with), E the whitened energy of the channels that the
//              claim changes, no noise subtracted. There are eight pieces for each block of a file.
//              The size of a piece is half its share of the time and half its share of the claim's
//              change, so that a claim that acts at a few moments has pieces there.
//              The fall of the sensors' noise by the claim is subtracted: with less inertia at the
//              motor the counts of an angle make less torque, and the likelihood is that of
//              readings, not of residuals. The energy of all pieces together must fall by more than
//              that noise does.
//              Without the claim the rows must have more energy than the sensors' noise: three
//              times as much for a lag, because the loop's late response to that noise resembles
//              one. A claim that holds no noise and cannot fit a frequency of it may instead be 12
//              standard deviations above that noise, in the projection on its change.
//              A claim that lowers the inertia at the motor must lower the energy by more than it
//              would lower that of an error of the angle; a claim without a gap also in the mean
//              over frequencies (trace/angle_error.hpp). A claim's change of the voltages must
//              be far larger than its change of their noise and of the controller's response to
//              it.
//              Both models are fitted to all rows that do not judge. Signed-rank test over the
//              pieces that vote, Holm over the claims; no file may be worse by the same test
//   agreement  its size from one part of the data keeps half the gain of another part's own size:
//              halves in time, odd and even blocks, the record's rate and half of it
//   alone      its contribution to the residual changes by at most a fifth without the refused
//              claims. A claim that takes over their part has no known size
//   size       it reaches the smallest size worth reporting, and two standard deviations, which
//              include the difference between the rates
//   physical   the machine with it is still this machine, within the bounds by which log and drive
//              file belong together (trace/scale_bounds.hpp), and it is not larger than its kind
//              can be. A shaft has a resonance. A load step is not at an equal or larger step of
//              the known load
//   law        of a torque by speed: no other power of the speed explains the torque better than it,
//              alone or with others. Load steps do not follow the reversals of the motion, as a
//              friction does (trace/speed_law.hpp)
//   sign       of a torque: the log shows the sign of the motor's own (trace/consistency.hpp)
//   slip       no slip of the user explains its equation as well (trace/slips.hpp)
//   whole      all accepted claims together lower the error in each file and equation on which they
//              act. Where more than 1.5 times the noise floor of the voltage is left, the weakest
//              claim explains a tenth of that error's energy above the floor
// Whether they also predict better than "nothing changes" is reported but is no condition: at
// constant speed and current nothing changes from row to row, and the best model predicts no
// better.
// A claim that fails is dropped, the weakest first, and the others are fitted and tested again.
#pragma once
#include <functional>

#include "trace/half_rate.hpp"
#include "trace/result.hpp"
#include "trace/selection.hpp"
#include "trace/split.hpp"

namespace twinrate {

// Thresholds of the gate, chosen by design. None was set by a log, and none is ablated yet.
struct Criterion {
  double chance = 1e-3;     // of a false claim in a log, by the signed-rank test
  int votes = 8;            // pieces that must vote; 10 that all fall meet `chance`
  double silent = 1e-3;     // share of a piece's energy: if less changes, it does not vote
  double kept = 0.5;        // of a part's own gain, that another part's size must keep
  double moved = 0.2;       // share of a claim's contribution that may change
  double sigmas = 4;        // deviations by which a part's gain must exceed chance
  double size_sigmas = 2;   // standard deviations that the size of a claim must have
  double times_left = 4;    // power that claims on points explain, over the unexplained
  double least_left = 0.1;  // share of J, psi_f, R_s, L_d or L_q, besides kThisMachine's bounds
};

// Result of the judging rows for one member.
struct Judgement {
  double held_out_gain = 0;  // fall of the raw error, over the error without it
  double fitted_gain = 0;    // the same on rows that do not judge; set for points only
  double p_value = 1;        // of the signed-rank test
  int votes = 0;
  double kept = 1;  // least share of a part's own gain
};

struct Passed {
  Fit fit;                        // of the members that passed, on all rows that do not judge
  std::vector<std::size_t> kept;  // their indices in the members given to the gate
  std::vector<Judgement> judgements;
  std::vector<Refused> refused;
};

class Gate {
 public:
  // `seen`: fits rows that do not judge. `whole`: the chain of all rows, with the same noise model.
  Gate(const Fitter& seen, const Chain& whole, JudgedFiles files, const Criterion& criterion = {})
      : seen_(seen), whole_(whole), files_(std::move(files)), criterion_(criterion) {}
  // `make` is called when a claim first needs it.
  void set_half_rate(std::function<const HalfRate&()> make) { half_rate_ = std::move(make); }
  // Smallest claim that errors of the sensors cannot make, over the smallest size worth reporting.
  void set_resolution(std::function<double(const Effect&)> resolution) {
    resolution_ = std::move(resolution);
  }
  // The values of a sensor show its step: counts of the angle, or coarse currents.
  void set_rounded(bool rounded) { rounded_ = rounded; }
  // A doubt about the drive file or the log's signals. Computed once a claim has passed the rules
  // before.
  struct Doubt {
    const char* rule;
    std::string text;
    bool of_voltage, of_torque;  // equations whose claims it refuses
    bool of_frame;               // also refuses a change that turns in rotor axes
  };
  void set_doubts(std::function<std::vector<Doubt>()> doubts) { doubts_ = std::move(doubts); }
  Passed operator()(const Members& members) const;

 private:
  struct Asked;  // fits and votes: all members, and each left out
  Asked ask(const Fit& fit) const;
  std::vector<Refused> refusals(const Asked& asked) const;
  std::optional<Refused> whole_refusal(const Asked& asked, std::size_t& weakest) const;
  std::optional<Refused> small_part_refusal(const Asked& asked, std::size_t weakest) const;
  std::optional<Refused> moved_refusal(const Members& all, const Passed& passed,
                                       std::size_t& most) const;

  const Fitter& seen_;
  const Chain& whole_;
  JudgedFiles files_;
  Criterion criterion_;
  std::function<const HalfRate&()> half_rate_;
  std::function<double(const Effect&)> resolution_;
  bool rounded_ = false;
  std::function<std::vector<Doubt>()> doubts_;
};

}  // namespace twinrate
