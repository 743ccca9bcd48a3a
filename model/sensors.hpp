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
  CurrentSensors(const SensorParameters& p, std::uint64_t seed);
  Vec3 sample(const Vec3& i_abc, std::int64_t k) const;

 private:
  SensorParameters p_;
  ThreeNormals noise_;  // streams 0, 1, 2: phases a, b, c
};
Vec3 sample_currents(const SensorParameters& p, const Vec3& i_abc, std::uint64_t seed,
                     std::int64_t k);
double sample_angle(const SensorParameters& p, double theta_m);

}  // namespace twinrate
