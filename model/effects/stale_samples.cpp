// Stale samples: rows whose readings are those of the row before, each with the same probability.
//
//   all       currents, angle, speed and bus voltage: the row was not written
//   current   the currents alone: their converter was not read
//
// No regressors: found in the raw samples.
#include <algorithm>

#include "model/effects/registry.hpp"

namespace twinrate {
namespace {

class StaleSamples final : public TraceableEffect {
 public:
  std::string_view kind() const override { return "stale_samples"; }
  std::string_view meaning() const override { return "rows that repeat the previous row"; }
  int acts_on() const override { return 0; }
  std::vector<std::string> signals_needed() const override { return {"i_a", "i_b", "theta_m"}; }
  void fields(FieldVisitor& f) override {
    f.choice("signal", signal_, kSignalNames, "signals that repeat");
    f.number("share", share_, 0, 0.5, "of all rows", Presence::kRequired);
  }
  std::shared_ptr<Effect> clone() const override { return std::make_shared<StaleSamples>(*this); }
  bool describe_sampling(SamplingFacts& facts) const override {
    double& share = signal_ == kAll ? facts.stale : facts.held;
    share = std::max(share, share_);
    return true;
  }
  Contribution at(const OperatingPoint&) const override { return {}; }
  int regressor_count() const override { return 0; }
  void regressors(const OperatingPoint&, std::span<Contribution>) const override {}
  void coefficients(std::span<double>) const override {}
  // One row in a thousand.
  double materiality(const DriveFacts&) const override { return share_ / 1e-3; }

  Traits traits() const override {
    static constexpr FromFault kFaults[] = {
        {FromFault::kStaleRows, "share", "signal", kAll},
        {FromFault::kHeldCurrents, "share", "signal", kCurrent}};
    return {.equation = Equation::kSensing,
            .family = {Family::kSamples, 3},
            .period = {.in = Period::kNothing},
            .repeats = {.how = Repeats::kByKey, .key = "signal"},
            .place = Place::kSamples,
            .noise = Noise::kNone,
            .on_command = Answer::kNo,
            .loss = Loss::kNo,
            .view = View::kShare,
            .told_by = Run::kVaried,
            .relatives = none,
            .readings = none,
            .bounds = none,
            .faults = kFaults};
  }
  const Portrait& portrait() const override {
    static constexpr Portrait kPortrait{
        .parameters = "share = 0.02\n",
        .signal = Portrait::kAngle,
        .over = Portrait::kOverTime,
        .equation =
            "currents, angle, speed and v_dc of MEASUREMENT(k) are those of k-1, with "
            "probability share; of signal current the currents alone",
        .shows =
            "Rows equal to the previous row to the last bit, in every measured signal at once: "
            "here an angle 0.63 mrad too small, in 2 % of the rows. If the currents alone repeat, "
            "more rows than chance explains lie behind the line through the neighbouring rows.",
        .taken_for =
            "noise of the speed; `adc_quantisation`, if only the currents repeat and change "
            "little."};
    return kPortrait;
  }

 private:
  enum Repeated : int { kAll, kCurrent };
  static constexpr const char* kSignalNames[] = {"all", "current"};

  Repeated signal_ = kAll;
  double share_ = 0;
};

}  // namespace

std::shared_ptr<Effect> make_stale_samples() {
  return std::make_shared<StaleSamples>();
}

}  // namespace twinrate
