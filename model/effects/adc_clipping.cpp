// Current ADC of limited range.  i_meas = max(-limit, min(limit, i)), after noise
//
// No regressors: found in the raw samples.
#include <algorithm>

#include "model/effects/registry.hpp"

namespace twinrate {
namespace {

class AdcClipping final : public TraceableEffect {
 public:
  std::string_view kind() const override { return "adc_clipping"; }
  std::string_view meaning() const override { return "range of the current ADC"; }
  int acts_on() const override { return kOnCurrents; }
  std::vector<std::string> signals_needed() const override { return {"i_a", "i_b"}; }
  void fields(FieldVisitor& f) override {
    f.number("limit_A", limit_, 0, 1e6, "largest reading of a phase; 0: unlimited",
             Presence::kRequired);
  }
  std::shared_ptr<Effect> clone() const override { return std::make_shared<AdcClipping>(*this); }
  bool describe_sampling(SamplingFacts& facts) const override {
    if (limit_ > 0) facts.i_limit = facts.i_limit > 0 ? std::min(facts.i_limit, limit_) : limit_;
    return true;
  }
  Contribution at(const OperatingPoint& point) const override {
    if (limit_ <= 0) return {};
    const Vec3 i_abc = point.i_abc();
    return {.i_abc = i_abc.cwiseMax(-limit_).cwiseMin(limit_) - i_abc};
  }
  int regressor_count() const override { return 0; }
  void regressors(const OperatingPoint&, std::span<Contribution>) const override {}
  void coefficients(std::span<double>) const override {}
  // A single reading at the limit is already material.
  double materiality(const DriveFacts&) const override { return limit_ > 0 ? 1 : 0; }

  Traits traits() const override {
    static constexpr FromFault kFaults[] = {{FromFault::kLimitedCurrents, "limit_A"}};
    return {.equation = Equation::kSensing,
            .family = {Family::kSamples, 1},
            .period = {.in = Period::kNothing},
            .repeats = {.how = Repeats::kOnce},
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
        .parameters = "limit_A = 1.5\n",
        .signal = Portrait::kIq,
        .over = Portrait::kOverTurns,
        .equation = "i_meas = max(-limit, min(limit, i)), after noise",
        .shows =
            "Flat tops of the measured phase currents; in rotor axes orders 6 n_p (18) and "
            "multiples, if the peak of the current exceeds the limit. The controller uses the "
            "clipped currents, so true currents and torque are distorted, too.",
        .taken_for = "`current_gain` (a smaller mean); `saturation`, which is smooth."};
    return kPortrait;
  }

 private:
  double limit_ = 0;
};

}  // namespace

std::shared_ptr<Effect> make_adc_clipping() {
  return std::make_shared<AdcClipping>();
}

}  // namespace twinrate
