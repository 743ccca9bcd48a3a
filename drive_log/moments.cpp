#include "drive_log/moments.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include "model/effects/catalogue.hpp"
#include "trace/equations.hpp"
#include "trace/keys.hpp"

namespace twinrate {
namespace {

constexpr double kGapMargin_s = 0.05;  // reach of the filters beside a gap
constexpr double kStretch_s = 1;       // length of a stretch read in the gap
constexpr std::size_t kNoiseRows = 5;  // half-width of the difference that estimates the noise
constexpr std::size_t kEdgeRows = 3;   // rows without residual at the ends of a stretch

struct Gap {
  std::size_t file = 0;
  double begin = 0, end = 0;  // s
};

// The gap between two blocks that contains `t` within kGapMargin_s.
std::optional<Gap> gap_at(const DriveLogs& logs, double t) {
  const Record& r = logs.record;
  for (std::size_t f = 0; f < logs.files.size(); ++f)
    for (std::size_t k = logs.files[f].first + 1; k < logs.files[f].end; ++k)
      if (r.t[k] - r.t[k - 1] > 3 * r.T_s && t > r.t[k - 1] - kGapMargin_s &&
          t < r.t[k] + kGapMargin_s)
        return Gap{f, r.t[k - 1] - kGapMargin_s, r.t[k] + kGapMargin_s};
  return {};
}

class StepSearch {
 public:
  StepSearch(const DriveLogs& logs, const DriveConfig& drive, const TraceResult& result,
             const Effect& step)
      : logs_(logs), drive_(drive), T_(get_key(step, "torque_Nm")) {
    for (const TracedEffect& e : result.effects)
      if (!e.from_samples && e.effect.get() != &step) others_.push_back(e.effect);
  }

  struct Moment {
    double t = 0, sigma = 0;
  };
  Moment moment(Gap gap) const {
    while (gap.end - gap.begin > 2.5 * kStretch_s) {
      const double middle = 0.5 * (gap.begin + gap.end);
      const double from = middle - 0.5 * kStretch_s, to = middle + 0.5 * kStretch_s;
      const Residual residual = residual_of(gap.file, from, to);
      double sum = 0;
      for (double e : residual.e) sum += e;
      const bool before =
          std::abs(sum / static_cast<double>(residual.e.size())) < 0.5 * std::abs(T_);
      (before ? gap.begin : gap.end) = before ? from : to;
    }
    const Residual residual = residual_of(gap.file, gap.begin, gap.end);
    std::vector<double> sum = residual.e;  // from the row to the end
    double total = 0, power = 0;
    for (std::size_t k = sum.size(); k-- > 0;)
      sum[k] = total += std::copysign(1.0, T_) * (residual.e[k] - 0.5 * T_);
    for (std::size_t k = kNoiseRows; k + kNoiseRows < sum.size(); ++k)
      power += std::pow(sum[k] - 0.5 * (sum[k - kNoiseRows] + sum[k + kNoiseRows]), 2) / 1.5;
    const auto n = static_cast<double>(std::max<std::size_t>(1, sum.size()));
    const auto largest = std::max_element(sum.begin(), sum.end());
    if (largest == sum.end()) return {0.5 * (gap.begin + gap.end), 0.3 * (gap.end - gap.begin)};
    return {residual.t[static_cast<std::size_t>(largest - sum.begin())],
            logs_.record.T_s * std::sqrt(power / n) / (0.5 * std::abs(T_))};
  }

 private:
  // Torque residual of the model without the step.
  struct Residual {
    std::vector<double> t, e;
  };
  Residual residual_of(std::size_t file, double begin, double end) const {
    const Record record = logs_.stretch(file, begin, end);
    const Equations equations(record, drive_.facts(), drive_.model_effects());
    const Channels x = equations.residual(others_);
    Residual residual;
    for (std::size_t k = kEdgeRows; k + kEdgeRows < record.size(); ++k)
      if (record.motion_ok[k]) residual.t.push_back(record.t[k]), residual.e.push_back(x.torque[k]);
    return residual;
  }

  const DriveLogs& logs_;
  const DriveConfig& drive_;
  double T_;
  Effects others_;
};

}  // namespace

void find_moments(const DriveLogs& logs, const DriveConfig& drive, TraceResult& result) {
  for (TracedEffect& e : result.effects) {
    if (!is_placed(*e.effect, Traits::Place::kMoment)) continue;
    const std::optional<Gap> gap = gap_at(logs, get_key(*e.effect, "time_s"));
    if (!gap) continue;
    const auto found = StepSearch(logs, drive, result, *e.effect).moment(*gap);
    const std::shared_ptr<Effect> corrected = e.effect->clone();
    set_key(*corrected, "time_s", found.t);
    e.effect = corrected;
    for (TracedParameter& p : e.parameters)
      if (p.name == "time") p.value = found.t, p.sigma = found.sigma;
  }
}

}  // namespace twinrate
