#include "sweep/result.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>

namespace twinrate::sweep {
namespace {

// Result of one search: the last n before the first loss.
struct Outcome {
  int n_max = 0;
  bool capped = false, complete = false;
};

Outcome outcome_of(const std::vector<const Point*>& points, const Search& search, int n_max) {
  Outcome outcome;
  for (const Point* p : points) {
    if (!p->locked) break;
    outcome.n_max = p->n;
  }
  outcome.complete = !next_to_try(points, search, n_max);
  outcome.capped = !points.empty() && points.back()->locked;
  return outcome;
}

std::string number(int n, double value) {
  return n > 0 ? fmt::format("{}", value) : "inf";
}

}  // namespace

std::string limiting_part(int filter_alone, int closed_loop, int most_closed) {
  if (closed_loop == 0 || filter_alone == 0 || closed_loop >= most_closed) return "-";
  return closed_loop < filter_alone - std::max(1.0, 0.1 * filter_alone) ? "controller" : "filter";
}

std::vector<const Point*> of_search(const std::vector<Point>& points, const Search& search) {
  std::vector<const Point*> list;
  for (const Point& p : points)
    if (p.search.policy == search.policy && p.search.f_e_Hz == search.f_e_Hz &&
        p.search.seed == search.seed)
      list.push_back(&p);
  std::sort(list.begin(), list.end(), [](const Point* a, const Point* b) { return a->n < b->n; });
  return list;
}

std::optional<int> next_to_try(const std::vector<const Point*>& points, const Search& search,
                               int n_max) {
  if (search.policy == "scheduled") n_max = 1;
  int held = 0, lost = 0;
  for (const Point* p : points) {
    if (!p->locked) {
      lost = p->n;
      break;
    }
    held = p->n;
  }
  if (lost > 0) return lost == held + 1 ? std::nullopt : std::optional<int>(held + 1);
  if (held >= n_max) return std::nullopt;
  return std::min(next_n(held), n_max);
}

std::vector<Limit> limits_of(const Plan& plan, const std::vector<Point>& points) {
  std::vector<Limit> limits;
  for (const std::string& policy : plan.policies) {
    for (double f_e : plan.speeds_Hz) {
      std::vector<Outcome> outcomes;
      Limit limit{.policy = policy, .f_e_Hz = f_e};
      for (int seed = 1; seed <= plan.seeds; ++seed) {
        const Search search{policy, f_e, seed};
        const auto own = of_search(points, search);
        outcomes.push_back(outcome_of(own, search, plan.n_max));
        limit.complete = limit.complete && outcomes.back().complete;
        ++limit.seeds, limit.seeds_capped += outcomes.back().capped ? 1 : 0;
        if (!own.empty()) limit.f_s_Hz = own.front()->f_s_Hz;
      }
      std::sort(outcomes.begin(), outcomes.end(),
                [](const Outcome& a, const Outcome& b) { return a.n_max < b.n_max; });
      const Outcome& middle = outcomes[(outcomes.size() - 1) / 2];
      limit.n_max = middle.n_max;
      limit.capped = middle.capped;
      limit.n_lowest = outcomes.front().n_max;
      limit.n_highest = outcomes.back().n_max;
      double square = 0;
      int count = 0;
      for (const Point& p : points)
        if (p.search.policy == policy && p.search.f_e_Hz == f_e && p.n == limit.n_max && p.locked)
          square += p.angle_error_rms * p.angle_error_rms, ++count;
      limit.angle_error_rms = count > 0 ? std::sqrt(square / count) : NAN;
      limits.push_back(limit);
    }
  }
  return limits;
}

void write_limits(const std::string& path, const std::vector<Limit>& limits) {
  std::ofstream file(path);
  file << "policy,f_e_Hz,n_max,f_bmin_Hz,ratio,ratio_lo,ratio_hi,capped,angle_error_rms_rad,seeds,"
          "seeds_capped\n";
  for (const Limit& l : limits) {
    file << fmt::format("{},{},", l.policy, l.f_e_Hz);
    if (l.policy == "scheduled")
      file << fmt::format(",,,,,{}", l.capped ? 1 : 0);
    else
      file << fmt::format("{},{},{},{},{},{}", l.n_max, number(l.n_max, l.f_bmin_Hz()),
                          number(l.n_max, l.ratio(l.n_max)),
                          number(l.n_highest, l.ratio(l.n_highest)),
                          number(l.n_lowest, l.ratio(l.n_lowest)), l.capped ? 1 : 0);
    file << fmt::format(",{},{},{}\n", l.angle_error_rms, l.seeds, l.seeds_capped);
  }
}

}  // namespace twinrate::sweep
