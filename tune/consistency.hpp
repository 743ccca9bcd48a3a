// Consistency of a filter: do its innovations have the covariance that the filter expects?
//
// At each tick, with the gain K and the covariance P that the filter used, and its R:
//
//   S    = H P^- H' + R = (I - H K)^-1 R,  H K = R K' P^-1 K      what the filter expects of innov
//   NIS  = innov' S^-1 innov                                      chi-square with n_y degrees of freedom
//   l    = -1/2 (ln det S + NIS)                                  log-likelihood of the tick, less a constant
//
// H' = P^-1 K R holds for the gain that minimises P; the filters of this project use no other gain.
// In a filter in the stationary frame, innovation and S are compared in rotor axes, because the
// gain is older than the innovation. The innovations of a consistent filter are white, and the mean
// of their NIS is n_y.
// Source: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation, 5.4.
#pragma once
#include <cmath>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "core/run_log.hpp"

namespace twinrate::tune {

struct TickLikelihood {
  std::int64_t k = 0;
  double log_det = 0, nis = 0;  // ln det S, innov' S^-1 innov
  int n_y = 0;
  // With Q and R both times `scale`.
  double of(double scale) const { return -0.5 * (log_det + n_y * std::log(scale) + nis / scale); }
};

struct Consistency {
  std::int64_t ticks = 0;  // judged
  double nis = 0;          // mean of NIS/n_y; 1 is consistent
  double inside = 0;  // share of the ticks with NIS below its 95 % quantile; 0.95 is consistent
  double autocorrelation = 0;      // of the innovations in units of S, lag 1, -1 to 1; 0 is white
  double log_likelihood = 0;       // mean of a tick, with this scale of Q and R
  double best_log_likelihood = 0;  // the same with Q and R both times `nis`
  std::vector<TickLikelihood> of_tick;
  // Against the true or the measured angle; empty without one.
  std::optional<bool> locked;
  std::optional<double> angle_error_rms, speed_error_rms;  // rad electrical, rad/s mechanical
};

// Mean difference of the log-likelihood of a tick and its standard error, over the ticks of both:
// `after` with its own scale less `before` with its best scale. Computed from blocks of ticks,
// because successive innovations can be correlated.
struct Gained {
  double mean = 0, sigma = 0;  // sigma infinite with fewer than four blocks
};
Gained gained(const Consistency& before, const Consistency& after);

enum class Angle { kCompared, kLeftOut };  // the second is quicker

// Runs the filter of the drive file with these overrides and a gain every tick on a recorded drive.
// `from`, `to`: judged part of the log's window, 0 to 1; the filter runs from the first tick on.
// Throws BadInput if no tick can be judged.
Consistency consistency_of(const std::string& drive, const std::vector<std::string>& overrides,
                           const RunLog& log, double from = 0, double to = 1,
                           Angle angle = Angle::kCompared);

// The largest n that keeps synchronism on this log: n rises from 1 to the first loss or to `most`,
// with the gain policy of the drive file. 0: n = 1 loses it. Empty without an angle to compare
// with.
std::optional<int> n_max_on(const std::string& drive, const std::vector<std::string>& overrides,
                            const RunLog& log, int most, const std::function<bool()>& stop);

// True if the simulated drive of the drive file keeps synchronism with these overrides. The run
// includes the start and every acceleration of its profile, which a log of one speed does not
// contain.
bool holds_in_closed_loop(const std::string& drive, const std::vector<std::string>& overrides);

}  // namespace twinrate::tune
