#include "tune/tune.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "analysis/summary.hpp"
#include "loop/load_drive.hpp"

namespace twinrate::tune {
namespace {

constexpr double kTrained = 2.0 / 3;  // share of the only log that the search reads
constexpr double kFirstStep = 2.3;    // one decade
constexpr double kSettled = 1e-4;     // spread of the likelihood of a tick over the simplex
constexpr double kFarthest = 14;      // six decades from the drive file
constexpr int kSteps = 8;             // of the way back
constexpr double kSigmas = 2;         // more likely by more than this many standard errors
constexpr double kWorseAngle =
    1.05;  // an angle error larger by more than this factor is an objection

using Point = std::vector<double>;

// The minimum of f by Nelder and Mead, from the origin. Source: Lagarias et al. 1998, with their coefficients.
Point nelder_mead(std::size_t dimensions, int evaluations,
                  const std::function<double(const Point&)>& f, const std::function<bool()>& stop) {
  std::vector<std::pair<double, Point>> simplex;
  const auto evaluate = [&](Point x) {
    --evaluations;
    const double value = f(x);
    return std::pair(value, std::move(x));
  };
  simplex.push_back(evaluate(Point(dimensions, 0)));
  for (std::size_t i = 0; i < dimensions && !stop(); ++i) {
    Point x(dimensions, 0);
    x[i] = kFirstStep;
    simplex.push_back(evaluate(std::move(x)));
  }
  const auto by_value = [](const auto& a, const auto& b) { return a.first < b.first; };
  std::sort(simplex.begin(), simplex.end(), by_value);
  if (simplex.size() <= dimensions) return simplex.front().second;
  while (evaluations > 0 && !stop() && simplex.back().first - simplex.front().first > kSettled) {
    Point centre(dimensions, 0);
    for (std::size_t v = 0; v < dimensions; ++v)
      for (std::size_t i = 0; i < dimensions; ++i)
        centre[i] += simplex[v].second[i] / static_cast<double>(dimensions);
    const auto along = [&](double factor) {
      Point x(dimensions);
      for (std::size_t i = 0; i < dimensions; ++i)
        x[i] = centre[i] + factor * (centre[i] - simplex.back().second[i]);
      return evaluate(std::move(x));
    };
    auto next = along(1);
    if (next.first < simplex.front().first) {
      next = std::min(next, along(2), by_value);
    } else if (!(next.first < simplex[dimensions - 1].first)) {
      const bool outside = next.first < simplex.back().first;
      const double worst = std::min(next.first, simplex.back().first);
      next = along(outside ? 0.5 : -0.5);
      if (!(next.first < worst)) {  // shrinks towards the best
        for (std::size_t v = 1; v <= dimensions; ++v) {
          Point x(dimensions);
          for (std::size_t i = 0; i < dimensions; ++i)
            x[i] = 0.5 * (simplex[v].second[i] + simplex.front().second[i]);
          simplex[v] = evaluate(std::move(x));
        }
        std::sort(simplex.begin(), simplex.end(), by_value);
        continue;
      }
    }
    simplex.back() = std::move(next);
    std::sort(simplex.begin(), simplex.end(), by_value);
  }
  return simplex.front().second;
}

std::string name_of(const Knob& knob) {
  return knob.key.substr(knob.key.rfind('.') + 1);
}

// Knobs that the search changes: Q, L and every R except the first, which fixes the scale.
std::vector<std::size_t> free_knobs(const Knobs& knobs) {
  std::vector<std::size_t> list;
  bool fixed = false;
  for (std::size_t i = 0; i < knobs.list.size(); ++i) {
    const std::string name = name_of(knobs.list[i]);
    if (name.starts_with("P0")) continue;
    if (name.starts_with("R") && !fixed)
      fixed = true;
    else
      list.push_back(i);
  }
  return list;
}

class Tuning {
 public:
  Tuning(const Request& request, const std::function<void(const std::string&, double)>& progress,
         const std::function<bool()>& stop)
      : request_(request), progress_(progress), stop_(stop), log_(read_run_log(request.log)) {
    if (!request.holdout.empty()) holdout_ = read_run_log(request.holdout);
  }

  Result run() {
    Config config = load_drive(request_.drive, request_.overrides);
    Result r;
    r.f_s_Hz = config.drive().rates.f_s_Hz;
    r.before.knobs = knobs_of(config);
    judge(r.before);
    try_out(r.before);
    const Knobs likeliest = search(r.before.knobs);
    r.interrupted = stop_();
    r.after = held(r.before, likeliest, r.back);
    r.f_e_Hz = mean_f_e_Hz(config.drive());
    object(r);
    return r;
  }

 private:
  bool alone() const { return request_.holdout.empty(); }
  const RunLog& unseen() const { return alone() ? log_ : holdout_; }
  std::vector<std::string> overrides(const Knobs& knobs) const {
    std::vector<std::string> list = request_.overrides;
    for (const std::string& text : knobs.overrides()) list.push_back(text);
    return list;
  }
  Consistency trained(const Knobs& knobs, Angle angle) const {
    return consistency_of(request_.drive, overrides(knobs), log_, 0, alone() ? kTrained : 1, angle);
  }
  void judge(Side& side) const {
    side.training = trained(side.knobs, Angle::kCompared);
    side.holdout =
        consistency_of(request_.drive, overrides(side.knobs), unseen(), alone() ? kTrained : 0, 1);
  }
  std::optional<int> n_max(const Knobs& knobs) const {
    return n_max_on(request_.drive, overrides(knobs), unseen(), request_.n_most, stop_);
  }

