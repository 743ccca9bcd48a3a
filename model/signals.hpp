// The signals of the loop, in SI units; the message types of lcmtypes/ have the same fields with
// unit suffixes.
//
//   plant -> Measurement -> estimator -> Estimate -> background gain -> Gain -> estimator
//                                        Estimate, Reference -> controller -> Command -> plant
#pragma once
#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "model/frames.hpp"

namespace twinrate {

inline constexpr int kMaxStates = 24;
inline constexpr int kMaxOutputs = 4;

// Bits of Measurement::signals: the fields that a sensor delivered.
enum Signal : int {
  kPhaseCurrents = 1,
  kVoltage = 2,
  kBusVoltage = 4,
  kPosition = 8,
  kSpeed = 16,
  kQCurrentOnly = 32,  // i_q was logged without i_d: the phases below hold i_d = 0
};

enum class Mode : int { kRun = 0, kAlign = 1, kIfRamp = 2, kSafe = 3 };

struct Measurement {
  std::int64_t k = -1;
  std::int64_t t_ns = 0;
  int signals = 0;
  Vec3 i_abc = Vec3::Zero();
  Vec2 u_alphabeta = Vec2::Zero();  // mean applied from t_{k-1} to t_k
  Vec3 duty_abc = Vec3::Constant(0.5);
  Mode mode = Mode::kRun;   // of the command applied from t_{k-1} to t_k ..
  double theta_forced = 0;  // .. and the angle of its forced vector (align, I/f ramp)
  double v_dc = 0;
  double theta_m = 0;
  double omega_m = 0;
};

// Bits of Estimate::status.
enum EstimateStatus : int {
  kBeforeFirstGain = 1,  // K = 0: the filter only predicts
  kLateGain = 2,         // ran on an older gain than the policy plans
  kGapBridged = 4,       // one or more samples before this one were missing and were predicted over
  kNotFinite = 8,        // the correction was not finite and was left out
  kNoVoltage = 16,       // reduced filter: measured currents are its inputs
  kAngleForced =
      32,  // alignment: the rotor stands where it was forced to, and the filter takes that over
  kMeasuredAngle = 64,   // theta_e is the position sensor's, not an estimate of it
  kScheduledGain = 128,  // ran on the gain tabulated over speed, not on one of the background
  kGainEveryTick = 256,  // the filter has not agreed with itself yet: a gain is due at each tick
};

struct Estimate {
  std::int64_t k = -1;
  std::int64_t t_ns = 0;
  std::int64_t gain_seq = -1;
  int status = 0;
  int n_x = 0, n_y = 0;
  double theta_e = 0;
  double omega_m = 0;
  Vec2 i_dq = Vec2::Zero();
  double T_load = 0;
  double dT_load_dt = 0;  // if the filter knows the load as periodic, else 0
  Eigen::Matrix<double, kMaxStates, 1> x_hat = Eigen::Matrix<double, kMaxStates, 1>::Zero();
  Eigen::Matrix<double, kMaxOutputs, 1> innov = Eigen::Matrix<double, kMaxOutputs, 1>::Zero();
};

// K in rotor axes for one speed: policy `propagated` sends several, the fast loop interpolates.
inline constexpr int kMaxSpeeds = 8;
inline constexpr int kMaxTurningStates = 6;
struct GainAtSpeed {
  double omega_m = 0;
  Eigen::Matrix<double, kMaxTurningStates, 2> K =
      Eigen::Matrix<double, kMaxTurningStates, 2>::Zero();
};

struct Gain {
  std::int64_t k = -1;  // snapshot it was computed from
  std::int64_t t_ns = 0;
  std::int64_t first_use = -1;
  int n_x = 0, n_y = 0;
  double theta_e = 0;  // electrical angle it was linearised at
  // Only the leading n_x by n_y (n_x by n_x) block is used.
  Eigen::Matrix<double, kMaxStates, kMaxOutputs> K =
      Eigen::Matrix<double, kMaxStates, kMaxOutputs>::Zero();
  Eigen::Matrix<double, kMaxStates, kMaxStates> P =
      Eigen::Matrix<double, kMaxStates, kMaxStates>::Zero();
  int n_speeds = 0;  // of at_speed; all of one sign, the slowest first
  std::array<GainAtSpeed, kMaxSpeeds> at_speed{};
};

struct Reference {
  std::int64_t k = -1;
  std::int64_t t_ns = 0;
  double omega_m_ref = 0;
  double i_d_ref = 0;
};

struct Command {
  std::int64_t k = -1;
  std::int64_t t_ns = 0;
  Mode mode = Mode::kRun;
  Vec2 u_alphabeta_ref = Vec2::Zero();
  Vec2 i_dq_ref = Vec2::Zero();
  Vec2 i_dq = Vec2::Zero();
  double theta_ctrl = 0;
  double omega_m_ref = 0;
};

struct Truth {
  std::int64_t k = -1;
  std::int64_t t_ns = 0;
  Vec2 i_dq = Vec2::Zero();
  double omega_m = 0;
  double theta_m = 0;
  double T_em = 0;
  double T_load = 0;
};

}  // namespace twinrate
