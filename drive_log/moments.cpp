#include "drive_log/moments.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include "model/effects/catalogue.hpp"
#include "trace/equations.hpp"
#include "trace/keys.hpp"

namespace twinrate {
namespace {

constexpr double kBeside_s = 0.05;  // of a gap: filters reach so far
constexpr double kLook_s = 1;       // time read for one look into the gap
constexpr std::size_t kReach = 5;   // rows to each side, to see the noise of a sum
constexpr std::size_t kEdge = 3;    // rows at the ends of a stretch that have no neighbours

struct Gap {
  std::size_t file = 0;
  double begin = 0, end = 0;  // s
};

// The gap between two blocks that holds `t` or is right beside it.
std::optional<Gap> gap_at(const DriveLogs& logs, double t) {
  const Record& r = logs.record;
  for (std::size_t f = 0; f < logs.files.size(); ++f)
    for (std::size_t k = logs.files[f].first + 1; k < logs.files[f].end; ++k)
      if (r.t[k] - r.t[k - 1] > 3 * r.T_s && t > r.t[k - 1] - kBeside_s && t < r.t[k] + kBeside_s)
        return Gap{f, r.t[k - 1] - kBeside_s, r.t[k] + kBeside_s};
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
    while (gap.end - gap.begin > 2.5 * kLook_s) {
      const double middle = 0.5 * (gap.begin + gap.end);
      const Left left = left_of(gap.file, middle - 0.5 * kLook_s, middle + 0.5 * kLook_s);
      double sum = 0;
      for (double e : left.e) sum += e;
      const bool before = std::abs(sum / static_cast<double>(left.e.size())) < 0.5 * std::abs(T_);
      (before ? gap.begin : gap.end) = before ? middle - 0.5 * kLook_s : middle + 0.5 * kLook_s;
    }
    const Left left = left_of(gap.file, gap.begin, gap.end);
    std::vector<double> sum = left.e;  // from the row to the end
    double total = 0, power = 0;
    for (std::size_t k = sum.size(); k-- > 0;)
      sum[k] = total += std::copysign(1.0, T_) * (left.e[k] - 0.5 * T_);
    for (std::size_t k = kReach; k + kReach < sum.size(); ++k)
      power += std::pow(sum[k] - 0.5 * (sum[k - kReach] + sum[k + kReach]), 2) / 1.5;
    const auto n = static_cast<double>(std::max<std::size_t>(1, sum.size()));
    const auto largest = std::max_element(sum.begin(), sum.end());
    if (largest == sum.end()) return {0.5 * (gap.begin + gap.end), 0.3 * (gap.end - gap.begin)};
    return {left.t[static_cast<std::size_t>(largest - sum.begin())],
            logs_.record.T_s * std::sqrt(power / n) / (0.5 * std::abs(T_))};
  }

 private:
  // Torque that the model leaves without the step.
  struct Left {
    std::vector<double> t, e;
  };
  Left left_of(std::size_t file, double begin, double end) const {
    const Record record = logs_.stretch(file, begin, end);
    const Equations equations(record, drive_.facts(), drive_.model_effects());
    const Channels x = equations.residual(others_);
    Left left;
    for (std::size_t k = kEdge; k + kEdge < record.size(); ++k)
      if (record.motion_ok[k]) left.t.push_back(record.t[k]), left.e.push_back(x.torque[k]);
    return left;
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
    const std::shared_ptr<Effect> there = e.effect->clone();
    set_key(*there, "time_s", found.t);
    e.effect = there;
    for (TracedParameter& p : e.parameters)
      if (p.name == "time") p.value = found.t, p.sigma = found.sigma;
  }
}

}  // namespace twinrate
