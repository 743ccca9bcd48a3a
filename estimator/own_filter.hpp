// A filter of your own that replaces a part of the filter in the drive file.
//
// Derive from OwnFilter and override the functions of Filter that are your own, at least
// fast_step() or output(). All other functions are those of the filter `estimator.kind`: start,
// alignment, missing samples, size of state and gain. The gain process continues with the gains of
// that filter, computed at your x_hat: keep its states and their order (docs/theory), or use no
// gain.
#pragma once
#include "estimator/make_filter.hpp"

namespace twinrate {

class OwnFilter : public Filter {
 public:
  // Throws the BadInput of make_filter().
  explicit OwnFilter(Config& config) : drive_(config.drive()), built_in_(make_filter(config)) {
    know(known_effects(drive_));
  }

  std::string_view kind() const override { return built_in_->kind(); }
  FastState start(const Measurement& first) const override { return built_in_->start(first); }
  Correction fast_step(FastState& state, const Measurement& m, const Gain& gain) const override {
    return built_in_->fast_step(state, m, gain);
  }
  void predict_over_gap(FastState& state, const Measurement& last) const override {
    built_in_->predict_over_gap(state, last);
  }
  void align(FastState& state, double theta_e) const override { built_in_->align(state, theta_e); }
  Estimate output(const FastState& state, const Measurement& m) const override {
    return built_in_->output(state, m);
  }
  bool estimates_load() const override { return built_in_->estimates_load(); }
  double direct_start_within() const override { return built_in_->direct_start_within(); }
  std::optional<double> load_speed_min(double u_unknown) const override {
    return built_in_->load_speed_min(u_unknown);
  }
  Gain initial_gain() const override { return built_in_->initial_gain(); }
  Gain initial_gain_without_voltage() const override {
    return built_in_->initial_gain_without_voltage();
  }
  Gain background_step(const Gain& previous, const Estimate& snapshot) const override {
    return built_in_->background_step(previous, snapshot);
  }
  int turning_pairs() const override { return built_in_->turning_pairs(); }
  int voltage_state() const override { return built_in_->voltage_state(); }
  Estimate ahead(const Estimate& snapshot, double ticks) const override {
    return built_in_->ahead(snapshot, ticks);
  }
  std::optional<Estimate> steady_state(double omega_m) const override {
    return built_in_->steady_state(omega_m);
  }
  std::optional<CovarianceModel> covariance_model(const Estimate& snapshot) const override {
    return built_in_->covariance_model(snapshot);
  }
  Gain background_steps(const Gain& gain, double omega_m, int ticks) const override {
    return built_in_->background_steps(gain, omega_m, ticks);
  }

 protected:
  const DriveConfig& drive() const { return drive_; }

 private:
  DriveConfig drive_;
  std::shared_ptr<const Filter> built_in_;
};

// For run_estimator(): makes a Kind from the drive file.
template <class Kind>
std::shared_ptr<const Filter> own_filter(Config& config) {
  return std::make_shared<const Kind>(config);
}

}  // namespace twinrate
