// Noise weights of a filter from a recorded drive: the weights that maximise the likelihood of the
// innovations of the log.
//
//   search    Nelder and Mead over the logarithms of the knobs (tune/knobs.hpp), with R fixed: the gain depends on the
//             ratios only. The common factor follows in closed form: the mean NIS.
//   judged    on data that the search did not read: another log, or the last third of the only one
//
// The weights minimise the error of the predicted currents (and speed) instead of that of the
// angle. The result shows both errors, and the slowest gain update that keeps synchronism on that
// log.
#pragma once
#include "tune/consistency.hpp"
#include "tune/knobs.hpp"

namespace twinrate::tune {

struct Request {
  std::string drive;
  std::vector<std::string> overrides;
  std::string log, holdout;  // holdout empty: the last third of `log`
  int n_most = 200;          // of the search for n_max
  int evaluations = 200;     // of the likelihood, at the most
};

struct Side {
  Knobs knobs;
  Consistency training, holdout;
  std::optional<int> n_max;  // on the hold-out log, with the filter alone
  bool closed_loop = false;  // the simulated run of the drive file keeps synchronism
};

struct Result {
  Side before, after;
  double f_s_Hz = 0;
  std::optional<double> f_e_Hz;  // mean of the hold-out log
  // A log of one speed makes the weight of an acceleration too small. If the most likely weights
  // lose the simulated run or a slow gain that the weights of the drive file keep, the result lies
  // this share of the way back to those of the drive file, in logarithms.
  double back = 0;
  bool interrupted = false;
  // Reasons why the new weights are no better than those of the drive file; empty: they are better.
  std::vector<std::string> objections;
};

// `progress`: present step and its share, 0 to 1. `stop`: true ends the search with the best result
// so far. Throws BadInput: a log of another rate, without the signals of the filter, or too short.
Result tune(const Request& request, const std::function<void(const std::string&, double)>& progress,
            const std::function<bool()>& stop);

}  // namespace twinrate::tune
