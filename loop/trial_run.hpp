// A trial of the run: the drive of the file without a log, before anything is written.
//
// Theory gives reasons to expect a loss of synchronism (loop/runnable.hpp). Most of them apply to
// small deviations, which a start or a load step exceeds. The trial integrates the same equations
// instead: it is the run itself, noise and seed included, up to some 60,000 ticks.
//
//   the trial reaches the end of the run     it decides: only a loss that it shows is expected. It
//                                            is one noise and one plant: the reason becomes a note
//   the run is longer                        a loss that it shows is reported, and theory decides,
//                                            except on reasons of a start within the trial
//   the table of gain.policy = scheduled     the trial runs with a gain every tick; a loss that it
//   takes too long                           shows is reported, and theory decides
//
// A reason from an uncertainty of the machine is tried with the winding 50 K warmer in the plant
// alone.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "core/config.hpp"
#include "estimator/make_filter.hpp"

namespace twinrate {

// The judgement of analysis/summary.hpp on the run.
struct TrialRun {
  bool whole = false;    // it reached the end of the run
  double bad_at_s = -1;  // of the loss or trip that makes the run end badly; < 0: none
  std::string why;       // of that loss: "the angle error passed 90 deg", the text of the trip
  bool tripped = false;
};
// Runs at most `ticks` ticks. The config does not change. Requires check_runnable(). `table`: of
// the filter, if the caller has it.
TrialRun try_run(Config& config, std::int64_t ticks, const GainTable& table = nullptr);

enum class Trial {
  kAlways,
  kOfReasons,  // only if theory expects a loss, because the run follows anyway
};
// check_runnable(), one line for each warning that remains after the trial, and a line for a loss
// of the trial that theory did not expect. `notes`: the reasons that the trial did not show.
std::vector<std::string> check_by_trial(Config& config, Trial when,
                                        std::vector<std::string>* notes = nullptr);

}  // namespace twinrate
