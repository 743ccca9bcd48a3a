// One drive file: everything the processes of one drive share. docs/config-reference.md lists every
// key.
//
// A table that only one folder needs belongs to that folder and is read there, from the same
// Config: [bus], [monitor], the simulation keys of [plant], and the tables of the filter and
// controller kinds ([estimator.ekf_sensorless], [controller.foc], ..).
#pragma once
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "core/covariance_form.hpp"
#include "core/rates.hpp"
#include "model/discretise.hpp"
#include "model/drive_facts.hpp"
#include "model/effects/effect.hpp"
#include "model/inverter.hpp"
#include "model/machine.hpp"
#include "model/plant_facts.hpp"
#include "model/sensors.hpp"
#include "model/signals.hpp"

namespace twinrate {

enum class Start : int { kAligned = 0, kAlignIf = 1, kFlying = 2 };
enum class Pace : int { kLockstep = 0, kRealtime = 1 };
enum class AngleSource : int { kEstimate = 0, kMeasured = 1, kTruth = 2 };

// Where an effect acts: in the simulated plant, in the model of estimator and controller, or in
// both.
enum class UsedIn : int { kPlant = 0, kModel = 1, kBoth = 2 };

enum class Compensation : int { kOff = 0, kPaper = 1, kAngleDomain = 2, kLoad = 3 };

inline constexpr const char* kCompensationNames[] = {"off", "paper", "angle_domain", "load"};
inline constexpr const char* kUsedInNames[] = {"plant", "model", "both"};
inline constexpr const char* kStartNames[] = {"aligned", "align_if", "flying"};
inline constexpr const char* kPaceNames[] = {"lockstep", "realtime"};
inline constexpr const char* kAngleSourceNames[] = {"estimate", "measured", "truth"};

// f_s and n = f_s/f_b; a file gives n or f_b_Hz (then f_s/f_b must be a whole number).
struct RateParameters {
  double f_s_Hz = 0;
  int n = 1;
  double f_b_Hz = 0;
  NFrom n_from = NFrom::kLocked;
  double n_from_s = 0;  // n_from = "start"
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
  Prediction prediction = Prediction::kEuler;
  CovarianceForm covariance = CovarianceForm::kAuto;
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

struct ConfiguredEffect {
  std::shared_ptr<const Effect> effect;
  UsedIn used_in = UsedIn::kPlant;
  double from_s = 0;  // it begins then
  // The time in which the model has the effect: a steered run keeps additions and removals this
  // way.
  double known_from_s = 0, known_to_s = std::numeric_limits<double>::infinity();

  bool is_known_at(double t_s) const {
    return used_in != UsedIn::kPlant && known_from_s <= t_s && t_s < known_to_s;
  }
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
  PlantFacts plant;
  Start start = Start::kAligned;
  ReferenceParameters reference;
  LoadParameters load;
  RunParameters run;
  std::vector<ConfiguredEffect> effects;  // [[effect]]

  double T_s() const { return 1 / rates.f_s_Hz; }
  std::int64_t t_ns(std::int64_t k) const;
  std::int64_t steps() const;
  // The background waits for the filter's agreement before it computes a gain every n ticks.
  bool locks_first() const;
  // Switches at a multiple of n; with locks_first() the rate after the agreement. The estimate
  // shows which earlier ticks need a gain as well (kGainEveryTick).
  BackgroundRate background_rate() const;
  bool sends_gain(const Estimate& e) const { return sends_gain(e.k, e.status); }
  bool sends_gain(std::int64_t k, int estimate_status) const;
  // Gains of the ticks after `first` up to `last`.
  std::int64_t gains_between(std::int64_t first, std::int64_t last, BackgroundRate rate) const;
  std::int64_t gains_between(std::int64_t first, std::int64_t last) const {
    return gains_between(first, last, background_rate());
  }
  Reference reference_at(std::int64_t k) const;
  double omega_m_limit() const;   // twice the fastest of rated speed and references
  double omega_m_start() const;   // 0 unless start = "flying"
  Effects plant_effects() const;  // effects of the simulated plant
  Effects model_effects() const;  // effects that estimator and controller compensate at the start
  // The ticks after 0 at which this model changes, ascending.
  std::vector<std::int64_t> model_changes() const;
  DriveFacts facts() const;
};

}  // namespace twinrate
