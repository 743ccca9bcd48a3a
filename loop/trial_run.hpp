// A trial of the run: the drive of the file without a log, before anything is written.
//
// Theory gives reasons to expect a loss of synchronism (loop/runnable.hpp); most of them bound the small
// deviations, and a start or a load step is none. The trial integrates the same equations instead: it is
// the run itself, noise and seed included, up to some 60,000 ticks.
//
//   the trial reaches the end of the run     it decides: no loss is expected that it does not show. It is
//                                            one noise and one plant: the reason is kept as a note
//   the run is longer                        a loss that it shows is reported, and theory decides, but for the
//                                            reasons of a start that lies within the trial
//   the table of gain.policy = scheduled     the trial runs with a gain every tick; a loss that it shows is
//   takes too long                           reported, and theory decides
//
// A reason that is an uncertainty of the machine is tried with the winding 50 K warmer in the plant alone.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "core/config.hpp"
#include "estimator/make_filter.hpp"

namespace twinrate {

// As analysis/summary.hpp judges a run.
struct TrialRun {
  bool whole = false;    // it reached the end of the run
  double bad_at_s = -1;  // of the loss or trip that makes the run end badly; < 0: none
  std::string why;       // of that: "the angle error passed 90 deg", the text of the trip
  bool tripped = false;
};
// At most `ticks` ticks. The config stays as it is. Requires check_runnable(). `table`: of the filter,
// where the caller has it.
TrialRun try_run(Config& config, std::int64_t ticks, const GainTable& table = nullptr);

enum class Trial {
  kAlways,
  kOfReasons,  // only where theory expects a loss: the run follows anyway
};
// check_runnable(), one line for each warning that the trial leaves, and a line for a loss of the trial
// that no theory expected. `notes`: the reasons that the trial did not show.
std::vector<std::string> check_by_trial(Config& config, Trial when,
                                        std::vector<std::string>* notes = nullptr);

}  // namespace twinrate
