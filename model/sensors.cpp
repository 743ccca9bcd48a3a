#include "model/sensors.hpp"

#include "model/fields.hpp"

namespace twinrate {

void SensorParameters::fields(FieldVisitor& f) {
  f.number("i_noise_rms_A", i_noise_rms, 0, 100, "noise of each phase-current sample, rms");
  f.number("i_lsb_A", i_lsb, 0, 10, "ADC step of a phase current; 0: none");
  f.integer("current_sensors", current_sensors, 2, 3,
            "phase currents really measured; 2: i_c is -(i_a + i_b) of the readings");
  f.integer("encoder_counts", encoder_counts, 0, 1 << 26,
            "encoder counts a turn (four times the lines); 0: exact angle");
}

Vec3 sample_currents(const SensorParameters& p, const Vec3& i_abc, std::uint64_t seed,
                     std::int64_t k) {
  return CurrentSensors(p, seed).sample(i_abc, k);
}

double sample_angle(const SensorParameters& p, double theta_m) {
  if (p.encoder_counts == 0) return theta_m;
  const double step = kTwoPi / p.encoder_counts;
  return std::floor(theta_m / step) * step;
}

}  // namespace twinrate
