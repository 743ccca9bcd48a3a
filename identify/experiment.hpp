// The hand on a rig: holds voltages and currents, records rows, and stops what goes too far.
//
// The current loop is a PI controller in complex form, in a frame that turns with omega_e:
//
//   u = k_p e + integral (k_i + j omega_e k_p) e + j omega_e L i_ref
//   k_p = omega_c L,  k_i = k_p omega_c/8,  omega_c = 2 pi f_s/25 (one tick of delay)
//
// It needs the inductance alone, within a factor of two or so. The voltage is turned ahead by the
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

// A row with the offsets of the current sensors taken off.
struct Row {
  Vec2 i = Vec2::Zero(), u = Vec2::Zero();  // alpha, beta
  double theta = 0;                         // rad, mechanical; positive with the phase order
  bool repeats = false;                     // the three currents are those of the row before
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

  // The phases without current, `ticks` long, once the shaft is at rest: the shorted winding brakes
  // it. Throws RunFailed where it goes on turning.
  void measure_offsets(int ticks);
  const Vec3& offsets() const { return offset_abc_; }
  // Standard error of the offset along alpha: every current of an experiment has the same.
  double offset_sigma_alpha() const { return offset_sigma_alpha_; }
  void set_inductance(double L) { L_ = L; }
  // Of `looked` rows whose currents had to change, `repeated` did not.
  void count_repeats(int repeated, int looked) { repeated_ += repeated, looked_ += looked; }
  // Share of rows that are not read anew; 0 where it can be chance.
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
  // The loop begins anew, at this voltage (in its frame).
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
  Vec3 before_ = Vec3::Constant(NAN);  // A, readings of the row before
  int repeated_ = 0, looked_ = 0;
  Rows* rows_ = nullptr;
  std::int64_t k_ = 0;
};

}  // namespace twinrate
