// Missing samples: rows of the measurement that are lost, each with the same probability.
//
// On the bus such a MEASUREMENT still comes, for the beat, with nothing measured in it: `signals`
// holds the voltage alone, which the drive knows without a sensor, and the fields repeat the row
// before. No regressors: found in the raw samples.
#include <algorithm>

#include "model/effects/registry.hpp"

namespace twinrate {
namespace {

class MissingSamples final : public TraceableEffect {
 public:
  std::string_view kind() const override { return "missing_samples"; }
  std::string_view meaning() const override { return "lost rows"; }
  int acts_on() const override { return 0; }
  std::vector<std::string> signals_needed() const override { return {"t"}; }
  void fields(FieldVisitor& f) override {
    f.number("share", share_, 0, 0.5, "of all rows", Presence::kRequired);
  }
  std::shared_ptr<Effect> clone() const override { return std::make_shared<MissingSamples>(*this); }
  bool describe_sampling(SamplingFacts& facts) const override {
    facts.missing = std::max(facts.missing, share_);
    return true;
  }
  Contribution at(const OperatingPoint&) const override { return {}; }
  int regressor_count() const override { return 0; }
  void regressors(const OperatingPoint&, std::span<Contribution>) const override {}
  void coefficients(std::span<double>) const override {}
  // One row in a thousand.
  double materiality(const DriveFacts&) const override { return share_ / 1e-3; }

  Traits traits() const override {
    static constexpr FromFault kFaults[] = {{FromFault::kMissingRows, "share"}};
    return {.equation = Equation::kSensing,
            .family = {Family::kSamples, 2},
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
        .parameters = "share = 0.02\n",
        .signal = Portrait::kAngle,
        .over = Portrait::kOverTime,
        .equation =
            "MEASUREMENT(k) without currents, angle, speed and bus voltage, with probability "
            "share",
        .shows =
            "Rows without signals: their fields repeat the previous row, here an angle 0.63 mrad "
            "too small. Filters predict over such a row (status bit 4); controllers hold their "
            "output.",
        .taken_for = "`stale_samples`, which have no flag."};
    return kPortrait;
  }

 private:
  double share_ = 0;
};

}  // namespace

std::shared_ptr<Effect> make_missing_samples() {
  return std::make_shared<MissingSamples>();
}

}  // namespace twinrate
