// Coarse current ADC.  i_meas = round(i/lsb) lsb, after noise and the steps of [sensors]
//
// No regressors: found in the raw samples.
#include <algorithm>

#include "model/effects/registry.hpp"

namespace twinrate {
namespace {

class AdcQuantisation final : public TraceableEffect {
 public:
  std::string_view kind() const override { return "adc_quantisation"; }
  std::string_view meaning() const override {
    return "steps of the current ADC beyond those of the sensors";
  }
  int acts_on() const override { return kOnCurrents; }
  std::vector<std::string> signals_needed() const override { return {"i_a", "i_b"}; }
  void fields(FieldVisitor& f) override {
    f.number("lsb_A", lsb_, 0, 1e3, "one step; 0: none", Presence::kRequired);
  }
  std::shared_ptr<Effect> clone() const override {
    return std::make_shared<AdcQuantisation>(*this);
  }
  bool describe_sampling(SamplingFacts& facts) const override {
    facts.i_lsb = std::max(facts.i_lsb, lsb_);
    return true;
  }
  Contribution at(const OperatingPoint& point) const override {
    if (lsb_ <= 0) return {};
    const Vec3 i_abc = point.i_abc();
    return {.i_abc = (i_abc / lsb_).array().round().matrix() * lsb_ - i_abc};
  }
  int regressor_count() const override { return 0; }
  void regressors(const OperatingPoint&, std::span<Contribution>) const override {}
  void coefficients(std::span<double>) const override {}
  // A step of half a per cent of the rated current.
  double materiality(const DriveFacts& facts) const override {
    return facts.machine.i_rated > 0 ? lsb_ / (5e-3 * facts.machine.i_rated) : lsb_ / 0.05;
  }

  Traits traits() const override {
    static constexpr FromFault kFaults[] = {{FromFault::kCoarseCurrents, "lsb_A"}};
    return {.equation = Equation::kSensing,
            .family = {Family::kSamples, 0},
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
        .parameters = "lsb_A = 0.2\n",
        .signal = Portrait::kIq,
        .over = Portrait::kOverTurns,
        .equation = "i_meas = round(i/lsb) lsb, after noise and the steps of [sensors]",
        .shows =
            "Steps in the measured currents, with an error of at most half a step. Their orders "
            "depend on the current; a histogram of the raw samples shows them.",
        .taken_for =
            "`backlash` and `coulomb_friction` at small current: steps of current excite the "
            "same events."};
    return kPortrait;
  }

 private:
  double lsb_ = 0;
};

}  // namespace

std::shared_ptr<Effect> make_adc_quantisation() {
  return std::make_shared<AdcQuantisation>();
}

}  // namespace twinrate
