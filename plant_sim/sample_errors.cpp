#include "plant_sim/sample_errors.hpp"

#include "model/random.hpp"

namespace twinrate {
namespace {

// Random streams; those of the current noise are 0 to 5.
constexpr std::uint64_t kMissingStream = 100, kStaleStream = 101, kHeldStream = 102;

}  // namespace

LateState::LateState(double delay, double T_s, const PlantState& start)
    : line_(static_cast<std::size_t>(delay / T_s)), caught_(start), seen_(start) {
  moment_ = T_s * (1 - (delay / T_s - std::floor(delay / T_s)));
  line_.pass(start);
}

SampleErrors::SampleErrors(const SamplingFacts& facts, double T_s, std::uint64_t seed)
    : facts_(facts),
      seed_(seed),
      duty_delay_(facts.delay[SamplingFacts::kVoltage], T_s),
      duty_filter_(facts.lowpass[SamplingFacts::kVoltage], T_s),
      current_filter_(facts.lowpass[SamplingFacts::kCurrent], T_s),
      angle_filter_(facts.lowpass[SamplingFacts::kAngle], T_s),
      speed_delay_(facts.delay[SamplingFacts::kSpeed], T_s),
      speed_filter_(facts.lowpass[SamplingFacts::kSpeed], T_s) {}

bool SampleErrors::angle_is_late() const {
  return facts_.delay[SamplingFacts::kAngle] > 0 || facts_.lowpass[SamplingFacts::kAngle] > 0;
}

Vec3 SampleErrors::converted(const Vec3& i_abc, int current_sensors) const {
  Vec3 i_meas = i_abc;
  if (facts_.i_limit > 0) i_meas = i_meas.cwiseMax(-facts_.i_limit).cwiseMin(facts_.i_limit);
  if (facts_.i_lsb > 0) i_meas = (i_meas / facts_.i_lsb).array().round().matrix() * facts_.i_lsb;
  if (current_sensors == 2) i_meas[2] = -(i_meas[0] + i_meas[1]);
  return i_meas;
}

void SampleErrors::spoil_row(Measurement& m, const Measurement& before) const {
  const auto k = static_cast<std::uint64_t>(m.k);
  const bool missing = uniform(seed_, kMissingStream, k) <= facts_.missing;
  const bool stale = uniform(seed_, kStaleStream, k) <= facts_.stale;
  const bool held = uniform(seed_, kHeldStream, k) <= facts_.held;
  if (missing || stale || held) m.i_abc = before.i_abc;
  if (!missing && !stale) return;
  m.theta_m = before.theta_m;
  m.omega_m = before.omega_m;
  m.v_dc = before.v_dc;
  if (missing) m.signals = kVoltage;
}

}  // namespace twinrate
