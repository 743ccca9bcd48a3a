// f_bmin from points: the last n before the first loss, for each policy and speed, over the seeds.
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "sweep/point.hpp"

namespace twinrate::sweep {

// The next n of a search; empty if the search is complete. `points`: those of the search, n rising.
// Above 64 the search has steps of 5 %; after the first loss it tries every n below it, upwards.
std::optional<int> next_to_try(const std::vector<const Point*>& points, const Search& search,
                               int n_max);
// The points of one search, n rising (`points` sorted).
std::vector<const Point*> of_search(const std::vector<Point>& points, const Search& search);

// One row of fbmin.csv. n_max is the median over the seeds, n_lowest and n_highest the extremes:
// with N seeds the true median lies between the extremes with probability 1 - 2^(1-N).
struct Limit {
  std::string policy;
  double f_e_Hz = 0, f_s_Hz = 0;
  int n_max = 0, n_lowest = 0, n_highest = 0;  // 0: n = 1 is lost
  bool capped = false;                         // the median has no loss up to --n-max
  int seeds = 0, seeds_capped = 0;             // number of these seeds without a loss up to --n-max
  bool complete = true;                        // the searches of all seeds are complete
  double angle_error_rms = 0;                  // at n_max, rms over the locked seeds

  double f_bmin_Hz() const { return f_s_Hz / n_max; }
  double ratio(int n) const { return f_s_Hz / n / f_e_Hz; }
};
// The part that limits n, by the largest n of two Floquet analyses: the controller if the closed
// loop keeps synchronism up to a smaller n than the filter alone, by more than a step or 10 %, else
// the filter. "-" without a limit: one of them is 0 (not predicted), or the closed loop keeps it at
// every n that was tried, up to `most_closed`.
std::string limiting_part(int filter_alone, int closed_loop, int most_closed);

std::vector<Limit> limits_of(const Plan& plan, const std::vector<Point>& points);
void write_limits(const std::string& path, const std::vector<Limit>& limits);

}  // namespace twinrate::sweep
