// Current ADC of limited range.  i_meas = max(-limit, min(limit, i)), after noise
//
// No regressors: found in the raw samples.
#include <algorithm>

#include "model/effects/registry.hpp"

namespace twinrate {
namespace {

class AdcClipping final : public Effect {
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
  // Any reading that stands at the limit is one too many.
  double materiality(const DriveFacts&) const override { return limit_ > 0 ? 1 : 0; }

 private:
  double limit_ = 0;
};

}  // namespace

std::shared_ptr<Effect> make_adc_clipping() {
  return std::make_shared<AdcClipping>();
}

}  // namespace twinrate
