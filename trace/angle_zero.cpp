#include "trace/angle_zero.hpp"

#include <cmath>

#include "model/effects/catalogue.hpp"
#include "trace/equations.hpp"
#include "trace/sampler.hpp"
#include "trace/thinning.hpp"

namespace twinrate {

double rounding_to_nearest(const Record& whole, const DriveFacts& facts, const Effects& known) {
  constexpr double kNear = 0.25;  // of a count
  const double half = whole.angle.centre;
  if (half <= 0 || !whole.has_voltage_equation()) return 0;
  const Record record = thinned(whole, rows_as_one(whole.T_s), facts.machine.n_p);
  const Equations equations(record, facts, known);
  const std::vector<char> none(record.size(), 0);
  const Sampler sampler(record, moving_rows(record), none);
  const auto zero = make_of(Traits::Family::kAngleSensor);
  const Eigen::VectorXd e = sampler(equations.residual({}).d, sampler.electrical()),
                        c = sampler(equations.columns(*zero).front().d, sampler.electrical());
  if (!e.size() || c.squaredNorm() <= 0) return 0;
  const double counts = c.dot(e) / c.squaredNorm() / whole.angle.lsb;
  return std::abs(counts - 0.5) < kNear ? -half : 0;
}

double zero_within_count(const TraceResult& result, const Sensor& angle) {
  constexpr double kSigmas = 2;
  const auto zero = make_of(Traits::Family::kAngleSensor);
  for (const TracedEffect& e : result.effects) {
    if (e.effect->kind() != zero->kind() || e.parameters.empty()) continue;
    const TracedParameter& offset = e.parameters.front();
    if (std::abs(offset.value) < angle.lsb + kSigmas * offset.sigma.value_or(0))
      return -offset.value;
  }
  return 0;
}

Record moved(const Record& record, double by) {
  Record out = record;
  for (double& theta_m : out.theta_m) theta_m += by;
  out.angle.centre = 0;
  out.angle.moved += by;
  return out;
}

}  // namespace twinrate
