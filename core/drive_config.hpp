// One drive file: everything the processes of one drive share. docs/config-reference.md lists every
// key.
//
// The tables of the filter and controller kinds ([estimator.ekf_sensorless], [controller.foc], ..)
// belong to their own folders and are read there, from the same Config.
#pragma once
#include <cstdint>
#include <string>

#include "core/rates.hpp"
#include "model/effects/effect.hpp"
#include "model/inverter.hpp"
#include "model/machine.hpp"
#include "model/sensors.hpp"
#include "model/signals.hpp"

namespace twinrate {

enum class Start : int { kAligned = 0, kAlignIf = 1, kFlying = 2 };
enum class Pace : int { kLockstep = 0, kRealtime = 1 };
enum class AngleSource : int { kEstimate = 0, kMeasured = 1, kTruth = 2 };

// Who knows an effect: the simulated plant has it, the model of estimator and controller has it.
enum class UsedIn : int { kPlant = 0, kModel = 1, kBoth = 2 };

enum class Compensation : int { kOff = 0, kPaper = 1, kAngleDomain = 2 };

inline constexpr const char* kCompensationNames[] = {"off", "paper", "angle_domain"};
inline constexpr const char* kUsedInNames[] = {"plant", "model", "both"};
inline constexpr const char* kStartNames[] = {"aligned", "align_if", "flying"};
inline constexpr const char* kPaceNames[] = {"lockstep", "realtime"};
inline constexpr const char* kAngleSourceNames[] = {"estimate", "measured", "truth"};

// f_s and n = f_s/f_b; a file gives n or f_b_Hz (then f_s/f_b must be a whole number).
struct RateParameters {
  double f_s_Hz = 0;
  int n = 1;
  double f_b_Hz = 0;
  double n_from_s = 0;
  void fields(FieldVisitor& f);
};

struct GainParameters {
  GainPolicy policy = GainPolicy::kPaper;
  int max_age_ticks = 0;
  double speed_span = 800;  // electrical, rad/s
  void fields(FieldVisitor& f);
};

struct EstimatorChoice {
  std::string kind = "ekf_sensorless";
  int prediction = 0;  // index into kPredictionNames (model/discretise.hpp)
  int covariance = 3;  // 0 joseph, 1 paper, 2 sequential, 3 auto
  void fields(FieldVisitor& f);
};

struct ControllerChoice {
  std::string kind = "foc";
  AngleSource angle_source = AngleSource::kEstimate;
  Profile compensation;  // positions in kCompensationNames
  Compensation compensation_at(double t_s) const {
    return static_cast<Compensation>(static_cast<int>(compensation.at(t_s)));
  }
  void fields(FieldVisitor& f);
};

struct PlantParameters {
  int engine = 0;    // 0 erk, 1 cvode
  int inverter = 0;  // 0 averaged, 1 switched
  int saliency = 0;  // 0 rotor, 1 fixed axes
  int erk_steps = 1;
  int delay_samples = 1;
  int hold_ticks = 20;
  double theta_e_start = 0;
  void fields(FieldVisitor& f);
};

// Exactly one of the two speeds is given.
struct ReferenceParameters {
  Profile omega_e_rad_s, speed_rpm;
  bool in_rpm = false;
  Profile i_d_A;
  double slew_rate_rad_s2 = 16000;  // electrical
  bool from_bus = false;
  void fields(FieldVisitor& f);
};

struct LoadParameters {
  Profile T_load_Nm;
  double slew_Nm_s = 0;
  void fields(FieldVisitor& f);
};

struct RunParameters {
  double duration_s = 2, settle_s = 0.5;
  int seed = 1;
  void fields(FieldVisitor& f);
};

struct BusParameters {
  double peer_timeout_s = 10, repeat_after_ms = 10;
  int window_ticks = 512;
  double drop_rate = 0;
  bool pin = true;
  bool split_ports = false;
  bool filter = true;
  double log_rotate_MB = 2000;
  void fields(FieldVisitor& f);
};

// twinrate-monitor (monitor/live_monitor.hpp).
struct MonitorParameters {
  bool enabled = false, auto_add = false;
  double learn_s = 2, block_s = 0.25, gather_s = 2, window_s = 10;
  void fields(FieldVisitor& f);
};

struct ConfiguredEffect {
  std::shared_ptr<const Effect> effect;
  UsedIn used_in = UsedIn::kPlant;
  double from_s = 0;  // it begins then
};

struct DriveConfig {
  std::string name;
  MachineParameters machine;
  InverterParameters inverter;
  SensorParameters sensors;
  RateParameters rates;
  GainParameters gain;
  EstimatorChoice estimator;
  ControllerChoice controller;
  PlantParameters plant;
  Start start = Start::kAligned;
  ReferenceParameters reference;
  LoadParameters load;
  RunParameters run;
  BusParameters bus;
  MonitorParameters monitor;
  std::vector<ConfiguredEffect> effects;  // [[effect]]

  double T_s() const { return 1 / rates.f_s_Hz; }
  std::int64_t t_ns(std::int64_t k) const;
  std::int64_t steps() const;
  BackgroundRate background_rate() const;  // switched at a multiple of n
  // Whether tick k sends a gain, and how many the ticks after `first` up to `last` send.
  bool sends_gain(std::int64_t k) const;
  std::int64_t gains_between(std::int64_t first, std::int64_t last) const;
  Reference reference_at(std::int64_t k) const;
  double omega_m_limit() const;   // twice the fastest of rated speed and references
  double omega_m_start() const;   // 0 unless start = "flying"
  Effects plant_effects() const;  // what the simulated plant does
  Effects model_effects() const;  // what estimator and controller know of
  DriveFacts facts() const;
};

}  // namespace twinrate
