// Drives a rig: applies voltages, controls currents, records rows, and ends the experiment at an
// excessive current.
//
// The current loop is a PI controller in complex form, in a frame that turns with omega_e:
//
//   u = k_p e + integral (k_i + j omega_e k_p) e + j omega_e L i_ref
//   k_p = omega_c L,  k_i = k_p omega_c/8,  omega_c = 2 pi f_s/25 (one tick of delay)
//
// It needs only the inductance, within a factor of about two. The voltage is turned ahead by the
// delay and half a tick.
#pragma once
#include <cmath>
#include <functional>
#include <stdexcept>
#include <vector>

#include "identify/rig.hpp"

namespace twinrate {

// The experiment cannot go on: the program prints what() and leaves with exit code 1.
struct RunFailed : std::runtime_error {
  using std::runtime_error::runtime_error;
};

struct IdentifyLimits {
  double i_max = 0;        // A, amplitude of every test current
  double omega_m_max = 0;  // rad/s; 0: the voltage alone limits the speed
};

struct IdentifyHooks {
  std::function<void(const std::string& what, double share)> progress;
  std::function<bool()> stop;
};

// A row from whose currents the offsets of the sensors are subtracted.
struct Row {
  Vec2 i = Vec2::Zero(), u = Vec2::Zero();  // alpha, beta
  double theta = 0;                         // rad, mechanical; positive with the phase order
  bool repeats = false;                     // the three currents equal those of the row before
};
using Rows = std::vector<Row>;

class Experiment {
 public:
  Experiment(Rig& rig, const IdentifyLimits& limits, IdentifyHooks hooks);

  const RigFacts& facts() const { return rig_.facts(); }
  double T_s() const { return facts().T_s; }
  double u_max() const { return facts().v_dc * std::numbers::inv_sqrt3; }
  double i_max() const { return limits_.i_max; }
  double omega_m_max() const { return limits_.omega_m_max; }
  int ticks(double seconds) const { return std::max(1, static_cast<int>(seconds / T_s() + 0.5)); }
  double seconds() const { return static_cast<double>(k_) * T_s(); }

  // Measures the phases without current for `ticks` ticks, once the shaft is at rest: the shorted
  // winding brakes it. Throws RunFailed if the shaft keeps turning.
  void measure_offsets(int ticks);
  const Vec3& offsets() const { return offset_abc_; }
  // Standard error of the offset along alpha, which every current of an experiment shares.
  double offset_sigma_alpha() const { return offset_sigma_alpha_; }
  void set_inductance(double L) { L_ = L; }
  // Of `looked` rows whose currents should have changed, `repeated` did not change.
  void count_repeats(int repeated, int looked) { repeated_ += repeated, looked_ += looked; }
  // Share of rows without a new reading; 0 if it can be chance.
  double stale_share() const {
    constexpr int kLeast = 10;
    constexpr double kLeastShare = 2e-3;
    const double share = looked_ > 0 ? static_cast<double>(repeated_) / looked_ : 0;
    return repeated_ < kLeast || share < kLeastShare ? 0 : share;
  }
  void set_direction(int direction) { direction_ = direction; }

  // One tick at a voltage. Throws RunFailed at a current above twice i_max.
  const Row& apply(const Vec2& u_alphabeta, double theta_e = 0);
  // One tick of the current loop in a frame at `theta_e` now that turns with omega_e.
  const Row& control(const Vec2& i_dq_ref, double theta_e, double omega_e);
  // Restarts the loop at this voltage (in its frame).
  void begin_control(const Vec2& u_dq) { integral_ = u_dq; }
  const Vec2& integral() const { return integral_; }
  const Row& now() const { return row_; }
  void record(Rows* rows) { rows_ = rows; }
  void show(const std::string& what, double share) const;
  int late_ticks() const { return rig_.late_ticks(); }
  double inductance() const { return L_; }
  // Before an evaluation: Rig::pause().
  void pause() { rig_.pause(); }

 private:
  void wait_for_rest();
  RigRow step(const Vec2& u_alphabeta, double theta_e);

  Rig& rig_;
  IdentifyLimits limits_;
  IdentifyHooks hooks_;
  Vec3 offset_abc_ = Vec3::Zero();
  double offset_sigma_alpha_ = 0;
  double L_ = 0;
  int direction_ = 1;
  Vec2 integral_ = Vec2::Zero();
  Row row_;
  Vec3 before_ = Vec3::Constant(NAN);  // A, currents of the row before
  int repeated_ = 0, looked_ = 0;
  Rows* rows_ = nullptr;
  std::int64_t k_ = 0;
};

}  // namespace twinrate
