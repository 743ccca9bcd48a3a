// From points to f_bmin: per policy and speed the last n before the first loss, over the seeds.
#pragma once
#include <optional>

#include "sweep/point.hpp"

namespace twinrate::sweep {

// The n that a search needs next, none where it is done. `points` are its own, n rising. Above 64
// the search goes in steps of 5 % and then closes the gap below the loss upwards, one by one.
std::optional<int> next_to_try(const std::vector<const Point*>& points, const Search& search,
                               int n_max);
// The points of one search, n rising (`points` sorted).
std::vector<const Point*> of_search(const std::vector<Point>& points, const Search& search);

// One row of fbmin.csv. n_max is the median over the seeds, lo and hi are the extremes: with N
// seeds the true median lies between them with probability 1 - 2^(1-N).
struct Limit {
  std::string policy;
  double f_e_Hz = 0, f_s_Hz = 0;
  int n_max = 0, n_lowest = 0, n_highest = 0;  // 0: n = 1 is lost already
  bool capped = false;                         // no loss up to --n-max, for the median
  bool complete = true;                        // every seed's search is done
  double angle_error_rms = 0;                  // at n_max, rms over the seeds that held it

  double f_bmin_Hz() const { return f_s_Hz / n_max; }
  double ratio(int n) const { return f_s_Hz / n / f_e_Hz; }
};
std::vector<Limit> limits_of(const Plan& plan, const std::vector<Point>& points);
void write_limits(const std::string& path, const std::vector<Limit>& limits);

}  // namespace twinrate::sweep