  void try_out(Side& side) const {
    side.n_max = n_max(side.knobs);
    side.closed_loop = holds_in_closed_loop(request_.drive, overrides(side.knobs));
  }

  // Steps back from the most likely weights to the given ones, to the first weights that keep
  // synchronism and n_max like the given ones; without such weights, the most likely ones.
  Side held(const Side& given, const Knobs& likeliest, double& back) const {
    std::optional<Side> first;
    for (int step = 0; step < kSteps && !(first && stop_()); ++step) {
      progress_("closed loop", 0.85 + 0.15 * step / kSteps);
      Side side;
      side.knobs = between(likeliest, given.knobs, static_cast<double>(step) / kSteps);
      side.knobs.scale_weights(trained(side.knobs, Angle::kLeftOut).nis);
      judge(side);
      try_out(side);
      back = static_cast<double>(step) / kSteps;
      if (side.closed_loop >= given.closed_loop && (!given.n_max || side.n_max >= given.n_max))
        return side;
      if (!first) first = std::move(side);
    }
    back = 0;
    return *first;
  }

  static Knobs between(const Knobs& from, const Knobs& to, double share) {
    Knobs knobs = from;
    for (std::size_t i = 0; i < knobs.list.size(); ++i)
      knobs.set(i, from.list[i].value * std::pow(to.list[i].value / from.list[i].value, share));
    return knobs;
  }

  Knobs search(const Knobs& given) const {
    const std::vector<std::size_t> free = with_effect(given, free_knobs(given));
    if (free.empty()) return given;
    const auto at = [&](const Point& x) {
      Knobs knobs = given;
      for (std::size_t i = 0; i < free.size(); ++i)
        knobs.set(free[i],
                  given.list[free[i]].value * std::exp(std::clamp(x[i], -kFarthest, kFarthest)));
      return knobs;
    };
    int done = 0;
    const auto cost = [&](const Point& x) {
      progress_("search", 0.85 * ++done / request_.evaluations);
      const double l = trained(at(x), Angle::kLeftOut).best_log_likelihood;
      return std::isfinite(l) ? -l : std::numeric_limits<double>::max();
    };
    return at(nelder_mead(free.size(), request_.evaluations, cost, stop_));
  }

  // Removes the knobs that this configuration of the filter does not use: a factor of ten leaves
  // the likelihood bit for bit unchanged.
  std::vector<std::size_t> with_effect(const Knobs& given, std::vector<std::size_t> free) const {
    const double unchanged = trained(given, Angle::kLeftOut).best_log_likelihood;
    std::erase_if(free, [&](std::size_t i) {
      Knobs knobs = given;
      knobs.set(i, 10 * given.list[i].value);
      return trained(knobs, Angle::kLeftOut).best_log_likelihood == unchanged;
    });
    return free;
  }

  std::optional<double> mean_f_e_Hz(const DriveConfig& drive) const {
    const std::vector<TickRow> rows = tick_rows(unseen());
    const std::vector<double> omega_m = reference_speed(rows, !unseen().truth.empty());
    double sum = 0;
    int count = 0;
    for (std::size_t i = 0; i < rows.size(); ++i)
      if (std::isfinite(omega_m[i]) && rows[i].t_s - rows.front().t_s >= drive.run.settle_s)
        sum += std::abs(omega_m[i]), ++count;
    if (count == 0) return {};
    return drive.machine.n_p * sum / count / kTwoPi;
  }

  static void object(Result& r) {
    const Consistency &before = r.before.holdout, &after = r.after.holdout;
    const Gained gain = gained(before, after);
    if (std::isinf(gain.sigma))
      r.objections.emplace_back("the unseen data have too few ticks to tell the weights apart");
    else if (!(gain.mean > kSigmas * gain.sigma))
      r.objections.push_back(
          fmt::format("the innovations of the unseen data are not more likely than with the drive "
                      "file's ratios (a tick by {:.2g}, standard error {:.2g}; {:g} of these are "
                      "needed)",
                      gain.mean, gain.sigma, kSigmas));
    if (!after.locked.value_or(true))
      r.objections.emplace_back("synchronism is lost on the unseen data");
    if (r.before.closed_loop && !r.after.closed_loop)
      r.objections.emplace_back("the simulated run of the drive file loses synchronism");
    if (before.angle_error_rms && after.angle_error_rms &&
        *after.angle_error_rms > kWorseAngle * *before.angle_error_rms)
      r.objections.push_back(
          fmt::format("the angle error on the unseen data is {:.2f} times larger",
                      *after.angle_error_rms / *before.angle_error_rms));
    if (r.before.n_max && r.after.n_max && *r.after.n_max < *r.before.n_max)
      r.objections.push_back(fmt::format("the gain must be computed every {} ticks instead of {}",
                                         *r.after.n_max, *r.before.n_max));
  }

  const Request& request_;
  const std::function<void(const std::string&, double)>& progress_;
  const std::function<bool()>& stop_;
  RunLog log_, holdout_;
};

}  // namespace

Result tune(const Request& request, const std::function<void(const std::string&, double)>& progress,
            const std::function<bool()>& stop) {
  return Tuning(request, progress, stop).run();
}

}  // namespace twinrate::tune
