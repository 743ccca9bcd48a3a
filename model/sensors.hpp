// Sensors: phase-current noise and ADC steps, incremental encoder with finite-difference speed.
//
//   i_meas       = round((i + noise)/lsb) lsb          one independent noise stream per phase
//   i_c_meas     = -(i_a_meas + i_b_meas)              with two current sensors
//   theta_m_meas = floor(theta_m/step) step            step = 2 pi/encoder_counts
//   omega_m_meas = (theta_m_meas(k) - theta_m_meas(k-1))/T_s
//
// encoder_counts = 0: exact angle and exact speed.
#pragma once
#include <cstdint>

#include "model/frames.hpp"
#include "model/random.hpp"

namespace twinrate {

class FieldVisitor;

struct SensorParameters {
  double i_noise_rms = 0;
  double i_lsb = 0;
  int current_sensors = 3;
  int encoder_counts = 0;

  void fields(FieldVisitor& f);
};

// The current sensors of one drive.
class CurrentSensors {
 public:
  CurrentSensors(const SensorParameters& p, std::uint64_t seed) : p_(p), noise_(seed, 0) {}
  Vec3 sample(const Vec3& i_abc, std::int64_t k) {
    Vec3 i_meas = i_abc;
    if (p_.i_noise_rms > 0) {
      const auto noise = noise_(static_cast<std::uint64_t>(k));
      for (int phase = 0; phase < 3; ++phase)
        i_meas[phase] += p_.i_noise_rms * noise[static_cast<std::size_t>(phase)];
    }
    if (p_.i_lsb > 0)
#pragma GCC unroll 3
      for (int phase = 0; phase < 3; ++phase)
        i_meas[phase] = math::round(i_meas[phase] / p_.i_lsb) * p_.i_lsb;
    if (p_.current_sensors == 2) i_meas[2] = -(i_meas[0] + i_meas[1]);
    return i_meas;
  }

 private:
  SensorParameters p_;
  ThreeNormals noise_;  // streams 0, 1, 2: phases a, b, c
};
Vec3 sample_currents(const SensorParameters& p, const Vec3& i_abc, std::uint64_t seed,
                     std::int64_t k);
double sample_angle(const SensorParameters& p, double theta_m);

}  // namespace twinrate
